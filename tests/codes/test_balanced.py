"""Balanced choices: each as often, in random order."""

import pytest
import torch

from tmca.cameras import SpectralDepthCamera
from tmca.codes import balanced_choice, one_hot_planes
from tmca.errors import SettingError


@pytest.mark.parametrize(("count", "size"), [(4, (4, 4)), (3, (5, 4)), (5, (3, 3)), (1, (2, 3))])
def test_every_choice_is_made_as_often(count, size):
    found = balanced_choice(count, size, 3)
    often = torch.bincount(found.flatten(), minlength=count)
    assert int(often.max() - often.min()) <= 1
    assert torch.equal(found, balanced_choice(count, size, 3))
    planes = one_hot_planes(found, count)
    assert torch.equal(planes.sum(0), torch.ones(size))
    assert torch.equal(planes.argmax(0), found)


def test_seeds_differ_and_nothing_to_choose_is_refused():
    assert not torch.equal(balanced_choice(4, (6, 6), 0), balanced_choice(4, (6, 6), 1))
    with pytest.raises(SettingError, match="choices"):
        balanced_choice(0, (2, 2))


@pytest.mark.parametrize("seed", range(4))
def test_small_tiles_of_shutter_and_filters_leave_no_slot_and_no_filter_out(seed):
    made = SpectralDepthCamera.from_preset("quick", size=(32, 32), shutter="one-hot", seed=seed)
    torch.testing.assert_close(made.shutter().mean((1, 2)), torch.full((4,), 0.25))
    assert torch.bincount(made.filters.cells().flatten(), minlength=4).tolist() == [4] * 4
