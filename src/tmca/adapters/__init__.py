"""Ways to and from other libraries: deepinv's physics and reconstructors, napari's layers, PyTorch's data sets."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tmca.adapters.datasets import SceneDataset, SnapshotDataset
    from tmca.adapters.deepinv import as_deepinv, from_deepinv
    from tmca.adapters.napari import to_napari

_HOMES = {
    "SceneDataset": "datasets",
    "SnapshotDataset": "datasets",
    "as_deepinv": "deepinv",
    "from_deepinv": "deepinv",
    "to_napari": "napari",
}

__all__ = ["SceneDataset", "SnapshotDataset", "as_deepinv", "from_deepinv", "to_napari"]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f"tmca.adapters.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'tmca.adapters' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
