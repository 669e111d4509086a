"""How a number beyond a limit is said."""

from __future__ import annotations

from math import ceil, isfinite


def beyond(value: float, unit: str = "") -> str:
    """A number above its limit, rounded up to hundredths, so that it never reads as the limit itself.

    Args:
        value: it.
        unit: put behind it; ``"%"`` of a share.
    """
    if not isfinite(value):
        return "no number"
    whole = ceil(100 * value - 1e-9) / 100
    return f"{whole:.0%}" if unit == "%" else f"{whole:.2f} {unit}".rstrip()
