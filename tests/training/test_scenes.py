"""Which scenes a run learns from: nothing that checks it, however often a scene is named."""

import pytest

from tmca.errors import SettingError
from tmca.training.scenes import scene_lists
from tmca.training.settings import DataSettings

NAMES = ("astronaut", "chelsea", "rocket", "retina", "tissue")


@pytest.mark.parametrize("seed", range(6))
def test_drawn_scenes_are_apart_however_often_they_are_named(seed):
    lists = scene_lists(DataSettings(train=NAMES * 3, prior=NAMES, shares=(0.6, 0.2, 0.2)), seed)
    parts = [set(lists.train), set(lists.validation), set(lists.test)]
    assert set.union(*parts) == set(NAMES)
    assert sum(map(len, parts)) == len(NAMES)
    assert len(lists.train) == 3 * len(parts[0])
    assert len(lists.validation) == len(parts[1])
    assert set(lists.prior) == parts[0]


def test_given_validation_scenes_are_no_training_scenes():
    lists = scene_lists(DataSettings(train=NAMES[:3], validation=NAMES[3:]), 0)
    assert (lists.train, lists.validation) == (NAMES[:3], NAMES[3:])
    with pytest.raises(SettingError, match="astronaut, a training scene"):
        scene_lists(DataSettings(train=NAMES, validation=NAMES[:1]), 0)


def test_a_prior_of_scenes_drawn_for_validation_is_refused():
    drawn = scene_lists(DataSettings(train=NAMES), 0).validation
    with pytest.raises(SettingError, match="drawn for validation"):
        scene_lists(DataSettings(train=NAMES, prior=drawn), 0)


@pytest.mark.parametrize("changes", [{"shares": (0, 0, 0)}, {"shares": (-1, 1, 1)}], ids=["nothing", "negative"])
def test_impossible_shares_are_refused(changes):
    from tmca.training import training_settings

    with pytest.raises(SettingError, match="shares"):
        training_settings("spectral", None, None, {"data": changes})
