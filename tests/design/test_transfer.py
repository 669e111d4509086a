"""Pooled priors and the error on scenes that are not what the prior says."""

import pytest
import torch

from tests.design.small_designs import PRIOR, block_error, designed
from tests.small_scenes import smooth_scene
from tmca.design.expected_error import windows
from tmca.design.measures import block_matrices
from tmca.design.transfer import TransferMse, example_bytes, learn_examples
from tmca.errors import DataError, SettingError, ShapeError
from tmca.priors import GaussianPrior, pooled

WAVES = (4e-7, 5e-7, 6e-7)
SCENES = {name: smooth_scene(20 + 7 * s, 33, seed=10 + s) * (1 + s) for s, name in enumerate("abc")}


@pytest.fixture(scope="module")
def examples():
    return learn_examples(SCENES, block_error().model, WAVES)


def seen():
    return windows(designed().taps().code.detach().double(), PRIOR.block, [(0, 0), (1, 2)])


@pytest.mark.parametrize("noise", [(0.05, 0.0), (0.02, 0.01)])
def test_a_scene_that_is_as_the_prior_says_errs_as_expected(noise):
    error = block_error()
    found = TransferMse.of(error, PRIOR, PRIOR)(seen(), *noise)
    torch.testing.assert_close(found, error.under(*noise)(seen()), rtol=1e-8, atol=0)


@pytest.mark.parametrize("noise", [(0.05, 0.0), (0.02, 0.01)])
def test_the_error_on_another_scene_is_that_of_dense_matrices(noise):
    scene = GaussianPrior.learn([SCENES["c"]], (3, 9))
    model, moments = block_error().model, scene.around(PRIOR.mean).covariance
    found = TransferMse.of(block_error(), PRIOR, scene)(seen(), *noise)
    judged = model.in_valid(torch.arange(moments.shape[0])[None]).flatten()
    for value, matrix in zip(found, block_matrices(model, seen()), strict=True):
        expected = [matrix @ prior.mean.flatten() for prior in (PRIOR, scene)]
        own, true = (torch.diag(noise[0] ** 2 + 1e-9 + noise[1] * e.clamp_min(0)) for e in expected)
        estimator = PRIOR.covariance @ matrix.mT @ torch.linalg.inv(matrix @ PRIOR.covariance @ matrix.mT + own)
        left = torch.eye(len(moments), dtype=torch.float64) - estimator @ matrix
        wrong = left @ moments @ left.mT + estimator @ true @ estimator.mT
        assert float(value) == pytest.approx(float(wrong.diagonal()[judged].mean()), rel=1e-8)


def test_scenes_pooled_by_area_are_those_learned_together():
    alone = [GaussianPrior.learn([cube], (3, 9)) for cube in SCENES.values()]
    together = GaussianPrior.learn(SCENES.values(), (3, 9))
    found = pooled(alone, [cube[0].numel() for cube in SCENES.values()])
    torch.testing.assert_close(found.mean, together.mean)
    torch.testing.assert_close(found.moments, together.moments, rtol=1e-6, atol=1e-9)


def test_examples_judge_each_scene_under_the_others(examples):
    found = examples.held_out(designed(), 0.05, 0.0)
    assert set(found) == set(SCENES)
    others = pooled([examples.scenes[n] for n in "bc"], [SCENES[n][0].numel() for n in "bc"])
    torch.testing.assert_close(examples.without("a").moments, others.moments)
    own = examples.tile_mse(0.05, 0.0).whole(designed(), 2)
    assert max(found.values()) > own


def test_scenes_without_light_teach_nothing():
    for dark in (0 * SCENES["a"], SCENES["a"] - SCENES["a"].max(), SCENES["a"] - 2 * SCENES["a"].mean()):
        with pytest.raises(DataError, match=r"^night: found no light, mean irradiance .*above 0"):
            learn_examples({"day": SCENES["b"], "night": dark}, block_error().model, WAVES)


def test_the_memory_of_examples_is_known_before_they_are_learned(examples):
    errors = [examples.error, *(found.error for found in examples.transfers.values())]
    forms = [form for error in errors for form in (error.covariance, error.reach)]
    forms += [form for found in examples.transfers.values() for form in (found.covariance, found.crossed)]
    assert example_bytes(examples.model, len(SCENES)) == sum(form.numel() * form.element_size() for form in forms)


def test_less_light_is_more_noise(examples):
    """Error at c times the light: c² times that under 1/c of the read noise and of the shot variance per unit."""
    camera = designed()
    dark = examples.under(examples.light / 4).held_out(camera, 0.01, 0.002)
    for name, value in examples.held_out(camera, 0.04, 0.008).items():
        assert dark[name] == pytest.approx(value / 16, rel=1e-4)
    for light in (0.0, 1.0):
        with pytest.raises(SettingError, match="light"):
            examples.under(light)


@pytest.mark.parametrize(
    ("given", "error"),
    [
        (([],), SettingError), (([PRIOR], [0.0]), SettingError),
        (([PRIOR, GaussianPrior.learn([SCENES["a"]], (2, 5))],), ShapeError),
    ],
)  # fmt: skip
def test_what_cannot_be_pooled_is_refused(given, error):
    with pytest.raises(error):
        pooled(*given)


def test_no_more_light_than_makes_the_brightest_value_white():
    scenes = {name: 0.1 * cube / cube.max() for name, cube in SCENES.items()}
    scenes["a"] = 2 * scenes["a"]
    examples = learn_examples(scenes, block_error().model, WAVES)
    assert examples.most_light == pytest.approx(5 * examples.light)
    assert examples.under(examples.most_light).peaks["a"] == pytest.approx(1)
    with pytest.raises(SettingError, match=r"1\.2 times white.*at most"):
        examples.under(1.2 * examples.most_light)
