"""Predicted and measured errors of codes agree where scenes are as the prior says."""

from math import log, sqrt

import pytest

from tests.small_scenes import smooth_scene
from tmca.cameras import SpectralCamera
from tmca.errors import SettingError
from tmca.evaluation.expected import predicted_and_measured
from tmca.priors import GaussianPrior
from tmca.sensor import Sensor

PRIOR = GaussianPrior.learn([smooth_scene(60, 80, seed=1)], (4, 12))
PATCHES, JUDGED = 100, 3 * 4 * 8
"""Patches of the prior, and pixels of each that are judged."""
TOLERANCE = 3 * 10 / log(10) * sqrt(2 / (PATCHES * JUDGED / 2))
"""Three standard deviations of the mean of squared errors, dB, if every second pixel is independent: 0.27 dB."""


def camera(**settings):
    return SpectralCamera(bands=3, size=(24, 48), slots=2, period=(2, 2), seed=3, **settings)


@pytest.mark.parametrize("sensor", [
    {"full_well": 2000.0, "read_noise_electrons": 3.0},
    *(pytest.param({"read_noise": noise}, marks=pytest.mark.slow) for noise in (0.02, 0.5)),
])  # fmt: skip
def test_on_patches_of_the_prior_the_measured_error_is_the_predicted_one(sensor):
    patches = list(PRIOR.sample(PATCHES, seed=5))
    predicted, measured = predicted_and_measured(PRIOR, camera(sensor=Sensor(**sensor)), patches, count=16 * PATCHES)
    assert measured == pytest.approx(predicted, abs=TOLERANCE)


def test_scenes_that_vary_more_than_the_prior_says_err_more():
    patches = list(PRIOR.mean + 2 * (PRIOR.sample(40, seed=5) - PRIOR.mean))
    predicted, measured = predicted_and_measured(PRIOR, camera(), patches, count=16 * 40)
    assert measured < predicted - 3


def test_relay_blur_is_refused():
    with pytest.raises(SettingError, match=r"relay.blur"):
        predicted_and_measured(PRIOR, camera(relay_blur=0.5), [])
