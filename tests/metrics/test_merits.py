"""Every figure of merit that is printed has a unit and says which way is better."""

import numpy as np
import pytest

from tmca.applications import LightFieldApplication, SpectralApplication, SpectralDepthApplication
from tmca.metrics import MERITS, all_metrics, light_field_metrics, meaning, with_unit


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
