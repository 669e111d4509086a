"""Surfaces of a rendered light field: where each lies in disparity, what it covers, and how a view meets it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Fields = tuple[Array, Array]

_STEPS = 4
"""Of the iteration for waves: each leaves a share ``(|v|+|u|)·slope of the waves`` of the error."""
_MARGIN = 1.0
"""Pixels around where a surface can be seen, more than the iteration errs."""
_AT_ONCE = 1 << 16
"""Points that are rendered at once: they stay in the processor's cache."""
STEEPEST = 0.04
"""Largest change of disparity per px over a surface; by waves at most half of it."""


@dataclass(frozen=True)
class Relief:
    """Disparity of a surface at centre-view position (y, x) in px: a plane with waves on it.

    Args:
        level: px per view step at ``middle``.
        slope: change per px along y and x.
        waves: ``(N, 4)``: amplitude, angular frequency along y and x (per px), phase.
        middle: (y, x) in px.
    """

    level: float
    slope: tuple[float, float] = (0.0, 0.0)
    waves: NDArray[np.float64] | None = None
    middle: tuple[float, float] = (0.0, 0.0)

    def __call__(self, y: Array, x: Array) -> Array:
        """Disparity at every (y, x)."""
        down, right = y - self.middle[0], x - self.middle[1]
        disparity = self.level + self.slope[0] * down + self.slope[1] * right
        for amplitude, fy, fx, phase in () if self.waves is None else self.waves:
            # Single precision is exact to a millionth of the amplitude, and several times faster
            disparity = disparity + amplitude * np.sin((fy * down + fx * right + phase).astype(np.float32))
        return disparity

    def seen_from(self, v: float, u: float, y: Array, x: Array) -> Fields:
        """Centre-view positions of what view (v, u) shows at (y, x): ``Y - v·d(Y, X) = y``, ``X - u·d(Y, X) = x``.

        In closed form for a plane; waves are brought in by iteration, which converges as ``(|v|+|u|)·STEEPEST`` is
        below 1: a surface so flat hides no part of itself from any view.
        """
        share = 1 - v * self.slope[0] - u * self.slope[1]
        plane = self.level + self.slope[0] * (y - self.middle[0]) + self.slope[1] * (x - self.middle[1])
        disparity = plane / share
        for _ in range(0 if self.waves is None else _STEPS):
            disparity = disparity - (disparity - self(y + v * disparity, x + u * disparity)) / share
        return y + v * disparity, x + u * disparity

    def between(self, corners: Array) -> tuple[float, float]:
        """Least and largest disparity among centre-view positions whose convex hull has these ``(2, N)`` corners."""
        waves = 0.0 if self.waves is None else float(np.abs(self.waves[:, 0]).sum())
        plane = Relief(self.level, self.slope, middle=self.middle)(*corners)
        return float(plane.min()) - waves, float(plane.max()) + waves


@dataclass(frozen=True)
class Laid:
    """Samples laid over the centre view by a similarity.

    Args:
        samples: ``(..., h, w)``.
        turn: ``(2, 2)`` from px of the centre view to samples.
        origin: (y, x) in the samples of the centre view's (0, 0).
    """

    samples: NDArray[np.float32]
    turn: Array
    origin: tuple[float, float]

    def at(self, y: Array, x: Array) -> Array:
        """``(2, N)`` places in the samples of N positions (y, x)."""
        return np.stack([self.turn[i, 0] * y + self.turn[i, 1] * x + self.origin[i] for i in (0, 1)])


class Texture(Laid):
    """A photograph's cubic spline coefficients ``(C, h, w)``, mirrored beyond its edges."""

    def __call__(self, y: Array, x: Array) -> NDArray[np.float32]:
        """``(C, N)`` values at the N positions (y, x)."""
        from scipy.ndimage import map_coordinates

        at = self.at(y, x)
        return np.stack([map_coordinates(c, at, order=3, mode="mirror", prefilter=False) for c in self.samples])


class Outline(Laid):
    """What a surface covers: where a smooth field ``(h, w)``, negative at its own borders, is above 0."""

    def __call__(self, y: Array, x: Array) -> NDArray[np.bool_]:
        """Whether each (y, x) is covered."""
        from scipy.ndimage import map_coordinates

        at = self.at(y, x)
        covered = np.all([(a >= 0) & (a <= n - 1) for a, n in zip(at, self.samples.shape, strict=True)], axis=0)
        covered[covered] = map_coordinates(self.samples, at[:, covered], order=1) > 0
        return np.asarray(covered)

    @property
    def corners(self) -> Array:
        """``(2, 4)`` centre-view positions between which all of it lies."""
        bottom, right = (n - 1 for n in self.samples.shape)
        at = np.array([[0.0, 0.0, bottom, bottom], [0.0, right, 0.0, right]])
        return np.linalg.solve(self.turn, at - np.array(self.origin)[:, None])


@dataclass(frozen=True)
class Surface:
    """One opaque, Lambertian layer; without an outline it covers everything and goes on behind all others."""

    relief: Relief
    texture: Texture
    outline: Outline | None = None

    def near(self, v: float, u: float, rows: Array, columns: Array) -> tuple[slice, slice]:
        """Rows and columns of a grid of view (v, u), both ascending, within which it can be seen."""
        if self.outline is None:
            return slice(None), slice(None)
        corners = self.outline.corners
        disparities = np.array(self.relief.between(corners))
        return _within(rows, corners[0], v * disparities), _within(columns, corners[1], u * disparities)


def _within(places: Array, of: Array, away: Array) -> slice:
    """Which of ascending places lie where ``of`` is seen from a view that moves it by ``away``."""
    low, high = of.min() - away.max() - _MARGIN, of.max() - away.min() + _MARGIN
    return slice(int(np.searchsorted(places, low)), int(np.searchsorted(places, high, side="right")))


def render_view(
    surfaces: list[Surface], v: float, u: float, size: tuple[int, int], samples: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """One view ``(C, H, W)`` and the disparity ``(H, W)`` of what its pixels' centres show.

    Every pixel is the mean of ``samples × samples`` points; each point is looked up in the nearest surface that covers
    it, at its exact position on that surface. Nothing is smeared or filled in: what a view sees behind an edge is the
    farther surface's own texture.

    Args:
        surfaces: in any order; the first covers everything.
        v: view row from the centre.
        u: view column from the centre.
        size: (H, W).
        samples: odd, so that one point is the pixel's centre.
    """
    offsets = (np.arange(samples) + 0.5) / samples - 0.5
    rows, columns = ((np.arange(n)[:, None] + offsets).ravel() for n in size)
    height = samples * max(1, _AT_ONCE // (samples * len(columns)))
    bands = np.split(rows, range(height, len(rows), height))
    parts = [_render_rows(surfaces, v, u, band, columns, samples) for band in bands]
    return np.concatenate([view for view, _ in parts], axis=1), np.concatenate([shown for _, shown in parts])


def _render_rows(
    surfaces: list[Surface], v: float, u: float, rows: Array, columns: Array, samples: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Pixels and disparity of some rows of a view's points."""
    y, x, owner, disparity = _nearest(surfaces, v, u, rows, columns)
    channels, (height, width) = len(surfaces[0].texture.samples), owner.shape
    values = np.empty((channels, height, width), dtype=np.float32)
    for number in np.unique(owner):
        shown = owner == number
        values[:, shown] = surfaces[number].texture(y[shown], x[shown])
    pixels = values.reshape(channels, height // samples, samples, width // samples, samples)
    middle = samples // 2
    centres = disparity[middle::samples, middle::samples].astype(np.float32)
    return np.asarray(pixels.mean(axis=(2, 4), dtype=np.float32)), centres


def _nearest(
    surfaces: list[Surface], v: float, u: float, rows: Array, columns: Array
) -> tuple[Array, Array, NDArray[np.intp], Array]:
    """Of every point of a grid of a view: its centre-view position (y, x) on the nearest surface there, which surface
    that is, and its disparity (a depth buffer, so surfaces may also cut through one another)."""
    y, x = np.empty((2, rows.size, columns.size))
    owner, disparity = np.zeros(y.shape, dtype=np.intp), np.full(y.shape, -np.inf)
    for number, surface in enumerate(surfaces):
        near = surface.near(v, u, rows, columns)
        place = surface.relief.seen_from(v, u, rows[near[0], None], columns[None, near[1]])
        depth = surface.relief(*place)
        hit = depth > disparity[near]
        if surface.outline is not None:
            hit[hit] = surface.outline(place[0][hit], place[1][hit])
        owner[near][hit] = number
        for whole, part in ((y, place[0]), (x, place[1]), (disparity, depth)):
            np.copyto(whole[near], part, where=hit)
    return y, x, owner, disparity


_GRID = 65
_BLUR = 1.5
_SMALLEST, _LARGEST = 0.005, 0.25
"""Share of the photograph that a region may cover to serve as a silhouette."""


def silhouettes(labels: NDArray[np.intp]) -> list[NDArray[np.float32]]:
    """Fields of the photograph's own regions, positive inside, smoothed against the steps of its pixels.

    Regions that touch the border are left out: they are cut by the picture and not by an object.
    """
    from scipy.ndimage import find_objects, gaussian_filter

    area = np.bincount(labels.ravel()) / labels.size
    edge = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    fields = []
    for number, place in enumerate(find_objects(labels + 1)):
        if place is not None and _SMALLEST < area[number] < _LARGEST and number not in edge:
            mask = np.pad((labels[place] == number).astype(np.float32), 6)
            fields.append(np.asarray(gaussian_filter(mask, _BLUR) - 0.5, dtype=np.float32))
    return fields


def drawn(rng: np.random.Generator) -> NDArray[np.float32]:
    """A field of an ellipse, a card, a bar or a lobed blob within a square, positive inside."""
    y, x = np.mgrid[-1.15 : 1.15 : _GRID * 1j, -1.15 : 1.15 : _GRID * 1j]
    kind = rng.choice(["ellipse", "card", "bar", "blob"])
    narrow = rng.uniform(0.45, 1.0)
    if kind == "ellipse":
        field = 1 - np.hypot(x, y / narrow)
    elif kind == "card":
        field = 1 - np.maximum(abs(x), abs(y) / narrow)
    elif kind == "bar":
        field = 1 - np.maximum(abs(x), abs(y) / (0.2 * narrow))
    else:
        angle = np.arctan2(y, x)
        size, phase = rng.uniform(0.02, 0.12, 3), rng.uniform(0, 6, 3)
        lobes = [size[i] * np.cos(count * angle + phase[i]) for i, count in enumerate((2, 3, 5))]
        field = 0.75 + sum(lobes) - np.hypot(x, y)
    return np.asarray(field, dtype=np.float32)


def placed(
    field: NDArray[np.float32], extent: float, centre: tuple[float, float], rng: np.random.Generator, upright: bool
) -> Outline:
    """A field laid over the centre view at ``centre`` (y, x), ``extent`` px across on its longer side.

    Args:
        field: from `silhouettes` or `drawn`.
        extent: px of the centre view.
        centre: px of the centre view.
        rng: draws the turn and the mirroring.
        upright: turn it by no more than a few degrees.
    """
    turn = similarity(max(field.shape) / extent, rng, 0.3 if upright else np.pi)
    middle = turn @ np.array(centre)
    origin = (float((field.shape[0] - 1) / 2 - middle[0]), float((field.shape[1] - 1) / 2 - middle[1]))
    return Outline(field, turn, origin)


def similarity(scale: float, rng: np.random.Generator, most: float) -> Array:
    """``(2, 2)``: a turn by at most ``most`` radians, perhaps mirrored, times ``scale``."""
    angle, mirrored = rng.uniform(-most, most), rng.random() < 0.5
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return scale * turn @ np.diag([1.0, -1.0 if mirrored else 1.0])
