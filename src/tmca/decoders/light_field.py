"""Every decoder of the light-field camera under one call."""

from __future__ import annotations

import time
from warnings import warn

import torch

from tmca.cameras import LightFieldCamera, Snapshot
from tmca.decoders.decoding import (
    Decoded,
    OtherCodes,
    Prior,
    Progress,
    by_prior,
    by_smoothness,
    by_variation,
    check_arguments,
    finished,
    needs_prior,
    same_codes,
    tap_operator,
)
from tmca.decoders.networks.neural import NeuralDecoder, Weights
from tmca.decoders.patch_based.dictionary import DictionaryDecoder
from tmca.errors import SettingError, ShapeError
from tmca.priors import PatchDictionary

LIGHT_FIELD_METHODS = ("lmmse", "mixture", "dictionary", "dictionary-omp", "admm-tv", "tikhonov", "dagger", "network")


def decode_light_field(
    snapshot: Snapshot[LightFieldCamera],
    method: str = "lmmse",
    *,
    prior: Prior | None = None,
    dictionary: PatchDictionary | None = None,
    tv_weight: float | None = None,
    weights: Weights | None = None,
    uncertainty: bool = False,
    progress: Progress | None = None,
) -> Decoded:
    """Recover the light field from a snapshot.

    Args:
        snapshot: values (B, 1, H, W), a batch of colours, and camera.
        method: ``"lmmse"`` (Gaussian prior), ``"mixture"`` (Gaussian-mixture prior), ``"dictionary"``,
            ``"dictionary-omp"`` (sparse patches in a learned dictionary, by LASSO or orthogonal matching pursuit),
            ``"admm-tv"`` (total variation view by view), ``"tikhonov"`` (least squares with smooth views), ``"dagger"``
            (least-norm, the plain baseline), ``"network"`` (trained).
        prior: for the LMMSE or the mixture; for a network, in the place of its own.
        dictionary: for the two that use it.
        tv_weight: for total variation; chosen from the noise if None.
        weights: of the network.
        uncertainty: the LMMSE and the mixture also return every entry's standard deviation.
        progress: told the share that is done.

    Returns:
        The estimate (B, V, U, H, W).

    Raises:
        SettingError: unknown method, a prior or dictionary that is missing or of the wrong kind, a network of another
            camera.
        ShapeError: one of other views.
    """
    check_arguments(method, LIGHT_FIELD_METHODS, prior, weights, tv_weight)
    _check_dictionary(method, dictionary)
    camera, start = snapshot.camera, time.perf_counter()
    if prior is not None:
        prior.check(camera)
    with torch.no_grad():
        if needs_prior(method):
            found = by_prior(snapshot, method, prior, uncertainty, progress)
        elif dictionary is not None:
            found = _by_dictionary(snapshot, method, dictionary, progress)
        elif weights is not None:
            found = _by_network(snapshot, weights, prior, progress)
        elif method == "dagger":
            found = Decoded(camera.A_dagger(snapshot.values).flatten(1, 2))
        elif method == "tikhonov":
            found = by_smoothness(snapshot, progress)
        else:
            found = by_variation(snapshot, False, tv_weight, progress)
    found.estimate = found.estimate.unflatten(1, camera.views)
    found.deviation = None if found.deviation is None else found.deviation.unflatten(1, camera.views)
    return finished(found, method, start)


def _check_dictionary(method: str, dictionary: PatchDictionary | None) -> None:
    uses = method.startswith("dictionary")
    if uses and dictionary is None:
        remedy = f"learn one with {PatchDictionary.learned_by} and name it with dictionary= (--dictionary)"
        raise SettingError("dictionary", "none", f"one for the decoder {method}", remedy)
    if dictionary is not None and not uses:
        wanted = "none: only dictionary and dictionary-omp use it"
        raise SettingError("dictionary", f"one for {method}", wanted, "leave it out")


def _by_dictionary(
    snapshot: Snapshot[LightFieldCamera], method: str, dictionary: PatchDictionary, progress: Progress | None
) -> Decoded:
    camera, noise = snapshot.camera, snapshot.camera.noise
    decoder = DictionaryDecoder(dictionary, "omp" if method == "dictionary-omp" else "lasso")
    taps = tap_operator(camera, method).taps
    return Decoded(decoder(snapshot.values, taps, noise.read, noise.shot, progress=progress).estimate)


def _by_network(
    snapshot: Snapshot[LightFieldCamera], weights: Weights, prior: Prior | None, progress: Progress | None
) -> Decoded:
    camera, operator = snapshot.camera, tap_operator(snapshot.camera, "a network")
    trained = weights.light_field_camera()
    if trained.views != camera.views:
        raise ShapeError("weights", f"{trained.views[0]}×{trained.views[1]} views", f"the camera's {camera.views}")
    for name in ("shear", "exposure"):
        own, known = getattr(camera, name), getattr(trained, name)
        if own != known:
            raise SettingError("weights", f"{name} {known}", f"the camera's {own}", "train for this camera")
    if not getattr(weights.network, "codes", True) and not same_codes(weights, camera):
        text = f"{weights.path or 'weights'}: this network is not told the codes, and was trained for others"
        warn(text, OtherCodes, stacklevel=2)
    decoder = NeuralDecoder(weights.network, weights.load_prior() if prior is None else prior)
    found = decoder(snapshot.values, operator, camera.noise, progress)
    return Decoded(found, notes={"weights": str(weights.path or "")})
