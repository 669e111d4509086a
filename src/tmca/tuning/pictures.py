"""A capture that was held out, decoded before and after fine-tuning."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tmca.decoders import Weights
from tmca.plots.style import save_figure
from tmca.reports.training import training_pictures
from tmca.training.camera_training import TRAININGS
from tmca.tuning.captures import Pair

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tmca.tuning.run import FineTuning

BEFORE_AFTER = "before_after.png"


def tuning_pictures(prepared: FineTuning, folder: Path) -> list[Path]:
    """Write ``before_after.png`` and what every run has into a run's folder, in the place of earlier ones."""
    drawn = before_after(prepared, folder)
    return [*training_pictures(folder), save_figure(drawn, folder / BEFORE_AFTER, overwrite=True)]


def before_after(prepared: FineTuning, folder: Path) -> Figure:
    """The first capture that was held out, by the network as it was and as it is, through the same operator."""
    pair, camera, tuned = (
        prepared.read(prepared.settings.data.validation[0]),
        prepared.camera.cpu(),
        Weights.load(folder),
    )
    networks, prior = {"before": prepared.weights.network, "fine-tuned": tuned.network}, tuned.load_prior()
    estimates = {name: decoded(network, prior, pair, camera) for name, network in networks.items()}
    return TRAININGS[camera.kind].figure(estimates, pair.truth, camera)


def decoded(network: Any, prior: Any, pair: Pair, camera: Any) -> NDArray[np.float32]:
    """(B, L, H, W) estimate of a capture; its last channel is inverse depth where that of the truth is."""
    return TRAININGS[camera.kind].decode(network, prior, pair.values, camera.replace(sensor=pair.sensor))
