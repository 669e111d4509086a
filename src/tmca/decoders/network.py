"""Trained networks as decoders."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from tmca.decoders.decoder import Decoder, Progress, Raw
from tmca.decoders.nets.tiles import CollapsedNetwork, TwoHeadedNetwork
from tmca.decoders.nets.two_headed import TwoHeadedUNet
from tmca.decoders.nets.weights import SHIPPED, Weights
from tmca.errors import SettingError
from tmca.operators import TapOperator
from tmca.priors import find_prior


def _on(network: nn.Module, device: torch.device) -> Any:
    """A network on a device: itself if it is there, else a copy."""
    there = next(network.parameters()).device == device
    return network if there else deepcopy(network).to(device)


@dataclass
class NetworkDecoder(Decoder):
    """A network trained for the camera; it brings its prior, in whose place another may be given.

    Args:
        weights: a run or file of `tmca train`; or what comes with tmca for spectral cameras: default (12 bands), or
            universal (any bands, codes and buckets), which also predicts the standard deviation.
    """

    name, label, cameras = "network", "network", frozenset({"spectral", "light-field", "spectral-depth"})
    weights: str | Path | Weights | None = None

    def trained(self, camera: Any) -> Weights:
        """The weights; a SettingError if there are none."""
        if self.weights is None:
            raise SettingError("weights", "none", "those of the network", "weights and the decoder network go together")
        if str(self.weights) == "default" and camera.kind not in SHIPPED:
            found = f"'default', of which none come with tmca for a {camera.kind} camera"
            raise SettingError("weights", found, f"a file or run of `tmca train {camera.kind}`")
        return self.weights if isinstance(self.weights, Weights) else Weights.find(self.weights, camera.slots)

    def find_prior(self, camera: Any, given: Any, progress: Progress | None = None) -> Any:
        if given is None:
            return None
        network = self.trained(camera).network
        if isinstance(network, TwoHeadedUNet):
            raise SettingError("prior", str(given), "none beside weights, which bring their own", "leave it out")
        kind = "mixture" if network.start == "mixture" else "gaussian"
        return find_prior(camera, given, kind, progress)

    def setup(self, camera: Any, prior: Any) -> tuple[CollapsedNetwork | TwoHeadedNetwork, str]:
        weights = self.trained(camera)
        weights.check(camera)
        prior = weights.load_prior(camera) if prior is None else prior
        network = _on(weights.network_for(camera), camera.response.device)
        if isinstance(network, TwoHeadedUNet):
            return TwoHeadedNetwork(network, camera, prior), str(weights.path or "")
        operator = TapOperator(camera.taps())
        return CollapsedNetwork(network, operator, camera.noise, prior), str(weights.path or "")

    def precompute(self, prepared: Any, bank: Path | None = None) -> Any:
        super().precompute(prepared, bank)
        prepared[0].precompute()
        return prepared

    def reconstruct(self, prepared: Any, values: Tensor, progress: Progress | None) -> Raw:
        run, path = prepared
        raw: Raw = run(values.to(next(run.network.parameters()).dtype), progress)
        raw.notes["weights"] = path
        return raw
