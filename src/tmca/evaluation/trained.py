"""Trained weights in a study: whether they fit its camera and scenes, their name, and what they learned from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from tmca.decoders import Weights
from tmca.decoders.nets.bands import check_bands
from tmca.decoders.nets.weights import RENDERED
from tmca.errors import DataError, SettingError, ShapeError
from tmca.evaluation.study import Study

NETWORK = "network"
"""The decoder that needs weights."""


def check_weights(decoder: str, settings: Mapping[str, Any], kind: str, where: str) -> None:
    """Refuse the decoder ``network`` without weights, with some that cannot be read, or with those of another kind of
    camera; networks of a study bring what it trained.

    Raises:
        SettingError: at ``where``.
    """
    if decoder != NETWORK:
        return
    name = settings.get("weights")
    if not isinstance(name, str | Path) or not str(name):
        found = f"{name!r} for the decoder network" if name else "none for the decoder network"
        raise SettingError(where, found, "a run or file of `tmca train`, or weights that come with tmca")
    try:
        Weights.find(name, kind=kind).check_kind(kind)
    except DataError as error:
        raise SettingError(where, f"{error.where}: {error.found}", error.expected, error.remedy) from None


def shown_name(weights: str | Path) -> str:
    """A short name of weights: their run's, their file's, or the one that they come with tmca by."""
    path = Path(weights)
    if path.is_dir():
        return path.resolve().name
    return path.resolve().parent.name if path.name == "weights.safetensors" else path.name.removesuffix(path.suffix)


def check_trained(study: Study, source: str) -> None:
    """Refuse weights for other bands or views than the scenes have.

    Args:
        study: whose codes or network they are.
        source: one of its scenes.

    Raises:
        SettingError, ShapeError: others.
    """
    used = [*_weights(study)]
    if not used:
        return
    parts = study.evaluation.parts(study.evaluation.load(source, study.reading, measured=True))
    for _, weights in used:
        if weights.any_bands:
            weights.network.at(parts["bands"])
        elif "bands" in parts:
            check_bands(weights.wavelengths, parts["bands"], "the scene's")
        elif "views" in parts and (own := tuple(weights.camera.scene_shape[:-2])) != tuple(parts["views"]):
            found, wanted = ("×".join(map(str, views)) for views in (own, parts["views"]))
            raise ShapeError("weights", f"{found} views", f"the scene's {wanted}", "read as many views of the scenes")


def learned_from(study: Study) -> list[str]:
    """A line for each measured scene that weights of the study learned from, or the prior that their network starts
    from; they do better there than elsewhere."""
    said = []
    for name, weights in _weights(study):
        used = [scene for part in ("scenes", "validation") for scene in weights.card.get(part, ())]
        used += study.evaluation.rendered().get("train", ()) if weights.prior == RENDERED else ()
        known = {_stem(scene) for scene in used}
        for scene in study.scenes.test:
            if _stem(scene) in known:
                said.append(f"{Path(scene).name} is a scene that the weights {shown_name(name)} learned from.")
    return list(dict.fromkeys(said))


def _stem(scene: str) -> str:
    """Name of a scene without its folder, ending, and number of an arrangement, as in coffee:1."""
    return Path(scene).name.partition(":")[0].removesuffix(Path(scene).suffix)


def _weights(study: Study) -> Iterator[tuple[str, Weights]]:
    """Weights by the names under which the study has them: of the network, and of codes."""
    network = study.options.get(NETWORK, {}).get("weights") if NETWORK in study.decoders else None
    if network is not None:
        yield str(network), Weights.find(network, kind=study.camera)
    for code in study.codes.values():
        if code.weights is not None:
            yield code.weights, Weights.load(str(code.shown(study.camera)))
