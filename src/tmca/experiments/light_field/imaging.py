"""`reconstruct` as comparisons and studies of the light-field camera call it: a dictionary is a prior."""

from __future__ import annotations

from typing import Any

from tmca.cameras import Snapshot
from tmca.experiments.reconstructions import Reconstruction, reconstruct


def reconstruct_light_field(
    snapshot: Snapshot[Any], decoder: str | None = None, *, prior: Any = None, dictionary: Any = None, **how: Any
) -> Reconstruction:
    """`reconstruct`, where the dictionary is the prior of its decoders."""
    return reconstruct(snapshot, decoder, prior=prior if dictionary is None else dictionary, **how)
