"""From a capture of fringes to a depth map with its standard deviation and a mask of confidence."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tmca.data import label_depth
from tmca.errors import DataError, SettingError
from tmca.lab.structured_light.calibration import Calibration, check_size
from tmca.lab.structured_light.captures import Capture, check_light, check_order, lit_pixels
from tmca.lab.structured_light.confidence import REASONS, Why, by_company, by_frequencies, by_light, by_range
from tmca.lab.structured_light.fringes import FringePlan
from tmca.lab.structured_light.phase import Array, Phases, measure_phases
from tmca.lab.structured_light.triangulation import triangulate
from tmca.lab.structured_light.unwrap import Unwrapping, spatial_unwrap, temporal_unwrap

if TYPE_CHECKING:
    import xarray as xr

_IN_RANGE = 0.5
_BEHIND = 0.1
"""Share of the depths that may lie behind the camera. What it sees is in front; noise and fringes that are numbered
wrongly take few pixels there, a phase that runs the wrong way a quarter to half of them."""


def measure_depth(
    capture: Capture,
    plan: FringePlan,
    calibration: Calibration,
    *,
    unwrap: Unwrapping = "temporal",
    noise: float | None = None,
    near: float = 0.05,
    far: float = 20.0,
    neighbours: int = 6,
) -> xr.Dataset:
    """Metric depth of every camera pixel that fringes tell it of.

    A pixel is left out, and ``confidence`` says why, if it is saturated in a frame; dark (also in the projector's
    shadow: too noisy to number the fringes); if its frequencies disagree by more than 4 standard deviations; if its
    finest fringes are much weaker than those of other pixels (light of two surfaces in one pixel); out of range, or
    at the projector's edge; or alone: fewer than ``neighbours`` neighbours share its depth.

    Args:
        capture: the frames.
        plan: what was projected.
        calibration: of camera and projector, for frames and fringes of these sizes.
        unwrap: ``"temporal"`` over the frequencies, or ``"spatial"`` or ``"graph-cut"`` over neighbours.
        noise: standard deviation of a frame, digital numbers; estimated without it.
        near, far: metres of depth between which pixels count.
        neighbours: of eight that have to share a pixel's depth, from 0 to 8; 3 keeps the edges of surfaces.

    Returns:
        ``depth`` and ``depth_std`` (y, x), metres, NaN where left out; ``confidence`` (y, x), 0 for known and else
        the index of the reason in its attribute ``reasons``; ``position`` (y, x), projector pixel; ``modulation`` (y,
        x) of the finest fringes, digital numbers.

    Raises:
        SettingError: an impossible setting, or a calibration of another size.
        DataError: frames saturated, dark or in the wrong order, or a scene that is mostly out of range or partly behind
            the camera.
    """
    if not 0 < near < far:
        raise SettingError("near, far", f"{near:g} to {far:g} m", "0 < near < far")
    if noise is not None and not noise > 0:
        raise SettingError("noise", repr(noise), "a standard deviation above 0")
    if not 0 <= neighbours <= 8:
        raise SettingError("neighbours", str(neighbours), "0 to 8")
    check_size(calibration.camera, capture.values.shape[2:], capture.source, "frames")
    check_size(calibration.projector, plan.size, "fringes", "fringes")
    check_light(capture, plan)
    lit = lit_pixels(capture)
    phases = measure_phases(capture.values, noise)
    # rounding to whole numbers is noise too, and all of it where there is no other
    phases = phases if noise or phases.noise > capture.step / 4 else measure_phases(capture.values, _rounding(capture))
    check_order(capture, plan, phases, lit)
    why, absolute = _unwrapped(phases, capture, plan, unwrap)
    position = plan.position(absolute)
    std = phases.std[-1] * plan.extent / (2 * np.pi * plan.fringes[-1])
    depth, depth_std = triangulate(position, std, calibration, plan.across)
    found = by_range(why, depth, position, plan, (near, far))
    _check_range(why, found, capture, depth, (near, far))
    found = by_company(found, depth, depth_std, float(calibration.camera.matrix[0, 0]), neighbours)
    return _labelled(depth, depth_std, found, position, phases, capture).assign_attrs(unwrapping=unwrap)


def depth_error(measured: xr.Dataset, truth: xr.DataArray) -> dict[str, float]:
    """How far a measured depth map is from the true one, over the pixels that have both.

    Args:
        measured: of `measure_depth`.
        truth: (y, x), metres.

    Returns:
        ``rmse`` and ``largest`` error in metres, ``rmse_percent`` of the truth's range, and ``in_deviations``: the
        median error in its own standard deviations over that of a normal distribution, 1 if they are right.

    Raises:
        DataError: another size, or no pixel with both.
    """
    if truth.shape != measured["depth"].shape:
        found, wanted = ("×".join(map(str, size)) for size in (truth.shape, measured["depth"].shape))
        raise DataError(truth.attrs.get("source", "truth"), f"{found} pixels", f"{wanted} as were measured")
    error = measured["depth"].values.astype(np.float64) - truth.values
    both = np.isfinite(error)
    if not both.any():
        raise DataError(truth.attrs.get("source", "truth"), "no pixel with a measured and a true depth", "some")
    rmse, spread = float(np.sqrt(np.mean(error[both] ** 2))), float(np.nanmax(truth) - np.nanmin(truth))
    ratio = float(np.median(np.abs(error / measured["depth_std"].values)[both]) / 0.6745)
    percent = 100 * rmse / spread if spread else float("nan")
    return {"rmse": rmse, "largest": float(np.abs(error[both]).max()), "rmse_percent": percent, "in_deviations": ratio}


def _rounding(capture: Capture) -> float:
    return max(capture.step / np.sqrt(12), 1e-6 * float(np.ptp(capture.values)))


def _unwrapped(phases: Phases, capture: Capture, plan: FringePlan, unwrap: Unwrapping) -> tuple[Why, Array]:
    """Why pixels are left out so far, and the absolute phase."""
    why = by_light(phases, capture.saturated)
    if unwrap != "temporal":
        return why, spatial_unwrap(phases, plan.fringes, why == 0, unwrap)
    absolute, disagreement, risk = temporal_unwrap(phases, plan.fringes)
    return by_frequencies(why, disagreement, risk), absolute


def _check_range(why: Why, found: Why, capture: Capture, depth: Array, ends: tuple[float, float]) -> None:
    """Most of a scene out of range speaks of frames in reverse order or of another calibration."""
    told, outside = int((why == 0).sum()), int((found == REASONS.index("out of range")).sum())
    if not told:
        reasons = ", ".join(f"{int((why == i).sum())} {name}" for i, name in enumerate(REASONS) if (why == i).any())
        remedy = "give more light, project frequencies that are closer together, or put the frames in order"
        raise DataError(capture.source, f"no pixel with a depth ({reasons})", "some", remedy)
    behind = int((~np.isfinite(depth) & (why == 0)).sum())
    if behind > _BEHIND * told:
        found_text = f"{behind / told:.0%} of the depths behind the camera"
        remedy = "check that steps do not run backwards, that frames are not mirrored, and the calibration"
        raise DataError(capture.source, found_text, "a scene in front of it", remedy)
    if outside > _IN_RANGE * told:
        median = f" (median {np.nanmedian(depth):.3g} m)" if np.isfinite(depth).any() else ""
        remedy = "check the order of the frames and the calibration, or set near and far (--near, --far)"
        found_text = f"{outside / told:.0%} of the depths out of range{median}"
        raise DataError(capture.source, found_text, f"{ends[0]:g} to {ends[1]:g} m", remedy)


def _labelled(depth: Array, std: Array, why: Why, position: Array, phases: Phases, capture: Capture) -> xr.Dataset:
    import xarray as xr

    known = why == 0
    about = {"units": "m", "long_name": "standard deviation of the depth"}
    return xr.Dataset(
        {
            "depth": label_depth(np.where(known, depth, np.nan), capture.source),
            "depth_std": (("y", "x"), np.where(known, std, np.nan).astype(np.float32), about),
            "confidence": (("y", "x"), why, {"reasons": ", ".join(f"{i} {name}" for i, name in enumerate(REASONS))}),
            "position": (
                ("y", "x"),
                np.where(known, position, np.nan).astype(np.float32),
                {"units": "projector pixel"},
            ),
            "modulation": (("y", "x"), phases.modulation[-1].astype(np.float32), {"units": "digital number"}),
        },
        attrs={"source": str(capture.source), "noise": phases.noise, "metric": True},
    )
