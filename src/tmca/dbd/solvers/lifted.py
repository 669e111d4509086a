"""What every method hands on."""

from __future__ import annotations

from dataclasses import dataclass

from tmca.dbd.arrays import Complex
from tmca.dbd.atoms.measure import Measure
from tmca.dbd.estimates.channels import Channel


@dataclass
class Lifted:
    """A solution of the lifted problem and the channels in it.

    Args:
        measure: lifted atoms.
        channels: with one waveform a source.
        q: ``(A, P, M)``, the dual variable.
        sigma: standard deviation of the noise it was solved for; 0 for none.
        notes: what is doubtful about it.
    """

    measure: Measure
    channels: list[Channel]
    q: Complex
    sigma: float
    notes: tuple[str, ...] = ()
