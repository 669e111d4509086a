"""What priors lose on new scenes: means over the scenes, and the very scene gains."""

import numpy as np
import xarray as xr

import tmca
from studies.tables import pooled
from studies.transfer import BANDS, BY, CAMERA, MEANS, decibels
from tests.small_scenes import smooth_scene
from tmca.priors import learn_prior


def test_rows_are_pooled_by_the_number_of_scenes():
    row = {"scenes": 3, "scene": "a", "left_out": 30.0, "known": 31.0, "alone": 33.0, "gap": 1.0}
    other = row | {"scene": "b", "left_out": 34.0, "gap": -3.0}
    three, sixteen = pooled([row, other, row | {"scenes": 16, "gap": 0.25}], BY, MEANS)
    assert (three["left_out"], three["gap"], three["alone"]) == (32.0, -1.0, 33.0)
    assert (sixteen["scenes"], sixteen["gap"]) == (16, 0.25)


def test_a_prior_of_the_very_scene_is_better_than_one_of_another():
    waves = np.linspace(400e-9, 700e-9, BANDS)
    cubes = [smooth_scene(40, 48, BANDS, seed=seed) for seed in (1, 2)]
    new, old = (
        xr.DataArray(np.asarray(one).clip(0, 1), {"wavelength": waves}, ("wavelength", "y", "x")) for one in cubes
    )
    camera = tmca.SpectralCamera(waves.tolist(), (40, 48), **CAMERA)
    snapshot = tmca.simulate(new, camera, progress=False)
    known, left_out = (decibels(snapshot, learn_prior([one], camera), new) for one in (new, old * 0.3))
    assert known > left_out + 1
