"""What bands beyond the learned wavelengths lose: which bands count, and means over the scenes."""

import pytest
import torch

from studies.beyond import BANDS, BY, MEANS, cut, figures
from studies.tables import pooled


def test_bands_beyond_are_those_outside_of_the_ends():
    scene = torch.zeros(len(BANDS), 4, 5)
    estimate = scene.clone()
    estimate[[0, -1]] = 0.1
    row = figures(estimate, scene, BANDS, (410e-9, 690e-9))
    assert row["beyond"] == pytest.approx(20)
    assert row["inside"] > 100
    assert row["all"] == pytest.approx(20 + 10 * torch.log10(torch.tensor(len(BANDS) / 2)).item())


def test_rows_are_pooled_by_codes_decoder_and_what_was_withheld():
    row = {"codes": "static", "decoder": "lmmse", "withheld": 10, "scene": "a"}
    row |= dict.fromkeys(("all", "beyond", "inside", "loss"), 30.0)
    pair, alone = pooled([row, row | {"scene": "b", "loss": 32.0}, row | {"withheld": 20}], BY, MEANS)
    assert (pair["loss"], alone["loss"], alone["withheld"]) == (31.0, 30.0, 20)


def test_the_middle_is_cut_out():
    cube = torch.arange(200 * 256).reshape(1, 200, 256)
    assert torch.equal(cut(cube), cube[:, 36:164, 48:208])
