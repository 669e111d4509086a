"""Pictures of snapshots and estimates beside their files; each camera's application says which there are."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.applications.base import application_of
from tmca.applications.camera_figures import snapshot_figure
from tmca.applications.moving import FRAMES, frames_of, moved_by
from tmca.plots.estimates import mean_frame
from tmca.plots.movies import movie_figure, movie_views
from tmca.plots.style import save_figure
from tmca.plots.views import views_gif

if TYPE_CHECKING:
    import xarray as xr

    from tmca.cameras import Snapshot
    from tmca.decoders import Estimate

_MOVIE = ("_frames.png", "_frames.gif")
"""Endings of the pictures of an estimate in frames."""


def snapshot_files(target: Path, kind: str, figures: bool = True) -> list[Path]:
    """What the file of a snapshot and its pictures are called."""
    endings = (".png", *(f"_{name}.png" for name in application_of(kind).codes))
    return [target, *(_files(target, endings) if figures else [])]


def estimate_files(target: Path, kind: str, figures: bool = True, moving: bool = False) -> list[Path]:
    """What the file of an estimate, of a scene that is ``moving`` in frames, and its pictures are called."""
    endings = (*application_of(kind).pictures, *(_MOVIE if moving else ()))
    return [target, *(_files(target, endings) if figures else [])]


def _files(target: Path, endings: Iterable[str]) -> list[Path]:
    return [target.with_name(f"{target.stem}{ending}") for ending in endings]


def snapshot_pictures(snapshot: Snapshot[Any], target: Path, *, overwrite: bool = False) -> list[Path]:
    """The recorded image, and what the camera showed meanwhile, as PNG beside the snapshot's file."""
    camera = snapshot.camera
    shown = application_of(camera).code_figures(camera)
    drawings = [snapshot_figure(snapshot, f"{target.stem}: K = {camera.slots}"), *shown.values()]
    files = snapshot_files(target, camera.kind)[1:]
    return [save_picture(one, file, overwrite=overwrite) for one, file in zip(drawings, files, strict=True)]


def estimate_pictures(
    estimate: Estimate,
    target: Path,
    *,
    truth: xr.DataArray | xr.Dataset | None = None,
    snapshot: Snapshot[Any] | None = None,
    overwrite: bool = False,
) -> list[Path]:
    """An estimate in pictures beside its file.

    Args:
        estimate: of a decoder.
        target: the estimate's file.
        truth: the scene, as `Application.truth` gives it.
        snapshot: that was decoded.
        overwrite: replace files.
    """
    application, movie = application_of(estimate.camera), dict[str, Any]()
    stored = estimate.to_xarray().assign(estimate.maps)
    if FRAMES in stored.dims:
        movie, stored = _movie(stored, truth), mean_frame(stored, truth is not None)
    drawn = {**application.figures(stored, estimate.camera, truth, snapshot, target.stem), **movie}
    files = _files(target, drawn)
    return [save_picture(one, file, overwrite=overwrite) for one, file in zip(drawn.values(), files, strict=True)]


def _movie(stored: xr.Dataset, truth: Any) -> dict[str, Any]:
    """Frames beside those of the truth, in a row and one after the other."""
    import xarray as xr

    frames = stored["estimate"]
    movies = {str(stored.attrs["decoder"]): frames}
    if truth is not None:
        moved = frames_of(truth, moved_by(stored.attrs), frames.sizes[FRAMES])
        movies["truth"] = xr.concat(moved, FRAMES, coords="minimal", compat="override", join="override")
    return dict(zip(_MOVIE, (movie_figure(movies), movie_views(frames)), strict=True))


def save_picture(picture: Any, file: Path, *, overwrite: bool = False) -> Path:
    """A figure, or for ``.gif`` views (V, U, H, W) as a walk over them, as a file."""
    return (views_gif if file.suffix == ".gif" else save_figure)(picture, file, overwrite=overwrite)
