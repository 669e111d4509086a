"""Every decoder of the spectral camera under one call."""

from __future__ import annotations

import time
from warnings import warn

import torch

from tmca.cameras import Snapshot, SpectralCamera
from tmca.decoders.decoding import (
    Decoded,
    OtherCodes,
    Prior,
    Progress,
    by_denoiser,
    by_prior,
    by_smoothness,
    by_variation,
    check_arguments,
    check_bands,
    finished,
    needs_prior,
    same_codes,
    tap_operator,
)
from tmca.decoders.networks.neural import NeuralDecoder, Weights, same_bands
from tmca.errors import SettingError
from tmca.priors import GaussianMixturePrior

METHODS = (
    "lmmse",
    "lmmse-adapted",
    "mixture",
    "admm-tv",
    "admm-tv-joint",
    "pnp-tv",
    "pnp-nl-means",
    "pnp-subspace",
    "tikhonov",
    "dagger",
    "network",
)


def decode(
    snapshot: Snapshot[SpectralCamera],
    method: str = "lmmse",
    *,
    prior: Prior | None = None,
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
            band or over all bands), ``"pnp-tv"``, ``"pnp-nl-means"`` (plug-and-play ADMM with a denoiser),
            ``"pnp-subspace"`` (with total variation in the scene's own spectral subspace of six dimensions),
            ``"tikhonov"`` (least squares with a smooth scene), ``"dagger"`` (least-norm, the plain baseline),
            ``"network"`` (trained).
        prior: for the first three; for a network, in the place of its own.
        weights: of the network.
        tv_weight: for total variation; chosen from the noise if None.
        uncertainty: the first three also return every entry's standard deviation.
        progress: told the share that is done.

    Raises:
        SettingError: unknown method, a prior that is missing or of the wrong kind, or a network of another camera.
    """
    check_arguments(method, METHODS, prior, weights, tv_weight)
    start = time.perf_counter()
    with torch.no_grad():
        if needs_prior(method):
            check_bands(prior, snapshot.camera.wavelengths)
            found = by_prior(snapshot, method, prior, uncertainty, progress)
        elif weights is not None:
            found = _by_network(snapshot, weights, prior, progress)
        elif method == "dagger":
            found = Decoded(snapshot.camera.A_dagger(snapshot.values))
        elif method == "tikhonov":
            found = by_smoothness(snapshot, progress)
        elif method.startswith("pnp"):
            found = by_denoiser(snapshot, method, progress)
        else:
            found = by_variation(snapshot, method == "admm-tv-joint", tv_weight, progress)
    return finished(found, method, start)


def _by_network(
    snapshot: Snapshot[SpectralCamera],
    weights: Weights,
    prior: Prior | None,
    progress: Progress | None,
) -> Decoded:
    camera, operator = snapshot.camera, tap_operator(snapshot.camera, "a network")
    if not same_bands(weights.wavelengths, camera.wavelengths):
        bands = f"{len(weights.wavelengths)} bands, {weights.wavelengths[0] * 1e9:.4g} nm and on"
        own = f"the camera's {camera.bands}, {camera.wavelengths[0] * 1e9:.4g} nm and on"
        raise SettingError("weights", bands, own, "train a network at the camera's bands")
    if isinstance(prior, GaussianMixturePrior):
        raise SettingError("prior", "a mixture", "a Gaussian prior for a network")
    check_bands(prior, snapshot.camera.wavelengths)
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
    if not getattr(weights.network, "codes", True) and not same_codes(weights, camera):
        text = f"{weights.path or 'weights'}: this network is not told the codes, and was trained for others"
        warn(text, OtherCodes, stacklevel=2)
