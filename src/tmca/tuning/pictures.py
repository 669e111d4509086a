"""A capture that was held out, decoded before and after fine-tuning."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from tmca.cameras import CodedCamera, SpectralDepthCamera
from tmca.decoders import Network, Weights
from tmca.decoders.nets.tiles import CollapsedNetwork, TwoHeadedNetwork
from tmca.operators import TapOperator
from tmca.plots.cube import reconstruction_figure
from tmca.plots.depth import before_after as depth_before_after
from tmca.plots.light_field import light_field_figure
from tmca.plots.style import save_figure
from tmca.reports.training import training_pictures
from tmca.training.captures import Pair

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tmca.tuning.run import Prepared

BEFORE_AFTER = "before_after.png"


def tuning_pictures(prepared: Prepared, folder: Path) -> list[Path]:
    """Write ``before_after.png`` and what every run has into a run's folder, in the place of earlier ones."""
    drawn = before_after(prepared, folder)
    return [*training_pictures(folder), save_figure(drawn, folder / BEFORE_AFTER, overwrite=True)]


def before_after(prepared: Prepared, folder: Path) -> Figure:
    """The first capture that was held out, by the network as it was and as it is, through the same operator."""
    pair = prepared.read(prepared.settings.data.validation[0])
    camera: Any = prepared.tuning.camera.cpu()
    was = prepared.tuning.weights
    tuned = Weights.load(folder)
    networks, prior = {"before": was.network, "fine-tuned": tuned.network}, tuned.load_prior()
    if isinstance(camera, SpectralDepthCamera):
        found = {name: TwoHeadedNetwork(one, camera, prior)(pair.values) for name, one in networks.items()}
        camera.sensor = pair.sensor
        truth, planes = pair.truth[0], camera.planes
        real = truth[:-1], planes.depth_of(torch.from_numpy(truth[-1])).numpy()
        pairs = {name: (one.values[0].numpy(), one.depth[0, 0].numpy()) for name, one in found.items()}
        return depth_before_after(pairs, real, list(camera.wavelengths), (planes.near, planes.far))
    estimates = {name: decoded(one, prior, pair, camera).numpy() for name, one in networks.items()}
    if camera.kind == "spectral":
        cubes = {name: found[0] for name, found in estimates.items()}
        return reconstruction_figure(cubes, list(camera.wavelengths), pair.truth[0])
    views = {name: _views(found, camera.views) for name, found in {"truth": pair.truth, **estimates}.items()}
    return light_field_figure({name: views[name] for name in estimates}, views["truth"])


def decoded(network: Network, prior: Any, pair: Pair, camera: CodedCamera) -> Tensor:
    """(B, L, H, W) estimate of a capture, without negative irradiance."""
    noise = pair.sensor.noise(camera.white, camera.exposures)
    return CollapsedNetwork(network, TapOperator(camera.taps()), noise, prior)(pair.values).clamp_min(0)


def _views(field: np.ndarray, views: tuple[int, int]) -> np.ndarray:
    """(V, U, H, W), colours before them if there are some, of (B, V·U, H, W)."""
    found = field.reshape(len(field), *views, *field.shape[2:])
    return found if len(found) > 1 else found[0]
