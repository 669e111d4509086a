"""Noise has the variance it states, digital numbers are digital, and gradients pass."""

import pytest
import torch

from tmca.errors import SettingError
from tmca.sensor import Sensor, SensorWarning, quantise, shot_noise

SCALE = 12.0


def test_an_ideal_sensor_changes_nothing():
    y = 20 * torch.rand(1, 1, 5, 6)
    assert torch.equal(Sensor()(y, SCALE), y)


@pytest.mark.parametrize(
    "sensor",
    [
        Sensor(read_noise=0.05, saturates=False),
        Sensor(full_well=1000, saturates=False),
        Sensor(full_well=10_000, read_noise_electrons=3, saturates=False),
    ],
)
@pytest.mark.parametrize("level", [0.02, 3.0])
def test_measured_mean_and_variance_are_the_stated_ones(sensor, level):
    y = torch.full((1, 1, 600, 600), level, dtype=torch.float64)
    recorded = sensor(y, SCALE, 1)
    variance = sensor.noise(SCALE).variance(torch.tensor(level)).item()
    assert recorded.mean().item() == pytest.approx(level, abs=5 * (variance / y.numel()) ** 0.5)
    assert recorded.var().item() == pytest.approx(variance, rel=0.02)


def test_noise_says_which_number_is_a_deviation_and_which_a_variance():
    said = Sensor(full_well=10_000, read_noise_electrons=3).noise(10.0).in_words()
    assert said == "read σ = 0.003, shot variance = 0.001 per unit of light"
    assert Sensor().noise(10.0).in_words() == "none"


def test_rounding_of_the_converter_is_part_of_the_stated_noise():
    sensor = Sensor(read_noise=0.05, bits=6)
    y = torch.full((1, 1, 500, 500), 3.0, dtype=torch.float64) + torch.rand(1, 1, 500, 500, dtype=torch.float64)
    assert (sensor(y, SCALE, 0) - y).std().item() == pytest.approx(sensor.noise(SCALE).read, rel=0.02)


def test_accumulated_exposures_collect_more_electrons_and_saturate_later():
    sensor, level = Sensor(full_well=1000), 6.0
    once, often = (torch.full((1, 1, 400, 400), level * k, dtype=torch.float64) for k in (1, 4))
    ratio = [sensor(y, SCALE, 0, k).mean() / sensor(y, SCALE, 0, k).std() for y, k in ((once, 1), (often, 4))]
    assert (ratio[1] / ratio[0]).item() == pytest.approx(2.0, rel=0.03)
    assert sensor(torch.full((1, 1, 4, 4), 100.0), SCALE, 0, 4).max().item() == pytest.approx(4 * SCALE)


@pytest.mark.parametrize(("given", "remedy"), [
    ({"read_noise": 4}, "for electrons use full_well and read_noise_electrons"),
    ({"read_noise": 0.9, "full_well": 10_000}, "for electrons use read_noise_electrons"),
])  # fmt: skip
def test_read_noise_that_looks_like_electrons_is_warned_of(given, remedy):
    with pytest.warns(SensorWarning, match=f"read_noise {given['read_noise']:g} is in units of one white .*{remedy}"):
        Sensor(**given).warn_of_electrons()


def test_same_seed_same_noise():
    sensor, y = Sensor(read_noise=0.1, full_well=100), torch.rand(1, 1, 9, 9)
    assert torch.equal(sensor(y, SCALE, 3), sensor(y, SCALE, 3))
    assert not torch.equal(sensor(y, SCALE, 3), sensor(y, SCALE, 4))


def test_a_pixel_may_be_full_below_full_scale():
    """Each of two buckets that share a well: full at half of it, and the converter's steps are half as wide."""
    light = torch.linspace(0, 2, 401)
    half = Sensor(saturates=0.5)(light, 2.0)
    assert torch.equal(half, light.clamp_max(1.0))
    whole, narrow = (Sensor(bits=8, pedestal=0.0, saturates=share) for share in (1.0, 0.5))
    steps = [sensor(light, 2.0).unique().diff().median() for sensor in (whole, narrow)]
    assert float(steps[1] / steps[0]) == pytest.approx(0.5, rel=1e-3)
    assert narrow.noise(2.0).read == pytest.approx(whole.noise(2.0).read / 2)
    for share in (0.0, 1.5, -1.0):
        with pytest.raises(SettingError, match="saturates"):
            Sensor(saturates=share)


def test_converter_has_evenly_spaced_levels_down_to_the_pedestal_and_saturates():
    sensor = Sensor(bits=4, pedestal=0.1)
    y = torch.linspace(-5, 20, 2001, dtype=torch.float64).reshape(1, 1, 1, -1)
    levels = sensor(y, SCALE).unique()
    assert len(levels) == 16
    assert levels[0].item() == pytest.approx(-1.2)
    assert levels[-1].item() == pytest.approx(12)
    assert torch.allclose(levels.diff(), levels.diff()[:1])
    inside = (y > -1.2) & (y < 12)
    assert ((sensor(y, SCALE) - y).abs()[inside] <= 13.2 / 15 / 2 + 1e-9).all()


def test_gradients_pass_through_rounding_and_stop_at_saturation():
    y = torch.tensor([-5.0, 0.3, 5.2, 14.0], requires_grad=True)
    quantise(y, 0.0, 12.0, 8).sum().backward()
    assert y.grad.tolist() == [0, 1, 1, 0]


def test_shot_noise_gradient_is_that_of_the_mean_on_average():
    electrons = torch.full((200_000,), 50.0, requires_grad=True)
    (shot_noise(electrons, torch.Generator().manual_seed(0)) ** 2).mean().backward()
    assert electrons.grad.sum().item() == pytest.approx(2 * 50 + 1, rel=0.01)


@pytest.mark.parametrize(
    "settings",
    [{"read_noise": -1}, {"full_well": 0}, {"read_noise_electrons": 3}, {"bits": 0}, {"read_noise": float("nan")}],
)
def test_impossible_sensors_are_refused(settings):
    with pytest.raises(SettingError, match=next(iter(settings))):
        Sensor(**settings)
