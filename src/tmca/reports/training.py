"""Pictures of a training run: how it went, and the codes that came out."""

from __future__ import annotations

from pathlib import Path

from tmca.applications import application_of
from tmca.decoders import Weights
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
    """Write ``curve.png``, ``codes.png`` and the camera's other pictures into a run's folder, in the place of earlier
    ones."""
    weights = Weights.load(folder / "weights.safetensors")
    application = application_of(weights.kind)
    loss = _LOSSES.get(weights.card.get("training", {}).get("optimiser", {}).get("loss", ""), "mean loss")
    loss += " and of depth" if "depth_mae" in {name for name, *_ in application.columns} else ""
    curve = training_figure(TrainingLog(folder / "log.csv").rows(), loss)
    drawings = {"curve": curve, **application.code_figures(weights.camera)}
    return [save_figure(figure, folder / f"{name}.png", overwrite=True) for name, figure in drawings.items()]
