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
    from matplotlib.figure import Figure


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


def by_light(phases: Phases, saturated: NDArray[np.bool_]) -> Why:
    """Saturated, dark and mixed pixels ``(H, W)``, as numbers of `REASONS`.

    Light of two surfaces with different phases adds up to weaker fringes, the finer the weaker.
    """
    why = np.zeros(saturated.shape, dtype=np.uint8)
    dark = phases.std > _DARKEST
    if len(phases.modulation) > 1:
        share = phases.modulation[-1] / np.maximum(phases.modulation[0], np.finfo(float).tiny)
        clear = ~dark.any(axis=0)
        why[share < _MIXED * (np.median(share[clear]) if clear.any() else 1.0)] = REASONS.index("mixed light")
    why[dark[-1] | dark[0]] = REASONS.index("dark")
    why[saturated] = REASONS.index("saturated")
    return why


def by_frequencies(why: Why, disagreement: Array, risk: Array) -> Why:
    """Adds pixels whose frequencies tell different phases, or are too noisy to number the fringes."""
    updated = why.copy()
    updated[(why == 0) & (disagreement > _DISAGREE)] = REASONS.index("frequencies disagree")
    updated[(why == 0) & ~(risk <= _RISK)] = REASONS.index("dark")
    return updated


def by_range(why: Why, depth: Array, position: Array, plan: FringePlan, ends: tuple[float, float]) -> Why:
    """Adds pixels out of range, and those lit by the ends of the fringes."""
    margin, updated = _MARGIN * plan.extent / plan.fringes[-1], why.copy()
    with np.errstate(invalid="ignore"):
        inside = (depth >= ends[0]) & (depth <= ends[1])
        inside &= (position > margin) & (position < plan.extent - 1 - margin)
    updated[(why == 0) & ~inside] = REASONS.index("out of range")
    return updated


def by_company(why: Why, depth: Array, std: Array, focal: float, fewest: int = 6) -> Why:
    """Adds pixels whose depth fewer than ``fewest`` of their eight neighbours share.

    A pixel that sees two surfaces, or one half in shadow, has a wrong depth, and so may the two beside it along the
    edge. Neighbours share a depth if a surface less steep than 76° can join them, noise apart.

    Args:
        why: so far.
        depth: metres.
        std: of the depth.
        focal: of the camera in pixels.
        fewest: 6 takes away one pixel along straight edges, 3 keeps corners.
    """
    valid = why == 0
    values, doubt = np.where(valid, depth, np.nan), 4 * np.sqrt(2) * np.where(valid, std, 0.0)
    padded = np.pad(values, 1, mode="edge")  # the picture's border is no edge of a surface
    company, (height, width) = np.zeros(depth.shape, dtype=int), depth.shape
    for dy, dx in ((y, x) for y in (-1, 0, 1) for x in (-1, 0, 1) if y or x):
        other = padded[1 + dy : 1 + dy + height, 1 + dx : 1 + dx + width]
        reach = np.hypot(dy, dx) * _STEEP * values / focal + doubt
        with np.errstate(invalid="ignore"):
            company += np.abs(other - values) <= reach
    updated = why.copy()
    updated[valid & (company < fewest)] = REASONS.index("alone")
    return updated


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
    phases = measure_phases(capture.values, noise)
    if not noise and phases.noise <= capture.step / 4:
        # rounding to whole numbers is noise too, and all of it where there is no other
        rounding = max(capture.step / np.sqrt(12), 1e-6 * float(np.ptp(capture.values)))
        phases = measure_phases(capture.values, rounding)
    why, absolute = _unwrapped(phases, capture, plan, unwrap)
    position = plan.position(absolute)
    std = phases.std[-1] * plan.extent / (2 * np.pi * plan.fringes[-1])
    depth, depth_std = triangulate(position, std, calibration, plan.across)
    reasons = by_range(why, depth, position, plan, (near, far))
    lit = np.isin(why, (0, REASONS.index("frequencies disagree")))
    residual = float(np.median(phases.misfit[:, lit], axis=1).max()) if lit.any() else 0.0
    _check_some(reasons, capture)
    reasons = by_company(reasons, depth, depth_std, float(calibration.camera.matrix[0, 0]), neighbours)
    quality = quality_of(capture.source, "no cosine over the steps:", residual, _USUAL)
    about = {"unwrapping": unwrap, "quality": quality, "no_cosine": residual}
    return _labelled(depth, depth_std, reasons, position, phases, capture).assign_attrs(about)


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


def _unwrapped(phases: Phases, capture: Capture, plan: FringePlan, unwrap: Unwrapping) -> tuple[Why, Array]:
    """Why pixels are left out so far, and the absolute phase."""
    why = by_light(phases, capture.saturated)
    if unwrap != "temporal":
        return why, spatial_unwrap(phases, plan.fringes, why == 0, unwrap)
    absolute, disagreement, risk = temporal_unwrap(phases, plan.fringes)
    return by_frequencies(why, disagreement, risk), absolute


def _check_some(why: Why, capture: Capture) -> None:
    """Raises DataError where no pixel has a depth."""
    if not (why == 0).any():
        counts = [f"{int((why == i).sum())} {name}" for i, name in enumerate(REASONS) if (why == i).any()]
        remedy = "check the light, the order of the frames, the calibration, and near and far (--near, --far)"
        raise DataError(capture.source, f"no pixel with a depth ({', '.join(counts)})", "some", remedy)


def _labelled(depth: Array, std: Array, why: Why, position: Array, phases: Phases, capture: Capture) -> xr.Dataset:
    import xarray as xr

    valid = why == 0
    about = {"units": "m", "long_name": "standard deviation of the depth"}
    return xr.Dataset(
        {
            "depth": label_depth(np.where(valid, depth, np.nan), capture.source),
            "depth_std": (("y", "x"), np.where(valid, std, np.nan).astype(np.float32), about),
            "confidence": (("y", "x"), why, {"reasons": ", ".join(f"{i} {name}" for i, name in enumerate(REASONS))}),
            "position": (
                ("y", "x"),
                np.where(valid, position, np.nan).astype(np.float32),
                {"units": "projector pixel"},
            ),
            "modulation": (("y", "x"), phases.modulation[-1].astype(np.float32), {"units": "digital number"}),
        },
        attrs={"source": str(capture.source), "noise": phases.noise, "metric": True},
    )


def depth_figure(measured: xr.Dataset, title: str) -> Figure:
    """Depth, its standard deviation, and why pixels have none, of `measure_depth`'s result."""
    from tmca.plots.lab import measured_depth_figure

    depth, deviation, reason = (measured[name].values for name in ("depth", "depth_std", "confidence"))
    return measured_depth_figure(depth, deviation, reason, REASONS, title)
