"""Priors of the patch likelihood: given, from a file, or of the rendered scenes."""

import pytest
import torch

from tests.priors.test_spectral_depth import BENCH, camera, prior_of
from tmca.decoders.patch_based import depth_prior
from tmca.decoders.patch_based.depth_prior import find_depth_prior
from tmca.errors import DataError
from tmca.priors import GaussianMixturePrior


def test_a_prior_is_taken_as_it_is_or_read(tmp_path):
    prior, made = prior_of((12, 12)), camera(4)
    assert find_depth_prior(prior, made) is prior
    read = find_depth_prior(prior.save(tmp_path / "prior.nc"), made)
    torch.testing.assert_close(read.covariance, prior.covariance)


def test_a_mixture_is_refused_in_one_line(tmp_path):
    examples = [torch.rand(2, 20, 20, generator=torch.Generator().manual_seed(0))]
    mixture = GaussianMixturePrior.learn(examples, (4, 4), kinds=2, rank=8, samples=200)
    file = mixture.save(tmp_path / "mixture.nc")
    for prior, where in ((file, r"mixture\.nc"), (mixture, "prior")):
        with pytest.raises(DataError, match=f"{where}: found a mixture prior, expected a Gaussian prior"):
            find_depth_prior(prior, camera(4))


@pytest.mark.parametrize(("period", "window", "side"), [(2, None, 12), (2, 4, 12), (2, 15, 15), (16, None, 16)])
def test_the_rendered_scenes_prior_holds_windows_of_the_usual_size(monkeypatch, period, window, side):
    asked = []
    monkeypatch.setattr(depth_prior, "rendered_prior", lambda *_, block: asked.append(block) or prior_of((6, 6)))
    find_depth_prior(None, camera(4, size=(40, 40), period=period), window)
    assert asked == [(side + BENCH.window[0] - 1, side + BENCH.window[1] - 1)]
