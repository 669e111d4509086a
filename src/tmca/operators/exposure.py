"""How the K slots of one exposure add up."""

from __future__ import annotations

from tmca.errors import SettingError

EXPOSURES = ("equal", "per-slot")


def exposure_weight(exposure: str, slots: int) -> float:
    """Weight of one slot in a snapshot.

    1/K where the slots share one exposure time (``"equal"``), 1 where each has a time of its own (``"per-slot"``).

    Raises:
        SettingError: another name.
    """
    if exposure not in EXPOSURES:
        raise SettingError("exposure", repr(exposure), "'equal' (mean over slots) or 'per-slot' (sum)")
    return 1 / slots if exposure == "equal" else 1.0
