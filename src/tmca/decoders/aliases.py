"""Names of version 0.1, for one version more."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tmca.cameras import Snapshot
from tmca.decoders.decoder import Progress, decode
from tmca.decoders.estimate import Estimate
from tmca.decoders.nets.weights import Weights

Decoded = Estimate


def decode_light_field(
    snapshot: Snapshot[Any], method: str = "lmmse", *, prior: Any = None, dictionary: Any = None,
    progress: Progress | None = None, **settings: Any,
) -> Estimate:  # fmt: skip
    """`decode`, where the dictionary is the prior of its decoders."""
    given = {name: value for name, value in settings.items() if value is not None and value is not False}
    return decode(snapshot, method, prior=prior if dictionary is None else dictionary, progress=progress, **given)


def find_weights(name: str | Path, slots: int = 8) -> Weights:
    """`Weights.find`."""
    return Weights.find(name, slots)
