"""One transmitter behind an unknown channel: what is known of its signal, and which pulses share a message."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from tmca.dbd.arrays import Complex, Whole
from tmca.errors import SettingError, ShapeError

AXES = ("delay", "doppler", "angle")


@dataclass(frozen=True)
class Source:
    """A radar or a communications transmitter whose signal lies in a known subspace (thesis equations 56 and 57).

    The signal of pulse ``p`` at frequency ``n`` is ``rows[p, n] @ v[message[p]]`` with unknown coefficients ``v``.

    Args:
        name: what tables and files call it.
        rows: ``(P, M, J)``, the rows ``bₙᴴ`` of the basis in every pulse; ``(M, J)`` where all pulses are the same.
        message: ``(P,)``, which coefficient vector each pulse carries, not decreasing from 0: all zero for a radar
            and for ``shared`` messages, ``0 … P−1`` for ``block`` messages (57).
        weight: of this source in the sum of atomic norms, ``‖f‖ ≤ weight``; by default the root mean square of the
            rows, so that the scale of a basis makes no difference (one for Vandermonde rows, as in the thesis).

    Raises:
        ShapeError, SettingError: rows that are no basis, messages out of order, a weight that is not positive.
    """

    name: str
    rows: Complex = field(repr=False)
    message: Whole = field(repr=False)
    weight: float = None  # type: ignore[assignment]  # a float from here on

    def __post_init__(self) -> None:
        message = np.asarray(self.message)
        if not np.all(message == message.astype(np.int64)):
            raise SettingError(f"messages of {self.name}", f"{message.tolist()}", "whole numbers")
        message = message.astype(np.int64)
        rows = np.asarray(self.rows, np.complex128)
        if rows.ndim == 2:
            rows = np.broadcast_to(rows, (len(message), *rows.shape))
        object.__setattr__(self, "rows", rows)
        object.__setattr__(self, "message", message)
        _check_rows(self.name, rows)
        _check_message(self.name, rows, message)
        _check_rank(self)
        if self.weight is None:
            power = np.abs(rows) ** 2
            object.__setattr__(self, "weight", float(np.sqrt(np.mean(power[power > 0]))))
        if not (np.isfinite(self.weight) and self.weight > 0):
            raise SettingError(f"weight of {self.name}", f"{self.weight}", "a positive number")

    @property
    def messages(self) -> int:
        """Number of coefficient vectors, G."""
        return int(self.message[-1]) + 1

    @property
    def subspace(self) -> int:
        """Dimension of the signal's subspace in one pulse, J."""
        return self.rows.shape[2]

    @property
    def unknowns(self) -> int:
        """Complex unknowns of one lifted atom, G J."""
        return self.messages * self.subspace

    @cached_property
    def same_every_pulse(self) -> bool:
        """Whether all pulses have the same rows."""
        return self.rows.strides[0] == 0 or bool(np.all(self.rows == self.rows[:1]))

    @property
    def sees_doppler(self) -> bool:
        """Whether a message spans two pulses; without, every path's Doppler hides in its messages' phases."""
        return self.messages < len(self.message)

    def signal(self, coefficients: Complex) -> Complex:
        """The transmitted spectra ``(…, P, M)`` for ``coefficients`` of G J numbers in the last dimension."""
        before = coefficients.shape[:-1]
        if self.messages == 1 and self.same_every_pulse:
            spectrum = coefficients @ self.rows[0].T
            return np.broadcast_to(spectrum[..., None, :], (*before, *self.rows.shape[:2]))
        if self.messages == 1:
            return (coefficients @ self.rows.reshape(-1, self.subspace).T).reshape(*before, *self.rows.shape[:2])
        per_pulse = coefficients.reshape(*before, self.messages, self.subspace)[..., self.message, :]
        return np.matmul(self.rows, per_pulse[..., None])[..., 0]


def _check_rows(name: str, rows: Complex) -> None:
    if rows.ndim != 3 or 0 in rows.shape:
        raise ShapeError(f"basis of {name}", f"shape {rows.shape}", "(pulses, frequencies, subspace) or the last two")
    if not np.all(np.isfinite(rows)):
        bad = int(np.sum(~np.isfinite(rows)))
        raise SettingError(f"basis of {name}", f"{bad} values that are NaN or infinite", "finite values only")


def _check_message(name: str, rows: Complex, message: Whole) -> None:
    if message.shape != rows.shape[:1]:
        raise ShapeError(f"messages of {name}", f"{message.size} numbers", f"one for each of {rows.shape[0]} pulses")
    steps = np.diff(message, prepend=0)
    if message[0] != 0 or not np.all(np.isin(steps, (0, 1))):
        raise SettingError(f"messages of {name}", f"{message.tolist()}", "0 for the first pulse, then steps of 0 or 1")


def _check_rank(source: Source) -> None:
    """Coefficients that do not show in the signal cannot be found."""
    for one in range(source.messages):
        rows = source.rows[source.message == one].reshape(-1, source.subspace)
        if source.same_every_pulse:
            rows = source.rows[0]
        rank = int(np.linalg.matrix_rank(rows))
        if rank < source.subspace:
            where = f"basis of {source.name}" + (f", message {one}" if source.messages > 1 else "")
            remedy = "drop the columns that depend on others"
            raise SettingError(where, f"rank {rank} in {rows.shape[0]} x {rows.shape[1]}", "full column rank", remedy)
        if source.same_every_pulse:
            return
