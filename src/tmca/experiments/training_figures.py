"""Pictures of a training run: how it went, and the codes that came out."""

from __future__ import annotations

from pathlib import Path

from tmca.cameras import SpectralDepthCamera
from tmca.decoders import Weights
from tmca.experiments.camera_figures import codes_figure, phase_codes_figure, psf_figure
from tmca.plots.curves import training_figure
from tmca.plots.style import save_figure
from tmca.training.log import TrainingLog

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
        "curve": training_figure(TrainingLog(folder / "log.csv").rows(), loss + (" and of depth" if depth else ""))
    }
    if depth:
        drawings |= {"codes": phase_codes_figure(weights.camera), "psf": psf_figure(weights.camera)}
    else:
        drawings["codes"] = codes_figure(weights.camera)
    return [save_figure(figure, folder / f"{name}.png", overwrite=True) for name, figure in drawings.items()]
