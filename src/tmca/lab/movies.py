"""A scene that changed during the exposure of a pixel shutter: frames from one capture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from torch import Tensor

from tmca.cameras import Snapshot, SpectralCamera
from tmca.decoders import Estimate, decode
from tmca.decoders.kriging import Covariance
from tmca.errors import SettingError

if TYPE_CHECKING:
    import xarray as xr


MOVIE_NUMBERS = {"space-time-dct": ("threshold", "iterations"), "kriging": ("lifetime", "changing")}
"""Numbers of `decode_movie` that each method takes."""
MOVIE_METHODS = tuple(MOVIE_NUMBERS)


@dataclass(frozen=True)
class Movie:
    """Frames of one capture.

    Args:
        frames: (F, L, H, W) relative irradiance.
        slots: slots of the shutter that a frame stands for.
        method: of `decode_movie`.
        std: (F, L, H, W) standard deviation of the frames, where the decoder knows it.
        covariance: of the scene, of the decoder that estimates it.
    """

    frames: Tensor
    slots: int
    method: str
    std: Tensor | None = None
    covariance: Covariance | None = None


def decode_movie(
    snapshot: Snapshot[SpectralCamera],
    frames: int = 16,
    method: str = "space-time-dct",
    *,
    lifetime: float | None = None,
    changing: float | None = None,
    threshold: float | None = None,
    iterations: int = 40,
    progress: Callable[[float], None] | None = None,
) -> Movie:
    """Frames of a scene behind a pixel shutter.

    Args:
        snapshot: of a spectral camera whose aperture stays as it is.
        frames: how many.
        method: ``"space-time-dct"``, blocks of space and time that are sparse in their cosine transform, for any
            shutter, or ``"kriging"``, the best linear estimate from the samples around every place (for shutters that
            open a pixel within one frame, one band, nothing displaced).
        lifetime: slots over which the scene changes; without it as `fitted_covariance` finds. Kriging.
        changing: share of the scene's variance that changes during the exposure; likewise.
        threshold: of coefficients at the end, relative irradiance; without it half the noise of a sample, and
            0.5 % of the brightest at least.
        iterations: over which the threshold falls to it.
        progress: called with the share that is done of the iterations.

    Raises:
        SettingError: an unknown method, or a camera or a number that it cannot take.
    """
    if snapshot.camera.kind != "spectral":
        raise SettingError("snapshot", f"one of a {snapshot.camera.kind} camera", "one of a spectral camera")
    if method not in MOVIE_NUMBERS:
        raise SettingError("method", repr(method), f"one of {', '.join(MOVIE_METHODS)}")
    given: dict[str, Any] = {
        "lifetime": lifetime,
        "changing": changing,
        "threshold": threshold,
        "iterations": iterations,
    }
    numbers = {name: given[name] for name in MOVIE_NUMBERS[method]}
    estimate = decode(snapshot, method, frames=frames, progress=progress, **numbers)
    std = None if estimate.deviation is None else estimate.deviation[0]
    return Movie(estimate.values[0], snapshot.camera.slots // frames, method, std, _covariance(estimate))


def _covariance(estimate: Estimate) -> Covariance | None:
    """Of the scene, where the decoder fitted one."""
    names = [setting.name for setting in fields(Covariance)]
    fitted = {name: estimate.notes[f"scene_{name}"] for name in names if f"scene_{name}" in estimate.notes}
    return Covariance(**fitted) if fitted else None


def frame_dataset(movie: Movie, snapshot: Snapshot[SpectralCamera]) -> xr.Dataset:
    """Frames with their coordinates: ``frames`` (frame, wavelength, y, x), ``frames_std`` where the decoder knows it,
    and the first slot of each."""
    import xarray as xr

    waves = np.array(snapshot.camera.wavelengths)
    attrs = {"units": "relative irradiance", "long_name": "scene during the slots of a frame"}
    dims = ("frame", "wavelength", "y", "x")
    values = {"frames": (dims, movie.frames.numpy(), attrs)}
    if movie.std is not None:
        values["frames_std"] = (dims, movie.std.numpy(), attrs | {"long_name": "standard deviation of the frames"})
    how = {} if movie.covariance is None else asdict(movie.covariance)
    return xr.Dataset(
        values,
        coords={
            "wavelength": ("wavelength", waves, {"units": "m"}),
            "first_slot": ("frame", np.arange(len(movie.frames)) * movie.slots),
        },
        attrs=dict(snapshot.notes)
        | {"decoder": movie.method, "slots_per_frame": movie.slots}
        | {f"scene_{key}": how[key] for key in how},
    )
