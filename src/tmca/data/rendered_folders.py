"""Scenes of a folder of photographs: drawn, rendered one after the other, listed in a split file."""

from __future__ import annotations

import json
from collections.abc import Callable
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.data.files import read_attributes, write_dataset
from tmca.data.folders import held_folder
from tmca.data.formats.images import PICTURES, picture_size
from tmca.data.formats.orientation import orientation_of, upright_size
from tmca.data.rendering import rendered_light_field, rendered_scene
from tmca.data.rendering.lighting import Light
from tmca.data.rendering.own import photographs_in
from tmca.data.rendering.photographs import check_photograph, photograph
from tmca.data.scene_names import write_split
from tmca.errors import OutputError, check_choice, check_range

if TYPE_CHECKING:
    import xarray as xr

SPLIT = "scenes.txt"
"""Name of the split file beside the scenes."""


def render_folder(
    photographs: str | Path,
    out: str | Path,
    *,
    number: int | None = None,
    seed: int = 0,
    views: int | None = None,
    light: Light = "drawn",
    overwrite: bool = False,
    progress: Callable[..., None] | None = None,
    **rendering: Any,
) -> list[Path]:
    """Render the photographs of a folder, and of those in it, into files, with a split file ``scenes.txt``.

    A scene that is there, whole and rendered alike, is left as it is: work that was stopped goes on where it was.

    Args:
        photographs: a folder with PNG, JPEG, BMP or TIFF files.
        out: folder of the scenes, made where it does not exist; each is named as its photograph.
        number: so many photographs, drawn by the seed; a larger number keeps those of a smaller one. All without it.
        seed: draws photographs and scenes.
        views: n for light fields of n×n views instead of spectral scenes.
        light: of spectral scenes; see `rendered_scene`.
        overwrite: render anew what is there, also scenes that were rendered otherwise.
        progress: called with the share that is done, None, and the name of the scene.
        rendering: further arguments of `rendered_scene`, or of `rendered_light_field`.

    Returns:
        The files in the order of their names, which are those of the split.

    Raises:
        DataError: no photographs, or one that cannot be rendered.
        OutputError: other scenes are in ``out``, or it cannot be written, or another process renders into it.
        SettingError: fewer photographs than asked for, or what rendering refuses.
    """
    engine = rendered_scene if views is None else rendered_light_field
    for name in rendering:
        check_choice("rendering", name, [*signature(engine).parameters][1:])
    chosen = drawn_photographs(photographs, number, seed)
    for path in chosen.values():
        if path.suffix.lower() in PICTURES:
            check_photograph(path, upright_size(picture_size(path), orientation_of(path)), rendering.get("size"))
    how = {"seed": seed, **({"light": light} if views is None else {"views": views}), **rendering}
    with held_folder(out, "rendering") as folder:
        files = [folder / f"{name}.nc" for name in chosen]
        _refuse_others(folder, files, overwrite)
        wanted = dict(zip(files, chosen.values(), strict=True))
        left = [file for file, path in wanted.items() if overwrite or not _is_there(file, path, how)]
        for index, file in enumerate(left):
            if progress is not None:
                progress(index / len(left), None, file.stem)
            write_dataset(_rendered(wanted[file], file.stem, how), file, overwrite=overwrite)
        write_split(files, folder / SPLIT, folder, overwrite=True)
    return files


def drawn_photographs(folder: str | Path, number: int | None = None, seed: int = 0) -> dict[str, Path]:
    """Photographs of a folder by the names of their scenes; arguments and errors as of `render_folder`."""
    found = photographs_in(Path(folder))
    check_range("seed", seed, 0, whole=True)
    if number is None:
        return found
    check_range("number", number, 1, len(found), whole=True)
    order = np.random.default_rng(seed).permutation(len(found))
    return {name: found[name] for name in sorted(sorted(found)[place] for place in order[:number])}


def _rendered(path: Path, name: str, how: dict[str, Any]) -> xr.Dataset:
    """A scene that says how it was rendered."""
    scene = rendered_scene(path, **how) if "views" not in how else rendered_light_field(path, **how)
    return scene.assign_attrs(name=name, rendering=_noted(how))


def _noted(how: dict[str, Any]) -> str:
    return json.dumps({key: value for key, value in sorted(how.items()) if value is not None}, default=float)


def _refuse_others(folder: Path, files: list[Path], overwrite: bool) -> None:
    """Refuse a folder with scenes that are none of these."""
    others = sorted({*folder.glob("*.nc")} - {*files})
    if others and not overwrite:
        more = f" and {len(others) - 1} more" if len(others) > 1 else ""
        raise OutputError(folder, f"other scenes, {others[0].name}{more}", "an empty folder", "choose another --out")


def _is_there(file: Path, path: Path, how: dict[str, Any]) -> bool:
    """Whether a scene is there; one that was rendered otherwise is refused."""
    if not file.exists():
        return False
    about, wanted = read_attributes(file), {"rendering": _noted(how), "content": photograph(path, how["seed"]).content}
    unlike = {key: about.get(key, "nothing") for key, value in wanted.items() if about.get(key) != value}
    if not unlike:
        return True
    found = "a scene of another photograph" if "content" in unlike else f"a scene rendered by {unlike['rendering']}"
    raise OutputError(file, found, wanted["rendering"], "choose another --out, or --overwrite to render all anew")
