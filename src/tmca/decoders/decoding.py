"""What decoders of every camera share: checks of what is given, priors, total variation, plug-and-play."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Any

import torch
from torch import Tensor

from tmca.cameras import CodedCamera, Snapshot
from tmca.decoders.iterative.admm import admm_tv, default_weight
from tmca.decoders.iterative.denoisers import nl_means_denoiser, tv_denoiser
from tmca.decoders.iterative.pnp import Denoiser, pnp_admm
from tmca.decoders.iterative.subspace import subspace_denoiser
from tmca.decoders.iterative.tikhonov import tikhonov
from tmca.decoders.networks.neural import Weights
from tmca.decoders.patch_based.adapted import AdaptedLMMSE
from tmca.decoders.patch_based.lmmse import PatchLMMSE
from tmca.decoders.patch_based.mixture import MixtureLMMSE
from tmca.errors import SettingError
from tmca.operators import TapOperator
from tmca.priors import GaussianMixturePrior, GaussianPrior

_ITERATIONS, _PNP_ITERATIONS, _SMOOTH_ITERATIONS = 300, 100, 100
_DENOISERS: dict[str, tuple[Callable[[], Denoiser], float]] = {
    "pnp-tv": (tv_denoiser, 1e-3),
    "pnp-nl-means": (nl_means_denoiser, 1e-3),
    "pnp-subspace": (lambda: subspace_denoiser(tv_denoiser(5.0, joint=False, max_iterations=20)), 1e-2),
}
"""The denoiser of a method, and the least noise that it is told, where 1 is one band of a white scene."""
Progress = Callable[[float], None]
Prior = GaussianPrior | GaussianMixturePrior


@dataclass
class Decoded:
    """What a decoder returns.

    Args:
        estimate: (B, L, H, W) cube, or (B, V, U, H, W) light field.
        deviation: standard deviation of each entry, if the decoder knows it.
        seconds: wall time.
        notes: what the decoder says of itself (iterations, weight, …).
    """

    estimate: Tensor
    deviation: Tensor | None = None
    seconds: float = 0.0
    notes: dict[str, Any] = field(default_factory=dict)


def needs_prior(method: str) -> bool:
    """Whether a decoder needs a prior."""
    return method in ("lmmse", "lmmse-adapted", "mixture")


class OtherCodes(UserWarning):
    """A network that is not told the codes, behind other codes than it was trained for."""


def check_arguments(
    method: str, methods: tuple[str, ...], prior: object, weights: object, tv_weight: float | None
) -> None:
    """Raises SettingError for an unknown method, or arguments that it does not take."""
    if method not in methods:
        raise SettingError("decoder", repr(method), f"one of {', '.join(methods)}")
    if prior is not None and not needs_prior(method) and method != "network":
        raise SettingError(
            "prior", f"one for {method}", "none: only lmmse, lmmse-adapted and mixture use it", "leave it out"
        )
    if (weights is None) == (method == "network"):
        there, wanted = ("none", "those of the network") if weights is None else (f"some for {method}", "none")
        raise SettingError("weights", there, wanted, "weights and the decoder network go together")
    if tv_weight is not None and not method.startswith("admm"):
        raise SettingError("tv_weight", f"{tv_weight} for {method}", "none: only admm-tv uses it", "leave it out")


def check_bands(prior: Prior | None, wavelengths: Sequence[float]) -> None:
    """Raises SettingError unless the prior's bands are the camera's, to a nanometre; their number is not looked at."""
    base = prior.base if isinstance(prior, GaussianMixturePrior) else prior
    known = None if base is None else base.wavelengths
    if known is None or len(known) != len(wavelengths):
        return  # the block model names a wrong number of bands
    for band, (own, wanted) in enumerate(zip(known, wavelengths, strict=True), start=1):
        if abs(own - wanted) > 1e-9:
            found, there = f"band {band} at {own * 1e9:.4g} nm", f"the camera's {wanted * 1e9:.4g} nm"
            raise SettingError("prior", found, there, "learn a prior at the camera's bands")


def finished(found: Decoded, method: str, start: float) -> Decoded:
    """The estimate without negative irradiance, and how long it took since ``start`` (``time.perf_counter``)."""
    if method != "dagger":
        found.estimate = found.estimate.clamp_min(0)
    found.seconds = time.perf_counter() - start
    return found


def same_codes(weights: Weights, camera: CodedCamera) -> bool:
    """Whether a camera shows the codes that a network was trained for."""
    if camera.size != tuple(weights.camera["size"]) and not weights.camera["period"]:
        return False
    own, known = camera.codes(), weights.coded_camera(camera.size).codes()
    return all(torch.equal(one.detach().cpu(), other) for one, other in zip(own, known, strict=True))


def tap_operator(camera: CodedCamera, method: str) -> TapOperator:
    """The camera's operator, where one code stands for all slots.

    Raises:
        SettingError: relay blur.
    """
    operator = camera.operator()
    if not isinstance(operator, TapOperator):
        raise SettingError("relay blur", str(getattr(camera, "relay_blur", "")), f"0 for {method}", "use admm-tv")
    return operator


def by_prior(
    snapshot: Snapshot[Any],
    method: str,
    prior: Prior | None,
    uncertainty: bool,
    progress: Progress | None,
) -> Decoded:
    """Scenes by a patch prior; (B, L, H, W).

    Raises:
        SettingError: no prior, or one of the wrong kind.
    """
    operator, noise = tap_operator(snapshot.camera, "lmmse and mixture"), snapshot.camera.noise
    if method == "mixture" and isinstance(prior, GaussianMixturePrior):
        decoder: PatchLMMSE | AdaptedLMMSE | MixtureLMMSE = MixtureLMMSE(prior)
    elif method == "lmmse" and isinstance(prior, GaussianPrior):
        decoder = PatchLMMSE(prior)
    elif method == "lmmse-adapted" and isinstance(prior, GaussianPrior):
        decoder = AdaptedLMMSE(prior)
    else:
        kinds = {
            GaussianPrior: "a Gaussian prior",
            GaussianMixturePrior: "a Gaussian-mixture prior",
            type(None): "none",
        }
        wanted, how = ("a Gaussian-mixture prior", " --mixture") if method == "mixture" else ("a Gaussian prior", "")
        command = "learn-views" if snapshot.camera.kind == "light-field" else "learn"
        remedy = f"learn one with `tmca prior {command} …{how}`"
        raise SettingError("prior", kinds.get(type(prior), "something else"), f"{wanted} for {method}", remedy)
    found = decoder(snapshot.values, operator.taps, noise.read, noise.shot, uncertainty=uncertainty, progress=progress)
    return Decoded(found.estimate, found.deviation)


def by_variation(snapshot: Snapshot[Any], joint: bool, weight: float | None, progress: Progress | None) -> Decoded:
    """Scenes by ADMM with total variation, each channel's or of all together; (B, L, H, W)."""
    camera = snapshot.camera
    if weight is None:
        # the weight was chosen at equal exposure; K times the light is K² times the data term
        gain = _exposure_gain(camera)
        weight = default_weight(_noise_level(snapshot) / gain) * gain**2
    told = None if progress is None else lambda iteration, primal, dual: progress(iteration / _ITERATIONS)
    result = admm_tv(
        camera.operator(),
        snapshot.values,
        weight,
        joint=joint,
        bounds=(0.0, inf),
        max_iterations=_ITERATIONS,
        progress=told,
    )
    notes = {"tv_weight": weight, "iterations": result.iterations, "converged": result.converged}
    return Decoded(result.estimate, notes=notes)


def _noise_level(snapshot: Snapshot[Any]) -> float:
    """Root mean square of the snapshot's noise."""
    return float(snapshot.camera.noise.variance(snapshot.values).mean().sqrt())


def _exposure_gain(camera: CodedCamera) -> float:
    """What one band of a white scene gives through open codes: 1 at equal exposure, the slots where they add up."""
    return camera.full_scale / float(camera.response.sum())


def by_smoothness(snapshot: Snapshot[Any], progress: Progress | None) -> Decoded:
    """Scenes by least squares with smooth channels; (B, L, H, W)."""
    operator = tap_operator(snapshot.camera, "tikhonov")
    return Decoded(tikhonov(operator, snapshot.values, iterations=_SMOOTH_ITERATIONS, progress=progress))


def by_denoiser(snapshot: Snapshot[Any], method: str, progress: Progress | None) -> Decoded:
    """Scenes by plug-and-play ADMM; (B, L, H, W)."""
    camera, (denoiser, least) = snapshot.camera, _DENOISERS[method]
    told = None if progress is None else lambda iteration, primal, dual: progress(iteration / _PNP_ITERATIONS)
    result = pnp_admm(
        camera.operator(),
        snapshot.values,
        denoiser(),
        noise_sigma=max(_noise_level(snapshot), least * _exposure_gain(camera)),
        max_iterations=_PNP_ITERATIONS,
        progress=told,
    )
    return Decoded(result.estimate, notes={"iterations": result.iterations, "converged": result.converged})
