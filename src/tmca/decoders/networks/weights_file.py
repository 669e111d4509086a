"""The file of a trained network: one safetensors, a network in half precision, what it is as JSON in its head."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn

from tmca.errors import DataError

FORMAT = "tmca weights 1"


def write_weights(
    path: str | Path, network: nn.Module, codes: Mapping[str, Tensor], about: Mapping[str, Any], *, overwrite: bool
) -> Path:
    """Write a network and the tensors of a camera, whole or not at all.

    Raises:
        OutputError: the file exists, or cannot be written.
    """
    from tmca.data import atomic_path, plain

    tensors = {f"network.{k}": v.detach().cpu().half().contiguous() for k, v in network.state_dict().items()}
    tensors |= {name: value.detach().cpu().contiguous() for name, value in codes.items()}
    with atomic_path(path, overwrite=overwrite) as temporary:
        temporary.write_bytes(save(tensors, {"format": FORMAT, "tmca": json.dumps(plain(dict(about)))}))
    return Path(path)


def read_weights(path: str | Path) -> tuple[Path, dict[str, Any], dict[str, Tensor]]:
    """The file (of a run's folder, the one in it), what it is, and its tensors.

    Raises:
        DataError: no such file, or no weights in it.
    """
    path = Path(path) / "weights.safetensors" if Path(path).is_dir() else Path(path)
    if not path.is_file():
        raise DataError(path, "no such file", "weights from `tmca train`", "train a network and name its file")
    try:
        with safe_open(path, "pt") as file:
            head = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise DataError(path, f"no readable weights ({error})", "a safetensors file", "copy it again") from error
    if head.get("format") != FORMAT:
        raise DataError(path, "a safetensors file of something else", "weights from `tmca train`")
    return path, json.loads(head["tmca"]), tensors


def fill_network(network: nn.Module, tensors: Mapping[str, Tensor], path: Path) -> None:
    """Take over the network's own tensors.

    Raises:
        DataError: tensors that do not fit it.
    """
    own = {k.removeprefix("network."): v.float() for k, v in tensors.items() if k.startswith("network.")}
    try:
        network.load_state_dict(own)
    except RuntimeError as error:
        raise DataError(path, f"tensors that do not fit its network ({error})", "whole weights") from error
