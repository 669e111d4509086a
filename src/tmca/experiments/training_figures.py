"""Pictures of a training run: how it went, and the codes that came out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from tmca.cameras import SpectralDepthCamera
from tmca.decoders import Weights
from tmca.experiments.camera_figures import codes_figure
from tmca.experiments.figures import plain_axes, save_figure
from tmca.experiments.spectral_depth.figures import phase_codes_figure, psf_figure
from tmca.training.log import TrainingLog

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_LOSSES = {
    "l2": "mean squared error",
    "l1": "mean absolute error",
    "charbonnier": "mean Charbonnier error",
    "log": "mean log₁₀ of squared error",
}


def training_pictures(folder: Path) -> list[Path]:
    """Write ``curve.png`` and ``codes.png`` into a run's folder, in the place of earlier ones."""
    weights = Weights.load(folder / "weights.safetensors")
    depth = weights.kind == SpectralDepthCamera.kind
    loss = _LOSSES.get(weights.card.get("training", {}).get("optimiser", {}).get("loss", ""), "mean loss")
    drawings = {
        "curve": curve_figure(TrainingLog(folder / "log.csv").rows(), loss + (" and of depth" if depth else ""))
    }
    if depth:
        drawings |= {"codes": phase_codes_figure(weights.camera), "psf": psf_figure(weights.camera)}
    else:
        drawings["codes"] = codes_figure(weights.camera)
    return [save_figure(figure, folder / f"{name}.png", overwrite=True) for name, figure in drawings.items()]


def curve_figure(rows: list[dict[str, str]], loss: str = "mean loss") -> Figure:
    """Validation PSNR (each sensor), loss in words, and light throughput over the steps."""
    from matplotlib.figure import Figure

    steps = [int(row["step"]) for row in rows]
    sensors = [name for name in (rows[0] if rows else {}) if name.startswith("psnr_")]
    shown = [
        (["psnr", *sensors], "validation", "PSNR (dB)"),
        (["loss"], "training", loss),
        (["throughput", "transmittance", "duty"], "codes", "share"),
    ]
    if any(row.get("depth_mae") for row in rows):
        shown.insert(1, (["depth_mae"], "validation", "depth, mean absolute error (m)"))
    figure = Figure(figsize=(3.7 * len(shown), 3.2), layout="constrained")
    for axis, (names, title, unit) in zip(figure.subplots(1, len(shown)), shown, strict=True):
        for name in names:
            known = [(step, float(row[name])) for step, row in zip(steps, rows, strict=True) if row.get(name)]
            if known:
                axis.plot(*zip(*known, strict=True), "o-", markersize=3, label=_label(name))
        plain_axes(axis, title, "step", unit)
        axis.xaxis.get_major_locator().set_params(integer=True)
        if axis.lines and len(names) > 1:
            axis.legend(fontsize=8)
    return figure


def _label(name: str) -> str:
    if name == "psnr":
        return "mean over sensors"
    return f"sensor {int(name[5:]) + 1}" if name.startswith("psnr_") else name
