"""What a file of trained weights holds, for people and programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tmca.decoders.nets.weights import Weights

SUFFIX = ".safetensors"
"""Of files of weights."""


def describe_weights(path: str | Path) -> dict[str, Any]:
    """Camera, decoder, bands and size of a file of weights, in plain JSON types.

    Args:
        path: a file that `tmca train` wrote.

    Returns:
        ``kind`` "weights", ``camera``, ``decoder`` (class, settings, how many numbers it learned), ``slots``, ``bands``
        (None without), ``size``, ``period`` (None of codes that do not repeat), ``codes`` (name → shape; none of a
        network of any codes), ``prior``, ``scenes`` that it learned from, ``best`` validation figures.

    Raises:
        DataError: no such file, or one that holds no weights.
    """
    weights = Weights.load(path)
    network, card = weights.network, weights.card
    nm = [1e9 * metres for metres in weights.wavelengths]
    return {
        "path": str(path), "kind": "weights", "format": f"safetensors, {Path(path).stat().st_size / 1e6:.1f} MB",
        "camera": weights.kind, "slots": weights.slots, "size": list(weights.size),
        "period": None if weights.period is None else list(weights.period),
        "any_codes": weights.any_bands,
        "codes": {} if weights.any_bands else {name: list(code.shape) for name, code in weights.codes.items()},
        "bands": {"count": len(nm), "first_nm": nm[0], "last_nm": nm[-1]} if nm else None,
        "decoder": {"network": type(network).__name__, "settings": dict(getattr(network, "settings", {})),
                    "parameters": sum(one.numel() for one in network.parameters())},
        "prior": weights.prior, "scenes": list(card.get("scenes", ())), "best": dict(card.get("best", {})),
    }  # fmt: skip


def weights_lines(about: dict[str, Any]) -> list[str]:
    """The same for people, a line a subject."""
    bands, decoder, sides = about["bands"], about["decoder"], "×".join(map(str, about["size"]))
    settings = ", ".join(f"{name} {_said(value)}" for name, value in decoder["settings"].items())
    codes = ", ".join(f"{name} {'×'.join(map(str, shape))}" for name, shape in about["codes"].items())
    lines = [f"{about['path']}: weights of a network for a {about['camera']} camera ({about['format']})"]
    lines.append(f"  decoder: {decoder['network']}, {decoder['parameters']} parameters ({settings})")
    if about["any_codes"]:
        lines.append("  camera: any bands from 400 to 700 nm, any codes, any size")
    else:
        lines.append(f"  camera: {about['slots']} slots, trained at {sides} pixels")
        lines.append(f"  codes: {codes}" + (", repeated over the frame" if about["period"] else ""))
        if bands:
            lines.append(f"  bands: {bands['count']}, {bands['first_nm']:.4g} to {bands['last_nm']:.4g} nm")
    lines.append(f"  prior: {about['prior'] or 'none'}")
    best = ", ".join(f"{name} {value:.4g}" for name, value in about["best"].items())
    learned = [f"  learned from: {', '.join(map(str, about['scenes']))}"] if about["scenes"] else []
    return [*lines, *learned, *([f"  best on validation scenes: {best}"] if best else [])]


def _said(value: Any) -> str:
    return "×".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
