"""Height maps as Zernike terms of a deformable mirror, in micrometres of its surface."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from tmca.errors import DataError, SettingError
from tmca.lab.devices.descriptions import DeviceDescription
from tmca.lab.devices.sources import Planes
from tmca.optics.zernike import fit_zernike, noll, zernike_modes

COLUMNS = ("slot", "noll", "n", "m", "rms_um", "peak_um")
_DIGITS = 9
_PUPIL = (129, 129)
"""Pixels over which a surface is looked at."""


@dataclass(frozen=True)
class Terms:
    """Zernike terms of K mirror shapes.

    Args:
        noll: index of every term.
        rms: (K, M) metres of surface, root mean square over the pupil.
        residual: (K,) metres rms of what the terms leave of the heights.
    """

    noll: tuple[int, ...]
    rms: NDArray[np.float64]
    residual: NDArray[np.float64]

    def peak_to_valley(self) -> NDArray[np.float64]:
        """(K,) metres between the highest and the lowest place of every surface over the pupil."""
        disk = zernike_modes([(0, 0)], _PUPIL)[0].numpy() != 0
        surfaces = np.tensordot(self.rms, zernike_modes([noll(index) for index in self.noll], _PUPIL).numpy(), 1)
        return np.asarray(np.ptp(surfaces[:, disk], axis=1))


def terms_of(codes: Planes, device: DeviceDescription) -> Terms:
    """Terms of a mirror that shows height maps.

    Args:
        codes: with ``heights`` of a mirror.
        device: a deformable mirror.

    Raises:
        SettingError: heights of a mask that is no mirror, or terms beyond the stroke.
    """
    material = (codes.settings or {}).get("material", "mirror")
    if material != "mirror":
        raise SettingError(codes.source, f"a mask of {material}", "one of mirror heights", "design it on a mirror")
    heights = codes.full("heights").double()
    modes = [noll(index) for index in device.noll]
    fits = [fit_zernike(one - one.mean(), modes) for one in heights]
    found = Terms(
        device.noll,
        np.stack([fit[0].numpy() for fit in fits]),
        np.array([_rms(fit[1]) for fit in fits]),
    )
    _check_stroke(found, device, codes.source)
    return found


def _rms(left: torch.Tensor) -> float:
    inside = left != 0
    values = left[inside]
    return float((values - values.mean()).square().mean().sqrt()) if int(inside.sum()) else 0.0


def peak(index: int) -> float:
    """Largest magnitude of a Noll mode over the pupil, of one of unit root mean square."""
    n, m = noll(index)
    return float((n + 1) ** 0.5 * (1 if m == 0 else 2**0.5))


def _check_stroke(terms: Terms, device: DeviceDescription, source: str) -> None:
    assert device.stroke_um is not None
    peaks = np.abs(terms.rms) * [peak(index) for index in terms.noll] * 1e6
    slot, term = np.unravel_index(int(peaks.argmax()), peaks.shape)
    if peaks[slot, term] > device.stroke_um:
        found = f"{peaks[slot, term]:.3g} µm of term {terms.noll[term]} in slot {slot}"
        wanted = f"{device.stroke_um:g} µm at most, the stroke of {device.name}"
        raise SettingError(source, found, wanted, "design masks within the stroke (--stroke)")
    spans = terms.peak_to_valley() * 1e6
    if device.total_stroke_um is not None and spans.max() > device.total_stroke_um:
        found = f"{spans.max():.3g} µm between peak and valley in slot {int(spans.argmax())}"
        wanted = f"{device.total_stroke_um:g} µm at most, the total stroke of {device.name}"
        raise SettingError(source, found, wanted, "design masks within the stroke (--stroke)")


def table(terms: Terms) -> str:
    """CSV with a line for every slot and term."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(COLUMNS)
    for slot, values in enumerate(terms.rms * 1e6):
        for index, value in zip(terms.noll, values, strict=True):
            rows.writerow((slot, index, *noll(index), round(value, _DIGITS), round(value * peak(index), _DIGITS)))
    return text.getvalue()


def read_table(file: Path) -> Terms:
    """What ``table`` wrote.

    Raises:
        DataError: no such table, or a term that is missing in a slot.
    """
    try:
        rows = list(csv.DictReader(file.read_text(encoding="utf-8").splitlines()))
        values = {(int(row["slot"]), int(row["noll"])): float(row["rms_um"]) for row in rows}
    except (OSError, KeyError, TypeError, ValueError, UnicodeDecodeError):
        raise DataError(file, "no table of Zernike terms", f"columns {', '.join(COLUMNS)}", "export again") from None
    slots, indices = sorted({slot for slot, _ in values}), list(dict.fromkeys(int(row["noll"]) for row in rows))
    if not values or slots != list(range(len(slots))) or len(values) != len(slots) * len(indices):
        raise DataError(file, f"{len(values)} terms of {len(slots)} slots", "every term in every slot", "export again")
    rms = np.array([[values[slot, index] for index in indices] for slot in slots]) * 1e-6
    return Terms(tuple(indices), rms, np.full(len(slots), np.nan))
