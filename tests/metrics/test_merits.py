"""Every figure of merit that is printed has a unit and says which way is better."""

import numpy as np
import pytest

from tmca.applications import LightFieldApplication, SpectralApplication, SpectralDepthApplication
from tmca.metrics import MERITS, all_metrics, beside_constant, light_field_metrics, meaning, with_unit


def test_all_that_are_measured_are_in_the_table():
    rng = np.random.default_rng(0)
    measured = {*all_metrics(*rng.random((2, 3, 16, 16))), *light_field_metrics(*rng.random((2, 3, 3, 16, 16)))}
    columns = [name for one in (SpectralApplication, LightFieldApplication, SpectralDepthApplication)
               for name, _, _ in one.columns]  # fmt: skip
    assert measured | {*columns} <= set(MERITS)


@pytest.mark.parametrize("name", ["psnr", "sam", "depth_mae", "disparity_mae"])
def test_a_worse_value_is_on_the_side_that_the_table_says(name):
    assert MERITS[name].higher is (name == "psnr")


def test_in_words():
    assert meaning("psnr") == "dB, higher is better"
    assert meaning("known_depth") == "share of pixels whose true depth is known"
    assert meaning("of_another_package") == ""
    assert [with_unit("psnr", 31.234), with_unit("sam", 5.0), with_unit("other", 2.0)] == ["31.23 dB", "5°", "2"]


def test_errors_that_are_not_below_a_constant_guess_are_said():
    worse = {"depth_mae": 0.3, "depth_mae_of_constant": 0.2, "disparity_agreement_mae": 0.99, "psnr": 1.0}
    depth, disparity = beside_constant({**worse, "disparity_agreement_mae_of_constant": 1.0})
    assert depth == "the depth says less than a constant guess, mean error 0.3 m beside the 0.2 m of the guess"
    assert disparity.startswith("the disparity says no more than a constant guess, mean error 0.99 px per view step")
    better = {"depth_mae": 0.97, "depth_mae_of_constant": 1.0, "disparity_mae": 0.5}
    assert beside_constant({**better, "disparity_mae_of_constant": np.nan}) == []
