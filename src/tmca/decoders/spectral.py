"""Every decoder of the spectral camera under one call."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf
from typing import Any
from warnings import warn

import torch
from torch import Tensor

from tmca.cameras import Snapshot, SpectralCamera
from tmca.decoders.adapted import AdaptedLMMSE
from tmca.decoders.admm import admm_tv, default_weight
from tmca.decoders.denoisers import nl_means_denoiser, tv_denoiser
from tmca.decoders.lmmse import PatchLMMSE
from tmca.decoders.mixture import MixtureLMMSE
from tmca.decoders.neural import NeuralDecoder, Weights, same_bands
from tmca.decoders.pnp import pnp_admm
from tmca.errors import SettingError
from tmca.operators import TapOperator
from tmca.priors import GaussianMixturePrior, GaussianPrior

METHODS = (
    "lmmse",
    "lmmse-adapted",
    "mixture",
    "admm-tv",
    "admm-tv-joint",
    "pnp-tv",
    "pnp-nl-means",
    "dagger",
    "network",
)
_ITERATIONS, _PNP_ITERATIONS, _LEAST_NOISE = 300, 100, 1e-3
Progress = Callable[[float], None]


@dataclass
class Decoded:
    """What a decoder returns.

    Args:
        estimate: (B, L, H, W) scene.
        deviation: (B, L, H, W) standard deviation of each entry, if the decoder knows it.
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


def decode(
    snapshot: Snapshot[SpectralCamera],
    method: str = "lmmse",
    *,
    prior: GaussianPrior | GaussianMixturePrior | None = None,
    tv_weight: float | None = None,
    weights: Weights | None = None,
    uncertainty: bool = False,
    progress: Progress | None = None,
) -> Decoded:
    """Recover the scene from a snapshot.

    Args:
        snapshot: values and camera.
        method: ``"lmmse"`` (Gaussian prior), ``"lmmse-adapted"`` (Gaussian prior refitted to the snapshot itself),
            ``"mixture"`` (Gaussian-mixture prior), ``"admm-tv"``, ``"admm-tv-joint"`` (total variation band by
            band or over all bands), ``"pnp-tv"``, ``"pnp-nl-means"`` (plug-and-play ADMM with a denoiser), ``"dagger"``
            (least-norm, the plain baseline), ``"network"`` (trained).
        prior: for the first three; for a network, in the place of its own.
        weights: of the network.
        tv_weight: for total variation; chosen from the noise if None.
        uncertainty: the first three also return every entry's standard deviation.
        progress: told the share that is done.

    Raises:
        SettingError: unknown method, a prior that is missing or of the wrong kind, or a network of another camera.
    """
    if method not in METHODS:
        raise SettingError("decoder", repr(method), f"one of {', '.join(METHODS)}")
    if prior is not None and not needs_prior(method) and method != "network":
        raise SettingError(
            "prior", f"one for {method}", "none: only lmmse, lmmse-adapted and mixture use it", "leave it out"
        )
    if (weights is None) == (method == "network"):
        there, wanted = ("none", "those of the network") if weights is None else (f"some for {method}", "none")
        raise SettingError("weights", there, wanted, "weights and the decoder network go together")
    if tv_weight is not None and not method.startswith("admm"):
        raise SettingError("tv_weight", f"{tv_weight} for {method}", "none: only admm-tv uses it", "leave it out")
    start = time.perf_counter()
    with torch.no_grad():
        if needs_prior(method):
            found = _by_prior(snapshot, method, prior, uncertainty, progress)
        elif weights is not None:
            found = _by_network(snapshot, weights, prior, progress)
        elif method == "dagger":
            found = Decoded(snapshot.camera.A_dagger(snapshot.values))
        elif method.startswith("pnp"):
            found = _by_denoiser(snapshot, method, progress)
        else:
            found = _by_variation(snapshot, method == "admm-tv-joint", tv_weight, progress)
    if method != "dagger":
        found.estimate = found.estimate.clamp_min(0)  # irradiance is not negative
    found.seconds = time.perf_counter() - start
    return found


def _by_prior(
    snapshot: Snapshot[SpectralCamera],
    method: str,
    prior: GaussianPrior | GaussianMixturePrior | None,
    uncertainty: bool,
    progress: Progress | None,
) -> Decoded:
    operator, noise = snapshot.camera.operator(), snapshot.camera.noise
    if not isinstance(operator, TapOperator):
        raise SettingError("relay blur", str(snapshot.camera.relay_blur), "0 for lmmse and mixture", "use admm-tv")
    _check_bands(prior, snapshot)
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
        remedy = f"learn one with `tmca prior learn …{how}`"
        raise SettingError("prior", kinds.get(type(prior), "something else"), f"{wanted} for {method}", remedy)
    found = decoder(snapshot.values, operator.taps, noise.read, noise.shot, uncertainty=uncertainty, progress=progress)
    return Decoded(found.estimate, found.deviation)


def _check_bands(prior: GaussianPrior | GaussianMixturePrior | None, snapshot: Snapshot[SpectralCamera]) -> None:
    """The prior's bands must be the camera's, to a nanometre."""
    base = prior.base if isinstance(prior, GaussianMixturePrior) else prior
    known, needed = None if base is None else base.wavelengths, snapshot.camera.wavelengths
    if known is None or len(known) != len(needed):
        return  # the block model names a wrong number of bands
    for band, (own, wanted) in enumerate(zip(known, needed, strict=True), start=1):
        if abs(own - wanted) > 1e-9:
            raise SettingError(
                "prior",
                f"band {band} at {own * 1e9:.4g} nm",
                f"the camera's {wanted * 1e9:.4g} nm",
                "learn a prior at the camera's bands",
            )


def _by_network(
    snapshot: Snapshot[SpectralCamera],
    weights: Weights,
    prior: GaussianPrior | GaussianMixturePrior | None,
    progress: Progress | None,
) -> Decoded:
    camera, operator = snapshot.camera, snapshot.camera.operator()
    if not isinstance(operator, TapOperator):
        raise SettingError("relay blur", str(camera.relay_blur), "0 for a network", "use admm-tv")
    if not same_bands(weights.wavelengths, camera.wavelengths):
        bands = f"{len(weights.wavelengths)} bands, {weights.wavelengths[0] * 1e9:.4g} nm and on"
        own = f"the camera's {camera.bands}, {camera.wavelengths[0] * 1e9:.4g} nm and on"
        raise SettingError("weights", bands, own, "train a network at the camera's bands")
    if isinstance(prior, GaussianMixturePrior):
        raise SettingError("prior", "a mixture", "a Gaussian prior for a network")
    _check_bands(prior, snapshot)
    _check_camera(weights, camera)
    decoder = NeuralDecoder(weights.network, weights.load_prior() if prior is None else prior)
    found = decoder(snapshot.values, operator, camera.noise, progress)
    return Decoded(found, notes={"weights": str(weights.path or "")})


def _check_camera(weights: Weights, camera: SpectralCamera) -> None:
    """Raise SettingError for optics that the network has never seen, warn of codes that it cannot be told."""
    trained = weights.spectral_camera()
    for name in ("disperser", "exposure", "dispersion"):
        own, known = getattr(camera, name), getattr(trained, name)
        if own != known:
            shown = [getattr(value, "displacement", value) for value in (known, own)]
            raise SettingError("weights", f"{name} {shown[0]}", f"the camera's {shown[1]}", "train for this camera")
    if not getattr(weights.network, "codes", True) and not _same_codes(weights, camera):
        text = f"{weights.path or 'weights'}: this network is not told the codes, and was trained for others"
        warn(text, OtherCodes, stacklevel=2)


def _same_codes(weights: Weights, camera: SpectralCamera) -> bool:
    if camera.size != tuple(weights.camera["size"]) and not weights.camera["period"]:
        return False
    own, known = camera.codes(), weights.spectral_camera(camera.size).codes()
    return all(torch.equal(one.detach().cpu(), other) for one, other in zip(own, known, strict=True))


def _by_variation(
    snapshot: Snapshot[SpectralCamera], joint: bool, weight: float | None, progress: Progress | None
) -> Decoded:
    camera = snapshot.camera
    if weight is None:
        # the weight was chosen at equal exposure; K times the light is K² times the data term
        gain = camera.full_scale / float(camera.response.sum())
        level = float(camera.noise.variance(snapshot.values).mean().sqrt())
        weight = default_weight(level / gain) * gain**2
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


def _by_denoiser(snapshot: Snapshot[SpectralCamera], method: str, progress: Progress | None) -> Decoded:
    camera = snapshot.camera
    denoise = tv_denoiser() if method == "pnp-tv" else nl_means_denoiser()
    level = float(camera.noise.variance(snapshot.values).mean().sqrt())
    told = None if progress is None else lambda iteration, primal, dual: progress(iteration / _PNP_ITERATIONS)
    result = pnp_admm(
        camera.operator(),
        snapshot.values,
        denoise,
        noise_sigma=max(level, _LEAST_NOISE),
        max_iterations=_PNP_ITERATIONS,
        progress=told,
    )
    return Decoded(result.estimate, notes={"iterations": result.iterations, "converged": result.converged})
