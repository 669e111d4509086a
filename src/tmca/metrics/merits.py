"""What figures of merit are measured in, and which way is better: one table for all that print them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import nan


@dataclass(frozen=True)
class Merit:
    """A figure of merit.

    Args:
        unit: such as ``dB``; empty of a number without one.
        higher: whether more is better; None of what says no more than what was measured.
        about: what it is, where its name does not say.
    """

    unit: str
    higher: bool | None
    about: str = ""

    @property
    def direction(self) -> str:
        """Which way is better, in words."""
        return "" if self.higher is None else "higher is better" if self.higher else "lower is better"

    @property
    def meaning(self) -> str:
        """Unit, what it is, and which way is better."""
        return ", ".join(part for part in (self.unit, self.about, self.direction) if part)


MERITS: dict[str, Merit] = {
    "psnr": Merit("dB", True),
    "psnr_min": Merit("dB", True, "of the worst view"),
    "psnr_max": Merit("dB", True, "of the best view"),
    "ssim": Merit("", True, "structural similarity, at most 1"),
    "uiqi": Merit("", True, "universal image quality index, at most 1"),
    "sam": Merit("degrees", False, "spectral angle"),
    "ergas": Merit("%", False, "relative global error over all bands"),
    "dd": Merit("", False, "degree of distortion, the mean absolute error"),
    "coverage_1s": Merit("", None, "share of values within ±1σ of the truth, 0.68 expected"),
    "coverage_2s": Merit("", None, "share of values within ±2σ of the truth, 0.95 expected"),
    "rank_correlation": Merit("", True, "of σ with the error, by ranks; at most 1"),
    "disparity_mae": Merit("px per view step", False),
    "disparity_badpix": Merit("", False, "share of pixels"),
    "disparity_mae_of_constant": Merit("px per view step", None, "the same of a constant guess, the true median"),
    "disparity_agreement_mae": Merit("px per view step", False, "from the disparity matched in the true views"),
    "disparity_agreement_badpix": Merit("", False, "share of pixels"),
    "disparity_agreement_mae_of_constant": Merit("px per view step", None, "the same of a constant guess, the median"),
    "disparity_spread": Merit("px per view step", None, "from 5 to 95 % of the pixels, near 0 of a flat map"),
    "depth_mae": Merit("m", False),
    "depth_mae_of_constant": Merit("m", None, "the same of a constant guess, the median of the true depth"),
    "depth_rmse": Merit("m", False),
    "within_bin": Merit("", True, "share of pixels"),
    "depth_coverage_1s": Merit("", None, "share of depths within ±1σ of the truth, 0.68 expected"),
    "depth_coverage_2s": Merit("", None, "share of depths within ±2σ of the truth, 0.95 expected"),
    "depth_rank_correlation": Merit("", True, "of the depth's σ with its error, by ranks; at most 1"),
    "known_depth": Merit("", None, "share of pixels whose true depth is known"),
}
"""Figures of merit by name, those of all cameras of this package."""
_SIGNS = {"degrees": "°"}


def meaning(metric: str) -> str:
    """Unit of a metric and which way is better, in words; nothing of one that a camera of another package brings."""
    return MERITS[metric].meaning if metric in MERITS else ""


def with_unit(metric: str, value: float, form: str = ".4g") -> str:
    """A value with its unit, such as ``31.2 dB``."""
    unit = MERITS[metric].unit if metric in MERITS else ""
    sign = _SIGNS.get(unit, f" {unit}" if unit else "")
    return f"{value:{form}}{sign}"


_BETTER = 0.98
"""Share of the error of a constant guess from which an error is no better."""


def beside_constant(metrics: Mapping[str, float]) -> list[str]:
    """A line for each error of depth or disparity that is not below that of a constant guess by more than 2 %."""
    lines = []
    for name, error in metrics.items():
        guess = metrics.get(f"{name}_of_constant", nan)
        if error > 0 and error >= _BETTER * guess:
            less = "less" if error > guess else "no more"
            both = f"{with_unit(name, error)} beside the {with_unit(name, guess)} of the guess"
            lines.append(f"the {name.partition('_')[0]} says {less} than a constant guess, mean error {both}")
    return lines
