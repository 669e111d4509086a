"""Spectral scenes with depth to work with: of any kind of file or rendered, at given bands and depth range."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.arguments import Float, Floats, Int, IntPair, checked
from tmca.data.cubes import locate_cube, read
from tmca.data.fitting import METRES, at_bands, fitted_depth, middle_of
from tmca.data.formats.opening import open_contents
from tmca.data.light_fields import find_light_field
from tmca.data.rendering import is_rendered, rendered_scene
from tmca.data.rendering.pictures import Materials
from tmca.data.rgbd import holds_rgbd, read_rgbd
from tmca.data.scene_names import READING
from tmca.data.spectral_depth import place_cube, read_spectral_depth, reduced_scene, scene_parts
from tmca.errors import DataError, SettingError

if TYPE_CHECKING:
    import xarray as xr

SURROUNDINGS = 64
"""Pixels beside what is measured, more than what reaches it: half of a point spread function of 31, the patch
likelihood's reach of 24 and its window of 12; most of what a two-headed network sees."""
_ASKED = {"placed": "has no depth", "from_rgb": "has no spectra"}


@checked
def load_spectral_depth(
    source: str | Path,
    wavelengths: Floats | None = None,
    *,
    near: Float | None = None,
    far: Float | None = None,
    size: IntPair | None = None,
    reduce: Int = 1,
    placed: str | None = None,
    from_rgb: bool = False,
    materials: Materials = "train",
    fitted: bool = True,
    seed: Int = 0,
) -> xr.Dataset:
    """A spectral scene with depth, brought to bands, depth range and size of a camera.

    Args:
        source: a rendered scene, a file or folder of ``tmca.data.read_spectral_depth``, an RGB-D scene with
            ``from_rgb``, or a spectral cube with ``placed``.
        wavelengths: (L,) of the camera, metres; the scene's own bands without.
        near, far: its depth range, metres; without, metres stay metres.
        size: (H, W) centre crop, of a scene whose depth is fitted as a whole.
        reduce: pixels per axis that are averaged into one.
        placed: how a cube without depth is put at drawn depths: a kind of ``tmca.data.place_cube``.
        from_rgb: make up spectra for an RGB-D scene.
        materials: half of the measured reflectances that these are made of; ``"test"`` for scenes that are held out.
        fitted: map inverse depth affinely onto the range (``tmca.data.fitting``), which attributes tell; without,
            metres stay metres.
        seed: of what is drawn.

    Returns:
        ``radiance`` (wavelength, y, x) and ``depth`` (y, x), metres, NaN where unknown.

    Raises:
        DataError, SettingError: no such scene, or one that cannot be used so.
    """
    source = str(source)
    by, ranged = None if reduce == 1 else reduce, near is not None and far is not None
    how = {"source": source, "reduce": reduce, "placed": placed, "from_rgb": from_rgb, "materials": materials}
    how |= {"fitted": fitted, "seed": seed}
    if is_rendered(source):
        _refuse(source, "a rendered scene, which has spectra and depth", placed=placed, from_rgb=from_rgb)
        rendered = rendered_scene(source, wavelengths=wavelengths, seed=seed)
        scene = reduced_scene(rendered[["radiance", "depth"]], by, source)
    elif placed is not None:
        scene = reduced_scene(_placed(source, placed, wavelengths, near, far, seed), by, source)
    else:
        made_up = {"wavelengths": wavelengths, "seed": seed, "materials": materials} if from_rgb else {}
        scene = _measured(source, from_rgb, reduce, made_up)
    if wavelengths is not None:
        scene = scene.drop_dims("wavelength").assign(radiance=at_bands(scene["radiance"], wavelengths))
    if placed is None and fitted and ranged:
        scene["depth"], about = fitted_depth(scene["depth"], near, far)  # type: ignore[arg-type]
        scene.attrs.update(about)
    scene = scene if size is None else middle_of(scene, size, source)
    scene = scene if fitted else scene.assign_attrs({METRES: 1})
    return scene.assign_attrs({"name": Path(source).stem, READING: json.dumps(how)})


def _placed(
    source: str, kind: str, wavelengths: Floats | None, near: float | None, far: float | None, seed: int
) -> xr.Dataset:
    """A cube at drawn depths."""
    if _kind_and_side(source)[0] != "cube":
        _refuse(source, "a scene with depth of its own", placed=kind)
    if near is None or far is None:
        raise SettingError("near", "no depth range", "near and far, metres, between which the cube is placed")
    cube = read(source) if wavelengths is None else at_bands(read(source), wavelengths)
    return place_cube(cube, near, far, seed, kind)  # type: ignore[arg-type]


def _measured(source: str, from_rgb: bool, reduce: int, made_up: dict[str, Any]) -> xr.Dataset:
    """A scene with a depth of its own; what else it is, where it cannot be read."""
    try:
        return read_spectral_depth(source, from_rgb=from_rgb, reduce=reduce, **made_up)
    except DataError:
        check_depth_scene(source, None, from_rgb)
        raise


def _refuse(source: str, found: str, **asked: Any) -> None:
    for name, value in asked.items():
        if value:
            raise DataError(source, found, f"one that {_ASKED[name]}", f"leave --{name.replace('_', '-')} out")


def load_any_depth_scene(
    source: str,
    wavelengths: Sequence[float],
    *,
    near: float,
    far: float,
    side: int,
    placed: str | None,
    from_rgb: bool,
    materials: Materials = "train",
) -> xr.Dataset:
    """A scene of any kind at a camera's bands and depth range, as training and comparisons read their lists.

    Args:
        source: as for `load_spectral_depth`.
        wavelengths: (L,) of the bands, metres.
        near, far: the depth range, metres.
        side: scenes from files are averaged down while their shorter side keeps at least this many pixels.
        placed: how cubes without depth are put at drawn depths.
        from_rgb: make up spectra for RGB-D scenes.
        materials: half of the reflectances that these are made of; ``"test"`` for scenes that are held out.

    Raises:
        DataError: no scene, or one whose kind asks for ``placed`` or ``from_rgb``.
    """
    how: dict[str, Any] = {"near": near, "far": far, "materials": materials}
    if not is_rendered(source):
        kind, least = check_depth_scene(source, placed, from_rgb)
        how |= {"reduce": max(1, least // side)}
        how |= {"placed": placed} if kind == "cube" else {"from_rgb": from_rgb and kind != "spectral-depth scene"}
    return load_spectral_depth(source, wavelengths, **how)


def check_depth_scene(source: str, placed: str | None, from_rgb: bool) -> tuple[str, int]:
    """Kind and shorter side of a file or folder, in pixels.

    Raises:
        DataError: no scene, or one whose kind asks for ``placed`` or ``from_rgb``.
    """
    kind, least = _kind_and_side(source)
    if kind == "cube" and placed is None:
        raise DataError(source, "a cube without depth", "one with depth", "put it at drawn ones: --placed random")
    if kind == "RGB-D scene" and not from_rgb:
        remedy = "make them up of measured reflectances: --from-rgb"
        raise DataError(source, "an RGB picture with depth", "spectra and depth", remedy)
    return kind, least


def withheld_scene(sources: Sequence[str]) -> str | None:
    """The last scene from a file that has a depth of its own, where others are left to learn from; None without."""
    real = [name for name in sources if Path(name).exists() and _kind_and_side(name)[0] != "cube"]
    return real[-1] if len(real) > 1 else None


def _kind_and_side(source: str) -> tuple[str, int]:
    """What a scene is, and its shorter side in pixels."""
    if holds_rgbd(source):
        return "RGB-D scene", min(read_rgbd(source)["depth"].shape)
    parts = scene_parts(Path(source))
    with open_contents(parts[0] if parts else source) as contents:
        views = find_light_field(contents)
        if views is not None:
            return "light field", min(views.shape[views.dims.index(dim)] for dim in ("y", "x"))
        cube = locate_cube(contents)
        kind = "spectral-depth scene" if parts or "depth" in contents.arrays else "cube"
        return kind, min(n for axis, n in enumerate(cube.stored.shape) if axis != cube.axis)


def with_surroundings(scene: xr.Dataset, size: tuple[int, int], source: str, tile: int) -> xr.Dataset:
    """(H, W) pixels in the middle of a scene and up to ``SURROUNDINGS`` more on every side, whole tiles.

    Light from beside the middle falls into it, and windows beside it have a say in its depth. Where it is dark there,
    the blur of the rim tells depth.

    Raises:
        DataError: a scene smaller than the middle.
    """
    middle_of(scene, size, source)
    grown = [
        side + 2 * (min(SURROUNDINGS, (length - side) // 2) // tile * tile)
        for side, length in zip(size, (scene.sizes["y"], scene.sizes["x"]), strict=True)
    ]
    return middle_of(scene, (grown[0], grown[1]), source)
