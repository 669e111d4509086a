"""What captures themselves say of their prototype: which way the mask lies, how far bands are displaced, and in which
order they follow."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from tmca.cameras import Snapshot, SpectralCamera
from tmca.decoders import admm_tv, default_weight
from tmca.experiments.real.merit import brightest_rows, foretelling_error, reprojection_error, withheld
from tmca.lab.registering import explained, fine_part, flattened

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
    return {way: float(np.mean(_shares(captures, one, offsets, black))) for way, one in ways.items()}


def _shares(captures: Sequence[Array], mask: Array, offsets: Sequence[int], black: float) -> list[float]:
    fine, found = fine_part(np.asarray(mask, dtype=np.float64)), []
    for capture in captures:
        flat = fine_part(flattened(capture, black))
        for top, left in blocks_with_light(capture, black):
            block = flat[top : top + _SIDE, left : left + _SIDE]
            found.append(explained(block, fine, top, left, offsets)[0])
    return found


def light_by_offset(captures: Sequence[Array], mask: Array, offsets: Sequence[int], black: float) -> Array:
    """(offsets,) mean weight of the mask's copies over all blocks, 1 at most: where on the sensor light of any band
    falls."""
    fine, total = fine_part(np.asarray(mask, dtype=np.float64)), np.zeros(len(offsets))
    for capture in captures:
        flat = fine_part(flattened(capture, black))
        for top, left in blocks_with_light(capture, black):
            block = flat[top : top + _SIDE, left : left + _SIDE]
            total += explained(block, fine, top, left, offsets)[1]
    return total / total.max()


def order_evidence(
    snapshot: Snapshot[SpectralCamera], rows: int = 200, iterations: int = 150
) -> dict[str, dict[str, float]]:
    """Errors of ADMM-TV with the response in the order of the wavelengths and in the opposite one.

    Both orders displace the same set of copies, so that a flat response could not tell them apart.
    """
    part, found = brightest_rows(snapshot, rows), {}
    for name, response in (("red far", part.camera.response), ("blue far", part.camera.response.flip(0))):
        found[name] = _errors(Snapshot(part.values, _with_response(part.camera, response)), iterations)
    return found


def _errors(snapshot: Snapshot[SpectralCamera], iterations: int) -> dict[str, float]:
    blind, hidden = withheld(snapshot)
    camera = snapshot.camera
    weight = default_weight(float(camera.noise.variance(snapshot.values).mean().sqrt()))
    found = admm_tv(
        blind.camera.operator(), blind.values, weight, joint=True, bounds=(0.0, np.inf), max_iterations=iterations
    )
    foretold = foretelling_error(camera.operator(), found.estimate, snapshot.values, hidden)
    return {
        "withheld": foretold,
        "reprojection": reprojection_error(blind.camera.operator(), found.estimate, blind.values),
    }


def _with_response(camera: SpectralCamera, response: torch.Tensor) -> SpectralCamera:
    aperture, shutter = camera.codes()
    return SpectralCamera(
        bands=camera.wavelengths, size=camera.size, slots=camera.slots, aperture=aperture, shutter=shutter,
        dispersion=camera.dispersion, response=response, sensor=camera.sensor,
    )  # fmt: skip


def geometry(
    captures: Sequence[Array], mask: Array, registered_mask: Array, bands: int, step: int, black: float
) -> dict[str, Any]:
    """Everything about mask and displacement that is said in the report."""
    offsets = range(0, bands * step, step)
    wide = list(range(-8, bands * step + 10, step))
    profile = light_by_offset(captures, registered_mask, wide, black)
    return {
        "explained": mask_evidence(captures, mask, offsets, black),
        "explained_registered": float(np.mean(_shares(captures, registered_mask, offsets, black))),
        "offsets": wide, "light": profile.tolist(),
    }  # fmt: skip
