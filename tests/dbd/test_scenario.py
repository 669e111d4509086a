"""The physical layer: what is received in the time domain is the model, and metres and metres a second come back."""

from dataclasses import replace

import numpy as np
import pytest

from tmca.dbd import Path, Scenario, Target, read_scenario, solve
from tmca.dbd.coordinates import LIGHT_M_S
from tmca.dbd.files import scenario_names
from tmca.errors import DataError, SettingError

SCENE = Scenario(
    [Target(60.0, 10.0, 0.8), Target(150.0, -35.0, 1j)], [Path(90.0, 5.0), Path(240.0, -12.0, 0.7)], pulses=9
)


@pytest.mark.parametrize("messages", ["shared", "block"])
@pytest.mark.parametrize("useful_s", [3.2e-6, 3.3e-6])  # even and odd numbers of frequencies
def test_without_doppler_inside_an_interval_the_receiver_gets_the_model(messages, useful_s):
    scene = replace(SCENE, messages=messages, useful_s=useful_s).draw()
    received, model = scene.receive(doppler_within=False).y, scene.problem().y
    assert np.linalg.norm(received - model) < 1e-5 * np.linalg.norm(model)


def test_slow_things_are_nearer_to_the_model():
    slow = replace(SCENE, targets=[Target(60.0, 1.0)], paths=[Path(90.0, 0.5)])
    fast = replace(SCENE, targets=[Target(60.0, 10.0)], paths=[Path(90.0, 5.0)])
    assert fast.draw().model_error == pytest.approx(10 * slow.draw().model_error, rel=0.05)


def test_delays_and_dopplers_are_those_of_the_textbook():
    target, path = Target(150.0, 30.0), Path(300.0, 30.0)
    assert target.delay_s == pytest.approx(1.0e-6, rel=1e-3)
    assert path.delay_s == pytest.approx(1.0e-6, rel=1e-3)
    assert target.doppler_hz(77e9) == pytest.approx(2 * 30 / (LIGHT_M_S / 77e9))
    assert target.doppler_hz(77e9) == pytest.approx(2 * path.doppler_hz(77e9))


def test_antennas_see_the_angle():
    scene = replace(SCENE, targets=[Target(60.0, 10.0, angle_deg=30.0)], antennas=3)
    turn = scene.draw().receive(doppler_within=False)
    alone = replace(scene, paths=[]).draw().receive(doppler_within=False).y
    assert turn.shape[0] == 3
    np.testing.assert_allclose(alone[1], alone[0] * np.exp(-2j * np.pi * 0.25), atol=1e-12)


def test_what_is_received_comes_back_in_metres():
    recovery = solve(replace(SCENE, snr_db=25.0).draw().receive())
    metres = np.sort(recovery.delays_s["radar"]) * LIGHT_M_S / 2
    np.testing.assert_allclose(metres, [60.0, 150.0], atol=0.5)
    speeds = recovery.dopplers_hz["radar"] * LIGHT_M_S / (2 * SCENE.carrier_hz)
    np.testing.assert_allclose(np.sort(speeds), [-35.0, 10.0], atol=1.0)


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"bandwidth_hz": -1.0}, "bandwidth_hz: found -1.0"),
        ({"useful_s": float("nan")}, "useful_s: found nan"),
        ({"pulse_s": 0.0}, "pulse_s: found 0.0"),
        ({"prefix_s": -1e-6}, "prefix_s"),
        ({"targets": [Target(600.0, 0.0)]}, "take targets within"),
        ({"paths": [Path(1000.0, 0.0)]}, "take a longer prefix"),
        ({"targets": [Target(-3.0, 0.0)]}, "a negative distance"),
    ],
)
def test_scenes_that_no_receiver_hears_are_refused(changed, told):
    with pytest.raises(SettingError) as caught:
        replace(SCENE, **changed)
    assert told in str(caught.value)


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"targets": [Target(60.0, 300.0)]}, "found 300 m/s, expected less than 216.3 m/s"),
        ({"paths": [Path(60.0, 500.0)]}, "found 500 m/s, expected less than 432.6 m/s"),
        ({"targets": [Target(60.0, 1.0, 1.0, 30.0)], "antennas": 2, "spacing": 1.2}, "a turn of 0.6 wavelengths"),
        ({"pulses": 3.5}, "pulses: found 3.5"),
        ({"seed": -1}, "seed: found -1"),
        ({"snr_db": float("nan")}, "snr_db: found nan"),
    ],
)
def test_what_looks_like_something_else_is_refused(changed, told):
    with pytest.raises(SettingError) as caught:
        replace(SCENE, **changed)
    assert told in str(caught.value)


def test_numbers_of_targets_are_finite():
    with pytest.raises(SettingError, match="velocity_m_s of a target: found nan"):
        Target(60.0, float("nan"))


@pytest.mark.parametrize("snr_db", [40.0, None])
def test_what_the_model_leaves_out_gives_no_targets(snr_db):
    """The turn of the phase within an interval, 2 % of the samples, is far above the noise."""
    scene = replace(read_scenario("road"), snr_db=snr_db).draw()
    problem = scene.receive()
    left = np.sqrt(np.mean(np.abs(scene.receive().y - scene.receive(doppler_within=False).y) ** 2))
    assert problem.sigma >= 0.95 * left
    assert [len(one.points) for one in solve(problem, certify=False).sources] == [3, 3]


def test_the_scenarios_of_the_package_are_read():
    assert "road" in scenario_names()
    assert len(read_scenario("road").targets) == 3


def test_a_scenario_of_ones_own_is_read_with_numbers_written_as_text(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("bandwidth_hz: 10e6\ntargets: [{range_m: 60, velocity_m_s: 10}]\n")
    scene = read_scenario(file)
    assert scene.bandwidth_hz == 10e6
    assert scene.targets[0] == Target(60, 10)
    assert scene.paths == []


def test_gains_may_be_complex_and_whole_numbers_written_with_a_point(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("pulses: 5.0\ntargets: [{range_m: 60, velocity_m_s: 1e1, gain: 0.3 - 1j}]\nsnr_db: null\n")
    scene = read_scenario(file)
    assert scene.pulses == 5
    assert isinstance(scene.pulses, int)
    assert scene.targets[0] == Target(60, 10, 0.3 - 1j)
    assert scene.snr_db is None


@pytest.mark.parametrize(
    "text",
    [
        "- 3", "foo: 3", "targets: [{range_m: 1}]", "targets: [3]", "pulses: many", "a: [", "paths: [{length_m: x}]",
        "targets: 3", "useful_s: [1]", "pulses: true", "snr_db: []", "targets: [{range_m: [1], velocity_m_s: 2}]",
        "targets: [{range_m: 1, velocity_m_s: 2, gain: [1, 2]}]",
    ],
)  # fmt: skip
def test_files_that_are_no_scenario_are_named(tmp_path, text):
    file = tmp_path / "mine.yaml"
    file.write_text(text)
    with pytest.raises(DataError, match=r"mine\.yaml"):
        read_scenario(file)
