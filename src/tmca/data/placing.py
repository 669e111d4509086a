"""Real spectral cubes at synthetic depths: the textures are measured, the distances drawn."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from tmca.data.depth_maps import label_depth
from tmca.data.fitted_depth import check_range
from tmca.data.rendering.depth import staged_depth
from tmca.data.rendering.metamers import smooth_field
from tmca.data.rendering.photographs import WHITE
from tmca.data.rendering.pictures import COARSE, generator, regions_of
from tmca.data.spectral_depth import label_spectral_depth
from tmca.errors import SettingError, ShapeError

if TYPE_CHECKING:
    import xarray as xr

Placing = Literal["plane", "slanted", "staged", "smooth", "pieces", "random"]
_PIECES = (3, 9)
Map = NDArray[np.float64]


def place_cube(cube: xr.DataArray, near: float, far: float, seed: int = 0, kind: Placing = "random") -> xr.Dataset:
    """Put a spectral cube at drawn depths from ``near`` to ``far``, evenly in inverse depth.

    Args:
        cube: ``(wavelength, y, x)``, as from `tmca.data.read`.
        near, far: metres.
        seed: draws the depths, together with the cube's name.
        kind: ``"plane"``: one depth everywhere; ``"slanted"``: a plane tilted in a drawn direction from ``far`` to
            ``near``; ``"staged"``: regions of the cube's own picture as tilted planes, the lower in the picture the
            nearer (see `staged_depth`); ``"smooth"``: smooth hills; ``"pieces"``: tilted planes with sharp, straight
            borders that know nothing of the picture; ``"random"``: one of the last two. All but ``"plane"`` reach both
            ends of the range; ``"smooth"`` has every inverse depth equally often.

    Returns:
        A dataset with ``radiance`` (the cube) and ``depth`` ``(y, x)``, float32 metres; attributes ``placed`` (the
        kind), ``placed_seed``, ``near`` and ``far``.

    Raises:
        ShapeError: not a cube.
        SettingError: an impossible range, seed or kind.
    """
    if cube.dims != ("wavelength", "y", "x"):
        raise ShapeError("cube", f"dims {cube.dims}", "(wavelength, y, x)")
    if kind not in get_args(Placing):
        raise SettingError("kind", repr(kind), f"one of {', '.join(get_args(Placing))}")
    check_range(near, far)
    # Two cubes under one seed shall not get the same depths, and a moved file the same ones as before.
    name = str(cube.attrs.get("name", Path(str(cube.attrs.get("source", ""))).stem))
    rng = generator(crc32(f"placed {name}".encode()), seed)
    if kind == "staged":
        picture = false_colours(cube)
        depth = staged_depth(picture, regions_of(picture, *COARSE), near, far, rng)
    else:
        nearness = drawn_nearness((cube.sizes["y"], cube.sizes["x"]), rng, kind)
        depth = (1 / (1 / far + nearness * (1 / near - 1 / far))).astype(np.float32)
    return _dataset(cube, depth, {"placed": kind, "placed_seed": seed, "near": float(near), "far": float(far)})


def drawn_nearness(shape: tuple[int, int], rng: np.random.Generator, kind: Placing = "random") -> Map:
    """(H, W) inverse depth as a share of the range, 0 = far, 1 = near; kinds of `place_cube` that need no picture.

    Raises:
        SettingError: another kind.
    """
    drawn: Placing = ("smooth", "pieces")[rng.integers(2)] if kind == "random" else kind
    if drawn not in _NEARNESS:
        raise SettingError("kind", repr(kind), f"one of {', '.join(_NEARNESS)}")
    return _NEARNESS[drawn](shape, rng)


def _dataset(cube: xr.DataArray, depth: NDArray[np.float32], about: dict[str, object]) -> xr.Dataset:
    kept = {key: cube.attrs[key] for key in ("name", "source") if key in cube.attrs}
    depths = label_depth(depth, "depth", {"depth_from": f"drawn: {about['placed']}"})
    return label_spectral_depth(cube.astype(np.float32), depths, {**kept, **about, "metric": True})


def false_colours(cube: xr.DataArray) -> NDArray[np.float32]:
    """``(H, W, 3)``: means over the long, middle and short thirds of the bands, their 99 % quantile at `WHITE`."""
    order = np.argsort(-cube["wavelength"].values, kind="stable")
    thirds = np.array_split(order, 3) if len(order) >= 3 else [order] * 3
    picture = np.stack([cube.values[third].mean(axis=0) for third in thirds], axis=-1)
    top = float(np.quantile(picture, 0.99))
    return (WHITE * np.clip(picture / (top if top > 0 else 1.0), 0, 1)).astype(np.float32)


def _plane(shape: tuple[int, int], rng: np.random.Generator) -> Map:
    return np.full(shape, rng.random())


def _slanted(shape: tuple[int, int], rng: np.random.Generator) -> Map:
    return _ramp(shape, rng.uniform(-np.pi, np.pi))


def _ramp(shape: tuple[int, int], angle: float) -> Map:
    """A plane in space: inverse depth is linear in the picture."""
    y, x = (axis - (n - 1) / 2 for axis, n in zip(np.mgrid[: shape[0], : shape[1]], shape, strict=True))
    return _stretched(np.sin(angle) * y + np.cos(angle) * x)


def _stretched(values: Map) -> Map:
    extent = np.ptp(values)
    return (values - values.min()) / extent if extent > 0 else np.full(values.shape, 0.5)


def _smooth(shape: tuple[int, int], rng: np.random.Generator) -> Map:
    """Hills, ranked so that every level is there equally often."""
    rank = smooth_field(shape, rng).ravel().argsort(kind="stable").argsort(kind="stable")
    return (rank / max(1, rank.size - 1)).reshape(shape)


def _pieces(shape: tuple[int, int], rng: np.random.Generator) -> Map:
    """Tilted planes in the cells of random points; their levels are even, one in each step of the range."""
    count = int(rng.integers(*_PIECES))
    y, x = (axis / max(shape) for axis in np.mgrid[: shape[0], : shape[1]])
    points = rng.random((count, 2)) * shape / max(shape)
    away = (y[..., None] - points[:, 0]) ** 2 + (x[..., None] - points[:, 1]) ** 2
    cell = away.argmin(axis=-1)
    level = (rng.permutation(count) + rng.random(count)) / count
    tilt = rng.normal(0, 0.3, (count, 2))
    return _stretched(level[cell] + tilt[cell, 0] * (y - points[cell, 0]) + tilt[cell, 1] * (x - points[cell, 1]))


_NEARNESS: dict[str, Callable[[tuple[int, int], np.random.Generator], Map]] = {
    "plane": _plane,
    "slanted": _slanted,
    "smooth": _smooth,
    "pieces": _pieces,
}
