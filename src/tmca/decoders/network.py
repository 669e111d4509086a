"""Trained networks as decoders."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from tmca.decoders.batches import one_by_one, part_of
from tmca.decoders.decoder import Decoder, Progress, Raw
from tmca.decoders.nets.adaptation import adapt_network
from tmca.decoders.nets.bands import same_bands
from tmca.decoders.nets.shipped import DEFAULT, FOLDER, SHIPPED, UNNAMED
from tmca.decoders.nets.starts import VARIATION, Starts, VariationStart
from tmca.decoders.nets.tiles import CollapsedNetwork, TwoHeadedNetwork
from tmca.decoders.nets.two_headed import TwoHeadedUNet
from tmca.decoders.nets.weights import Weights
from tmca.errors import SettingError, check_choice, check_range
from tmca.operators import TapOperator
from tmca.priors import find_prior, warn_of_bands_beyond
from tmca.sensor import Sensor

_MOST_NOISE = 5.5
"""Standard deviation of read and of shot noise in the largest that the network learned with: coffee gains by the
network over the LMMSE at 5 times the read noise (0.3 dB), and loses at 10 times (0.9 dB)."""
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
        weights: a run or file of `tmca train`; or what comes with tmca: default (spectral cameras of 12 bands, a
            light-field and a spectral-depth camera, with their codes; behind these it needs no name), or universal
            (spectral, any bands, codes and buckets).
        adapt: steps by which it learns from the snapshot itself before it decodes it: some pixels are hidden from it,
            and it learns to predict them (spectral and light-field snapshots); 0 for none.
        early_stop: end these steps where pixels that are never learned from are no longer predicted better.
        start: own (the first estimate that it learned with) or admm-tv-joint, which needs no prior and is better for
            scenes unlike those of the network's prior, with adapt too (spectral and light-field snapshots).
        uncertainty: also give the standard deviation of every entry, where the network has one: universal, which
            predicts it, and the spectral and light-field networks of default, from what they changed of their own first
            estimate. A standard deviation of depth is always there.
        calibrated: bring the deviation of default's networks to the errors of known scenes; False leaves the change.
    """

    name, label, cameras = "network", "network", frozenset({"spectral", "light-field", "spectral-depth"})
    weights: str | Path | Weights | None = None
    adapt: int = 0
    early_stop: bool = True
    start: str = "own"
    uncertainty: bool = True
    calibrated: bool = True

    def __post_init__(self) -> None:
        check_choice("start", self.start, ("own", VARIATION))

    def trained(self, camera: Any) -> Weights:
        """The weights; those that come with tmca behind their codes; a SettingError if there are none."""
        given = DEFAULT if self.weights is None and _comes_with_tmca(camera) else self.weights
        if given is None:
            raise SettingError("weights", "none", "those of the network", "weights and the decoder network go together")
        return given if isinstance(given, Weights) else Weights.find(given, camera.slots, camera.kind)

    @classmethod
    def usual_settings(cls, camera: Any) -> dict[str, Any] | None:
        """See `Decoder`: the weights that come with tmca, behind their codes and where noise is not too strong."""
        usual = camera.kind in UNNAMED and _comes_with_tmca(camera) and not _noisy(camera)
        return {"weights": DEFAULT} if usual else None

    def find_prior(self, camera: Any, given: Any, progress: Progress | None = None) -> Any:
        if given is None:
            return None
        if self.start != "own":
            raise SettingError("prior", str(given), f"none where the network starts from {self.start}", "leave it out")
        network = self.trained(camera).network
        if isinstance(network, TwoHeadedUNet):
            raise SettingError("prior", str(given), "none beside weights, which bring their own", "leave it out")
        kind = "mixture" if network.start == "mixture" else "gaussian"
        return find_prior(camera, given, kind, progress)

    def setup(self, camera: Any, prior: Any) -> tuple[CollapsedNetwork | TwoHeadedNetwork, str]:
        """See `Decoder`: the network behind its camera, and the file of its weights."""
        weights = self.trained(camera)
        weights.check(camera)
        check_range("adapt", self.adapt, 0, unit="steps")
        network, path = _on(weights.network_for(camera), camera.response.device), str(weights.path or "")
        if prior is None and self.start == "own":
            prior = weights.load_prior(camera)
        elif weights.any_bands:
            warn_of_bands_beyond(camera.wavelengths, (1e-9 * network.knots.double()).tolist(), "network")
        if not isinstance(network, TwoHeadedUNet):
            changes = self.uncertainty and self.start == "own" and not weights.any_bands and _is_shipped(weights)
            operator, starts = TapOperator(camera.taps()), self._starts(camera)
            return CollapsedNetwork(network, operator, camera.noise, prior, starts=starts, changes=changes), path
        for name, usual in (("adapt", 0), ("start", "own")):
            if getattr(self, name) != usual:
                found = f"{getattr(self, name)} on a {camera.kind} snapshot"
                raise SettingError(name, found, f"{usual}, or a spectral or light-field snapshot")
        return TwoHeadedNetwork(network, camera, prior), path

    def _starts(self, camera: Any) -> Starts | None:
        """What makes first estimates of another kind than the network's own."""
        return None if self.start == "own" else partial(VariationStart, noise=camera.noise, gain=camera.exposures)

    def precompute(self, prepared: Any, bank: Path | None = None) -> Any:
        super().precompute(prepared, bank)
        prepared[0].precompute()
        return prepared

    def reconstruct(self, prepared: Any, values: Tensor, progress: Progress | None) -> Raw:
        run, path = prepared
        notes = {"weights": path, **({} if self.start == "own" else {"start": self.start})}
        values = values.to(next(run.network.parameters()).dtype)
        raw: Raw = self._all_adapted(run, values, progress) if self.adapt else run(values, progress)
        raw.notes |= notes
        raw.calibration = NetworkDecoder.name if getattr(run, "changes", False) else ""
        if not self.uncertainty:
            raw.deviation = None
        return raw

    def _all_adapted(self, run: CollapsedNetwork, snapshots: Tensor, progress: Progress | None) -> Raw:
        """Estimates by networks each of which learned from its own snapshot."""
        parts = [self._adapted(run, one, report) for one, report in one_by_one(snapshots, progress)]
        raws, told = zip(*parts, strict=True)
        deviations = [raw.deviation for raw in raws if raw.deviation is not None]
        values, deviation = torch.cat([raw.values for raw in raws]), torch.cat(deviations) if deviations else None
        return replace(raws[0], values=values, deviation=deviation, notes={"adapted": "; ".join(told)})

    def _adapted(self, run: CollapsedNetwork, snapshot: Tensor, progress: Progress | None) -> tuple[Raw, str]:
        """The estimate of one snapshot by a network that learned from it, and how that went."""
        how: dict[str, Any] = {"stop": self.early_stop, "progress": part_of(progress, 0, _ADAPTED)}
        better = adapt_network(run, snapshot, self.adapt, **how)
        return better.run(snapshot, part_of(progress, _ADAPTED, 1)), str(better)


def _is_shipped(weights: Weights) -> bool:
    """Whether weights are a file of the package."""
    return weights.path is not None and weights.path.resolve().parent == FOLDER.resolve()


@lru_cache(maxsize=4)
def _shipped(slots: int, kind: str) -> Weights:
    """The weights that come with tmca, to compare cameras with."""
    return Weights.find(DEFAULT, slots, kind)


def _comes_with_tmca(camera: Any) -> bool:
    """Whether a camera shows the codes of one that comes with the package, with its optics and bands."""
    if camera.kind not in SHIPPED:
        return False
    weights = _shipped(camera.slots, camera.kind)
    if weights.slots != camera.slots or not same_bands(weights.wavelengths, getattr(camera, "wavelengths", ())):
        return False
    shown = camera.variables(tiled=True).sizes
    return (shown.get("y_tile"), shown.get("x_tile")) == weights.period and not weights.differences(camera)


def _noisy(camera: Any) -> bool:
    """Whether noise is far above all that the network learned with."""
    weights = _shipped(camera.slots, camera.kind)
    learned = [weights.camera_for(sensor=Sensor(**one)).noise for one in weights.card["training"]["noise"]]
    read, shot = max(noise.read for noise in learned), max(noise.shot for noise in learned)
    return bool(camera.noise.read > _MOST_NOISE * read or camera.noise.shot > _MOST_NOISE**2 * shot)
