"""Codes and masks for a sensor: searched, judged on example scenes, written as files with a page that explains them."""

from tmca.reports.cameras import design_codes, design_light_field, design_spectral
from tmca.reports.judged import judge_codes
from tmca.reports.masks import design_spectral_depth

__all__ = ["design_codes", "design_light_field", "design_spectral", "design_spectral_depth", "judge_codes"]


def __dir__() -> list[str]:
    return sorted(__all__)
