"""A capture that was held out, decoded before and after fine-tuning."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from torch import Tensor

from tmca.cameras import CodedCamera
from tmca.decoders.neural import NeuralDecoder, Weights
from tmca.experiments.figures import save_figure
from tmca.experiments.reconstruction_figures import reconstruction_figure
from tmca.experiments.training_figures import training_pictures
from tmca.operators import TapOperator
from tmca.training.captured import Pair

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tmca.experiments.tuning.run import Prepared

BEFORE_AFTER = "before_after.png"


def tuning_pictures(prepared: Prepared, folder: Path) -> list[Path]:
    """Write ``curve.png``, ``codes.png`` and ``before_after.png`` into a run's folder, in the place of earlier ones."""
    drawn = before_after(prepared, Weights.load(folder))
    return [*training_pictures(folder), save_figure(drawn, folder / BEFORE_AFTER, overwrite=True)]


def before_after(prepared: Prepared, tuned: Weights) -> Figure:
    """The first capture that was held out, by the network as it was and as it is, through the same operator."""
    pair, camera = prepared.read(prepared.settings.data.validation[0]), prepared.tuning.camera.cpu()
    networks = {"before": prepared.tuning.weights.network, "fine-tuned": tuned.network}
    prior = tuned.load_prior()
    estimates = {name: decoded(NeuralDecoder(one, prior), pair, camera) for name, one in networks.items()}
    return reconstruction_figure(
        {name: found[0].numpy() for name, found in estimates.items()}, list(camera.wavelengths), pair.truth[0]
    )


def decoded(decoder: NeuralDecoder, pair: Pair, camera: CodedCamera) -> Tensor:
    """(B, L, H, W) estimate of a capture, without negative irradiance."""
    noise = pair.sensor.noise(camera.white, camera.exposures)
    return decoder(pair.values, TapOperator(camera.taps()), noise).clamp_min(0)
