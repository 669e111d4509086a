"""From a capture of fringes to a depth map with its standard deviation and a mask of confidence."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tmca.data import label_depth
from tmca.errors import DataError, SettingError, check_range
from tmca.lab.frames import check_size
from tmca.lab.ground_truth.fringes import Capture, FringePlan
from tmca.lab.ground_truth.geometry import ProjectorCalibration, triangulate
from tmca.lab.ground_truth.phase import Array, Phases, Unwrapping, measure_phases, spatial_unwrap, temporal_unwrap
from tmca.lab.quality import quality_of

if TYPE_CHECKING:
    import xarray as xr


REASONS = ("known", "saturated", "dark", "frequencies disagree", "mixed light", "out of range", "alone")
"""What ``confidence`` says of a pixel, by its number."""
Why = NDArray[np.uint8]
_DARKEST, _RISK = 0.35, np.pi / 4
"""Radians: a phase less certain than the first is dark; a fringe's number is sure where the phase that the coarser
fringes predict is known to the second, four times within half a turn."""
_MIXED = 0.6
"""Modulation of the finest fringes, relative to the coarsest and to the usual of all pixels, that edges fall below."""
_DISAGREE = 4.0
_MARGIN = 0.25
"""Finest fringes at either end of the projector that are left out: noise takes them to the other end."""
_STEEP = 4.0


def _leave_out(why: Why, where: NDArray[np.bool_], reason: str) -> None:
    """Give pixels (H, W) that have none yet a reason of `REASONS`."""
    why[where & (why == 0)] = REASONS.index(reason)


def _mixed_light(phases: Phases, dark: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Where the finest of several fringes are weak: light of two surfaces adds up to weaker ones."""
    share = phases.modulation[-1] / np.maximum(phases.modulation[0], np.finfo(float).tiny)
    usual = np.median(share[~dark]) if not dark.all() else 1.0
    return np.asarray(share < _MIXED * usual) if len(phases.modulation) > 1 else np.zeros(dark.shape, dtype=bool)


def _in_range(depth: Array, position: Array, plan: FringePlan, ends: tuple[float, float]) -> NDArray[np.bool_]:
    """Where a depth is in range, and lit by other fringes than those at the projector's ends."""
    margin = _MARGIN * plan.extent / plan.fringes[-1]
    with np.errstate(invalid="ignore"):
        inside = (depth >= ends[0]) & (depth <= ends[1])
        return np.asarray(inside & (position > margin) & (position < plan.extent - 1 - margin))


def _company(depth: Array, std: Array, focal: float) -> NDArray[np.int_]:
    """How many of a pixel's eight neighbours share its depth, metres; NaN shares none. The focal length is in pixels.

    A pixel that sees two surfaces, or one half in shadow, has a wrong depth, and so may the two beside it along the
    edge. Neighbours share a depth if a surface less steep than 76° can join them, noise apart.
    """
    doubt = 4 * np.sqrt(2) * std
    padded = np.pad(depth, 1, mode="edge")  # the picture's border is no edge of a surface
    company, (height, width) = np.zeros(depth.shape, dtype=int), depth.shape
    for dy, dx in ((y, x) for y in (-1, 0, 1) for x in (-1, 0, 1) if y or x):
        other = padded[1 + dy : 1 + dy + height, 1 + dx : 1 + dx + width]
        reach = np.hypot(dy, dx) * _STEEP * depth / focal + doubt
        with np.errstate(invalid="ignore"):
            company += np.abs(other - depth) <= reach
    return company


_USUAL = 0.125
"""Share of the variation over the steps that is no cosine: a projector's gamma of 2.2 leaves 0.08, of 2.6 0.11."""


def measure_depth(
    capture: Capture,
    plan: FringePlan,
    calibration: ProjectorCalibration,
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
        x) of the finest fringes, digital numbers. Attributes hold ``no_cosine``, the share of the variation over the
        steps that is none, of the worst frequency, and its ``quality``: it over what good captures leave, with a
        warning above 1.

    Raises:
        SettingError: an impossible setting.
        DataError: a calibration of another size, or no pixel with a depth.
    """
    if not 0 < near < far:
        raise SettingError("near, far", f"{near:g} to {far:g} m", "0 < near < far")
    if noise is not None:
        check_range("noise", noise, above=0)
    check_range("neighbours", neighbours, 0, 8, whole=True)
    check_size(capture.source, "frames", capture.values.shape[2:], calibration.camera.size, "calibrate at that size")
    check_size("fringes", "a projector", plan.size, calibration.projector.size, "calibrate at that size")
    phases = _phases(capture, noise)
    why, absolute = _unwrapped(phases, capture, plan, unwrap)
    position = plan.position(absolute)
    std = phases.std[-1] * plan.extent / (2 * np.pi * plan.fringes[-1])
    depth, depth_std = triangulate(position, std, calibration, plan.across)
    lit = np.isin(why, (0, REASONS.index("frequencies disagree")))
    residual = float(np.median(phases.misfit[:, lit], axis=1).max()) if lit.any() else 0.0
    _leave_out(why, ~_in_range(depth, position, plan, (near, far)), "out of range")
    _check_some(why, capture)
    company = _company(np.where(why == 0, depth, np.nan), depth_std, float(calibration.camera.matrix[0, 0]))
    _leave_out(why, company < neighbours, "alone")
    quality = quality_of(capture.source, "no cosine over the steps:", residual, _USUAL)
    about = {"unwrapping": unwrap, "quality": quality, "no_cosine": residual}
    return _labelled(depth, depth_std, why, position, phases, capture).assign_attrs(about)


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
    where = truth.attrs.get("source", "truth")
    check_size(where, "a truth", truth.shape, measured["depth"].shape)
    error = measured["depth"].values.astype(np.float64) - truth.values
    both = np.isfinite(error)
    if not both.any():
        raise DataError(where, "no pixel with a measured and a true depth", "some")
    rmse, spread = float(np.sqrt(np.mean(error[both] ** 2))), float(np.nanmax(truth) - np.nanmin(truth))
    ratio = float(np.median(np.abs(error / measured["depth_std"].values)[both]) / 0.6745)
    percent = 100 * rmse / spread if spread else float("nan")
    return {"rmse": rmse, "largest": float(np.abs(error[both]).max()), "rmse_percent": percent, "in_deviations": ratio}


def _phases(capture: Capture, noise: float | None) -> Phases:
    """Phases of the fringes; rounding to whole numbers is noise too, and all of it where there is no other."""
    phases = measure_phases(capture.values, noise)
    if not noise and phases.noise <= capture.step / 4:
        rounding = max(capture.step / np.sqrt(12), 1e-6 * float(np.ptp(capture.values)))
        phases = measure_phases(capture.values, rounding)
    return phases


def _unwrapped(phases: Phases, capture: Capture, plan: FringePlan, unwrap: Unwrapping) -> tuple[Why, Array]:
    """Why pixels are left out so far, and the absolute phase."""
    why, dark = np.zeros(capture.saturated.shape, dtype=np.uint8), phases.std > _DARKEST
    _leave_out(why, capture.saturated, "saturated")
    _leave_out(why, dark[-1] | dark[0], "dark")
    _leave_out(why, _mixed_light(phases, np.asarray(dark.any(axis=0))), "mixed light")
    if unwrap != "temporal":
        return why, spatial_unwrap(phases, plan.fringes, why == 0, unwrap)
    absolute, disagreement, risk = temporal_unwrap(phases, plan.fringes)
    _leave_out(why, ~(risk <= _RISK), "dark")
    _leave_out(why, disagreement > _DISAGREE, "frequencies disagree")
    return why, absolute


def _check_some(why: Why, capture: Capture) -> None:
    """Raises DataError where no pixel has a depth."""
    if not (why == 0).any():
        counts = [f"{int((why == i).sum())} {name}" for i, name in enumerate(REASONS) if (why == i).any()]
        remedy = "check the light, the order of the frames, the calibration, and near and far (--near, --far)"
        raise DataError(capture.source, f"no pixel with a depth ({', '.join(counts)})", "some", remedy)


def _labelled(depth: Array, std: Array, why: Why, position: Array, phases: Phases, capture: Capture) -> xr.Dataset:
    import xarray as xr

    plane, known, about = ("y", "x"), why == 0, {"units": "m", "long_name": "standard deviation of the depth"}
    reasons = ", ".join(f"{i} {name}" for i, name in enumerate(REASONS))
    column = {"units": "projector pixel", "long_name": "column of the projector that a pixel sees"}
    contrast = {"units": "digital number", "long_name": "modulation of the finest fringes"}
    parts = {
        "depth": label_depth(np.where(known, depth, np.nan), capture.source),
        "depth_std": (plane, np.where(known, std, np.nan).astype(np.float32), about),
        "confidence": (plane, why, {"long_name": "why depth is unknown", "reasons": reasons}),
        "position": (plane, np.where(known, position, np.nan).astype(np.float32), column),
        "modulation": (plane, phases.modulation[-1].astype(np.float32), contrast),
    }
    return xr.Dataset(parts, attrs={"source": str(capture.source), "noise": phases.noise, "metric": True})
