"""A sensor and its modulator as data sheets give them, and which codes and how many slots it can have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor

from tmca.arguments import checked
from tmca.codes import BURST
from tmca.design.kinds import KINDS
from tmca.errors import SettingError, check_choice, check_range
from tmca.sensor import Sensor

SLOTS = (2, 4, 8, 16)
"""Numbers of slots that are tried."""
_USUAL = ("free", "one-hot")


def family_of(kind: str) -> str:
    """How many buckets a kind of codes needs, ``"one"`` or ``"two"``; or ``"burst"``, which any sensor can take: two
    frames one after the other, the rival of all codes of several slots."""
    if kind == BURST:
        return BURST
    return "two" if KINDS[kind].get("buckets", 1) == 2 else "one"


@checked
@dataclass(frozen=True)
class SensorSheet:
    """A sensor and its modulator as their data sheets give them.

    Args:
        full_well: electrons at full scale, a white scene with everything open; None for no shot noise.
        read_noise_electrons: standard deviation, electrons; needs ``full_well``.
        read_noise: standard deviation in snapshot units, where electrons are not known.
        bits: of the converter; None for none.
        exposure: time of one snapshot, seconds; None sets no limit to the slots.
        pattern_rate: most patterns per second of the slower of aperture and shutter, Hz.
        slot_time: shortest time that a pattern may be shown, seconds.
        buckets: of a pixel, 1 or 2; each has the read noise, the full well and the converter that are given.

    Raises:
        SettingError: a number that is impossible.
    """

    full_well: float | None = None
    read_noise_electrons: float = 0.0
    read_noise: float = 0.0
    bits: int | None = None
    exposure: float | None = None
    pattern_rate: float | None = None
    slot_time: float | None = None
    buckets: int = 1

    def __post_init__(self) -> None:
        check_range("buckets", self.buckets, 1, 2)
        for name in ("exposure", "pattern_rate", "slot_time"):
            if getattr(self, name) is not None:
                check_range(name, getattr(self, name), above=0)
        if self.exposure is None and (self.pattern_rate or self.slot_time):
            raise SettingError("exposure", "none beside a pattern rate or slot time", "the exposure time in seconds")
        self.sensor().warn_of_electrons()

    def sensor(self) -> Sensor:
        """As the camera's sensor."""
        return Sensor(
            read_noise=self.read_noise, full_well=self.full_well, read_noise_electrons=self.read_noise_electrons,
            bits=self.bits,
        )  # fmt: skip

    @property
    def most_slots(self) -> int | None:
        """Slots that fit the exposure; None where nothing limits them."""
        return floor(self.exposure / self.shortest * (1 + 1e-9)) if self.exposure and self.shortest else None

    @property
    def shortest(self) -> float:
        """Time that a pattern needs, seconds; 0 where nothing limits it."""
        return max(1 / self.pattern_rate if self.pattern_rate else 0.0, self.slot_time or 0.0)

    def allowed(self, slots: Sequence[int] | None) -> list[int]:
        """Numbers of slots above 1 to try: those asked for, or those of ``SLOTS`` that fit.

        Raises:
            SettingError: one that is asked for does not fit the exposure.
        """
        most, remedy = self.most_slots, "expose longer, or use faster patterns"
        if most == 0:
            text = f"{self.exposure:g} s, shorter than one pattern"
            raise SettingError("exposure", text, f"at least {self.shortest:g} s", remedy)
        if slots is None:
            return [k for k in SLOTS if most is None or k <= most]
        for k in slots:
            check_range("slots", k, 1)
            if most is not None and k > most:
                text = f"{k} slots in an exposure of {self.exposure:g} s"
                raise SettingError("slots", text, f"at most {most}", remedy)
        return sorted({k for k in slots if k > 1})

    def kinds(self, asked: Sequence[str] | None) -> list[str]:
        """Structures of codes to try: those asked for, or free and one-hot ones, and where pixels have two buckets
        those of two buckets; in the order in which one starts from others.

        Raises:
            SettingError: an unknown one, or one that needs a second bucket.
        """
        kinds = [*_USUAL, *(["two-bucket"] if self.buckets == 2 else [])] if asked is None else dict.fromkeys(asked)
        for kind in kinds:
            check_choice("kinds", kind, KINDS)
            if family_of(kind) == "two" and self.buckets == 1:
                remedy = "give 2 buckets if the sensor has them (--buckets 2)"
                raise SettingError("kinds", f"{kind} with one bucket a pixel", "codes of one bucket", remedy)
        return sorted(kinds, key=lambda kind: (family_of(kind) == "two", kind == "free"))
