"""Patches whose first estimates are kept: the same numbers, computed once."""

import numpy as np
import pytest
import torch

from tests.training import tiny
from tmca.decoders import Weights
from tmca.errors import SettingError
from tmca.training.pool import Pool

FIXED = {"camera.learn": "none", "codes.frozen": 0.0}


def pool_of(*counts, seed=0, folder=None, compute=None):
    return Pool.of(*counts, seed=seed, folder=folder, compute=compute)


def test_a_group_is_computed_once(tmp_path):
    asked = []

    def compute(step, places):
        asked.append((step, len(places)))
        return torch.arange(32.0).reshape(8, 1, 2, 2) + step

    pool, again = (pool_of(8, 2, 1, 5, folder=tmp_path / "starts", compute=compute) for _ in range(2))
    for one in (pool, again):
        torch.testing.assert_close(one.starts(5, [4, 0])[:, 0, 0, 0], torch.tensor([21.0, 5.0]))
    assert asked == [(5, 8)]
    assert np.load(tmp_path / "starts" / "0000005.npy").shape == (8, 1, 2, 2)
    pool.delete()
    assert not (tmp_path / "starts").exists()


def test_a_pool_changes_speed_but_no_first_estimate(tmp_path, monkeypatch):
    """Without the files every batch of the pool is estimated anew: the run ends the same, to half precision."""
    kept = tiny.train(tmp_path / "kept", **FIXED)
    monkeypatch.setattr(Pool, "starts", lambda self, step, places: None)
    fresh = tiny.train(tmp_path / "fresh", **FIXED)
    assert kept.best["psnr"] == pytest.approx(fresh.best["psnr"], abs=0.02)
    assert not (tmp_path / "kept" / "starts").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("small_mixtures")
def test_a_network_starts_from_the_mixture_where_codes_are_fixed(tmp_path):
    mixture = {**tiny.DESCRIBED["decoder"], "start": "mixture"}
    found = Weights.load(tiny.train(tmp_path / "run", **FIXED, decoder=mixture).weights)
    assert type(found.load_prior()).__name__ == "GaussianMixturePrior"
    with pytest.raises(SettingError, match="through_start"):
        tiny.train(tmp_path / "learned", decoder=mixture)


def test_the_prior_has_scenes_of_its_own(tmp_path):
    brief = {**FIXED, "optimiser.steps": 1}
    tiny.train(tmp_path / "one", **brief, **{"data.prior": ["second"]})
    tiny.train(tmp_path / "two", **brief)
    priors = [(tmp_path / name / "prior.nc").read_bytes() for name in ("one", "two")]
    assert priors[0] != priors[1]
    with pytest.raises(SettingError, match="third, a training scene"):
        tiny.train(tmp_path / "three", **{"data.prior": ["third"]})
