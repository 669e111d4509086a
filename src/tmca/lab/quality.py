"""How good a measurement is: its residual held against what good captures leave."""

from __future__ import annotations

import warnings


class Doubtful(UserWarning):
    """A residual beyond what good captures leave."""


class NotMeasured(Warning):
    """A calibration that lacks steps of its camera."""


def quality_of(source: object, name: str, residual: float, usual: float, hint: str = "") -> float:
    """A residual over what good captures leave of it at most; 0 where it is not known. Warns where that is above 1.

    Args:
        source: named in the warning.
        name: of the residual.
        residual: its value.
        usual: the largest that good captures leave.
        hint: what else may be wrong, for the warning.
    """
    quality = residual / usual if residual == residual else 0.0
    if quality > 1:
        text = f"{source}: {name} {residual:.3g}, usually {usual:g} at most{hint and f'; {hint}'}"
        warnings.warn(text, Doubtful, stacklevel=3)
    return quality


def warn_of_saturation(source: object, share: float, hint: str, stacklevel: int = 3) -> None:
    """A warning of saturated pixels, where there are any: their share and what to do."""
    if share:
        warnings.warn(f"{source}: {share:.2%} of the pixels are saturated: {hint}", Doubtful, stacklevel=stacklevel)
