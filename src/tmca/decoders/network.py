"""Trained networks as decoders."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from tmca.decoders.batches import part_of
from tmca.decoders.decoder import Decoder, Progress, Raw
from tmca.decoders.nets.adaptation import adapted
from tmca.decoders.nets.shipped import DEFAULT, SHIPPED
from tmca.decoders.nets.tiles import CollapsedNetwork, TwoHeadedNetwork
from tmca.decoders.nets.two_headed import TwoHeadedUNet
from tmca.decoders.nets.weights import Weights, same_bands
from tmca.errors import SettingError, check_range
from tmca.operators import TapOperator
from tmca.priors import find_prior

_ADAPTED = 0.8
"""Share of the time that adaptation takes, as a rule."""


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
        adapt: steps by which it learns from the snapshot itself before it decodes it: some pixels are hidden from it,
            and it learns to predict them (spectral and light-field snapshots); 0 for none.
        early_stop: end these steps where pixels that are never learned from are no longer predicted better.
    """

    name, label, cameras = "network", "network", frozenset({"spectral", "light-field", "spectral-depth"})
    weights: str | Path | Weights | None = None
    adapt: int = 0
    early_stop: bool = True

    def trained(self, camera: Any) -> Weights:
        """The weights; a SettingError if there are none."""
        if self.weights is None:
            raise SettingError("weights", "none", "those of the network", "weights and the decoder network go together")
        given = self.weights
        return given if isinstance(given, Weights) else Weights.find(given, camera.slots, camera.kind)

    @classmethod
    def usual_settings(cls, camera: Any) -> dict[str, Any] | None:
        """See `Decoder`: the weights that come with tmca, of a camera with their codes."""
        return {"weights": DEFAULT} if _comes_with_tmca(camera) else None

    def find_prior(self, camera: Any, given: Any, progress: Progress | None = None) -> Any:
        if given is None:
            return None
        network = self.trained(camera).network
        if isinstance(network, TwoHeadedUNet):
            raise SettingError("prior", str(given), "none beside weights, which bring their own", "leave it out")
        kind = "mixture" if network.start == "mixture" else "gaussian"
        return find_prior(camera, given, kind, progress)

    def setup(self, camera: Any, prior: Any) -> tuple[CollapsedNetwork | TwoHeadedNetwork, Any, str]:
        """See `Decoder`: the network behind its camera, its prior, and the file of its weights."""
        weights = self.trained(camera)
        weights.check(camera)
        check_range("adapt", self.adapt, 0, unit="steps")
        prior = weights.load_prior(camera) if prior is None else prior
        network, path = _on(weights.network_for(camera), camera.response.device), str(weights.path or "")
        if not isinstance(network, TwoHeadedUNet):
            return CollapsedNetwork(network, TapOperator(camera.taps()), camera.noise, prior), prior, path
        if self.adapt:
            found, wanted = (
                f"{self.adapt} steps on a {camera.kind} snapshot",
                "0, or a spectral or light-field snapshot",
            )
            raise SettingError("adapt", found, wanted)
        return TwoHeadedNetwork(network, camera, prior), prior, path

    def precompute(self, prepared: Any, bank: Path | None = None) -> Any:
        super().precompute(prepared, bank)
        prepared[0].precompute()
        return prepared

    def reconstruct(self, prepared: Any, values: Tensor, progress: Progress | None) -> Raw:
        run, prior, path = prepared
        values, notes = values.to(next(run.network.parameters()).dtype), {"weights": path}
        if self.adapt:
            how: dict[str, Any] = {"stop": self.early_stop, "progress": part_of(progress, 0, _ADAPTED)}
            better = adapted(run, prior, values, self.adapt, **how)
            run, notes["adapted"], progress = better.run, str(better), part_of(progress, _ADAPTED, 1)
        raw: Raw = run(values, progress)
        raw.notes |= notes
        return raw


def _comes_with_tmca(camera: Any) -> bool:
    """Whether a camera shows the codes of one that comes with the package, with its optics and bands."""
    if camera.kind not in SHIPPED:
        return False
    weights = Weights.find(DEFAULT, camera.slots, camera.kind)
    if weights.slots != camera.slots or not same_bands(weights.wavelengths, getattr(camera, "wavelengths", ())):
        return False
    shown = camera.variables(tiled=True).sizes
    return (shown.get("y_tile"), shown.get("x_tile")) == weights.period and not weights.differences(camera)
