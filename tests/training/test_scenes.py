"""Which scenes a run learns from: nothing that checks it, however often a scene is named."""

import numpy as np
import pytest

from tmca.data import label, write_dataset
from tmca.errors import DataError, SettingError
from tmca.training.scenes import scene_lists
from tmca.training.settings import DataSettings
from tmca.training.snapshot_camera import scene_at

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


def test_a_scene_at_the_bands_of_a_camera_bears_rounding_at_its_ends(tmp_path):
    slope = np.linspace(0.1, 0.9, 5, dtype=np.float32)[:, None, None] * np.ones((1, 2, 3), dtype=np.float32)
    file = write_dataset(label(slope, np.linspace(4e-7, 6e-7, 5) * (1 + 1e-15)), tmp_path / "scene.nc")
    bands = 4e-7 * (1 - 1e-15), 5.25e-7, 6e-7 * (1 + 1e-14)
    scene = scene_at(str(file), bands)
    np.testing.assert_allclose(scene[:, 0, 0], [0.1, 0.6, 0.9], rtol=1e-6)
    np.testing.assert_array_equal(scene["wavelength"], bands)
    with pytest.raises(DataError, match="found bands from 400 to 600 nm, expected all of 399 to 600 nm"):
        scene_at(str(file), (3.99e-7, 6e-7))
