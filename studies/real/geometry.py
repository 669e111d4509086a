"""What captures themselves say of their prototype: which way the mask lies, how far bands are displaced, and in which
order they follow."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from studies.bench import explained, fine_part, flattened
from studies.real.merit import brightest_rows, prediction_error, reprojection_error, withheld
from studies.real.records import OrderErrors
from tmca.cameras import Snapshot, SpectralCamera
from tmca.decoders import admm_tv, default_weight

Array = NDArray[np.floating]
_SIDE = 72


def blocks_with_light(capture: Array, black: float, side: int = _SIDE) -> list[tuple[int, int]]:
    """Corners of the blocks, side by side, whose median is above a tenth of the capture's brightest."""
    light = capture - black
    level = 0.1 * float(np.quantile(light, 0.99))
    corners = [
        (top, left)
        for top in range(0, light.shape[0] - side + 1, side)
        for left in range(0, light.shape[1] - side + 1, side)
    ]
    return [(y, x) for y, x in corners if np.median(light[y : y + side, x : x + side]) > level]


def mask_evidence(captures: Sequence[Array], mask: Array, offsets: Sequence[int], black: float) -> dict[str, float]:
    """Mean share of the captures' fine structure that displaced copies of the mask explain, by how the mask lies."""
    ways = {"as it is": mask, "mirrored in x": mask[:, ::-1], "mirrored in y": mask[::-1], "turned": mask[::-1, ::-1]}
    return {way: explained_share(captures, one, offsets, black) for way, one in ways.items()}


def explained_share(captures: Sequence[Array], mask: Array, offsets: Sequence[int], black: float) -> float:
    """Mean share of the captures' fine structure that displaced copies of a mask explain."""
    return float(np.mean([share for share, _ in _regressions(captures, mask, offsets, black)]))


def light_by_offset(captures: Sequence[Array], mask: Array, offsets: Sequence[int], black: float) -> Array:
    """(offsets,) mean weight of the mask's copies over all blocks, 1 at most: where on the sensor light of any band
    falls."""
    total = np.sum([weights for _, weights in _regressions(captures, mask, offsets, black)], axis=0)
    light: Array = total / total.max()
    return light


def _regressions(
    captures: Sequence[Array], mask: Array, offsets: Sequence[int], black: float
) -> Iterator[tuple[float, Array]]:
    """Explained share and weights of the mask's displaced copies in every block with light."""
    fine = fine_part(np.asarray(mask, dtype=np.float64))
    for capture in captures:
        flat = fine_part(flattened(capture, black))
        for top, left in blocks_with_light(capture, black):
            yield explained(flat[top : top + _SIDE, left : left + _SIDE], fine, top, left, offsets)


def order_evidence(
    snapshot: Snapshot[SpectralCamera], rows: int = 200, iterations: int = 150
) -> dict[str, OrderErrors]:
    """Errors of ADMM-TV with the response in the order of the wavelengths and in the opposite one.

    Both orders displace the same set of copies, so that a flat response could not tell them apart.
    """
    part = brightest_rows(snapshot, rows)
    orders = {"red far": part.camera.response, "blue far": part.camera.response.flip(0)}
    return {
        name: _errors(Snapshot(part.values, part.camera.replace(response=response)), iterations)
        for name, response in orders.items()
    }


def _errors(snapshot: Snapshot[SpectralCamera], iterations: int) -> OrderErrors:
    (blind, hidden), camera = withheld(snapshot), snapshot.camera
    weight = default_weight(float(camera.noise.variance(snapshot.values).mean().sqrt()))
    shown = blind.camera.operator()
    found = admm_tv(shown, blind.values, weight, joint=True, bounds=(0.0, np.inf), max_iterations=iterations)
    return {
        "withheld": prediction_error(camera.operator(), found.estimate, snapshot.values, hidden),
        "reprojection": reprojection_error(shown, found.estimate, blind.values),
    }
