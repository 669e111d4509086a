"""The physical layer: what is received in the time domain is the model, and metres and metres a second come back."""

from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest

from tmca.dbd import Path, Scenario, Target, load_problem, read_scenario, save_problem, solve
from tmca.dbd.model import LIGHT_M_S, centred
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
    problem = replace(SCENE, snr_db=25.0).draw().receive()
    points = solve(problem)["radar"].points
    metres = problem.units.physical(points[:, 0], 0, "radar")
    np.testing.assert_allclose(np.sort(metres), [60.0, 150.0], atol=0.5)
    speeds = problem.units.physical(centred(points[:, 1]), 1, "radar")
    np.testing.assert_allclose(np.sort(speeds), [-35.0, 10.0], atol=1.0)


@pytest.mark.parametrize(
    ("where", "changed"),
    [
        ("bandwidth_hz", {"bandwidth_hz": -1.0}),
        ("useful_s", {"useful_s": float("nan")}),
        ("pulse_s", {"pulse_s": 0.0}),
        ("prefix_s", {"prefix_s": -1e-6}),
        ("pulses", {"pulses": 3.5}),
        ("seed", {"seed": -1}),
        ("bandwidth_hz times useful_s", {"bandwidth_hz": 1e15}),
        *(("samples of the bases", {name: many}) for name, many in {"pulses": 10**9, "antennas": 10**8}.items()),
        ("snr_db", {"snr_db": float("nan")}),
        ("targets", {"targets": [Target(600.0, 0.0)]}),  # an echo that outlasts the interval
        ("paths", {"paths": [Path(1000.0, 0.0)]}),  # later than the prefix
        ("targets and paths", {"targets": [Target(-3.0, 0.0)]}),
        ("targets", {"targets": [Target(60.0, 216.4)]}),  # half the pulse repetition frequency
        ("paths", {"paths": [Path(60.0, 432.7)]}),
        ("targets", {"targets": [Target(60.0, 1.0, 1.0, 30.0)], "antennas": 2, "spacing": 1.2}),
    ],
)
def test_scenes_that_no_receiver_tells_apart_are_refused(where, changed):
    with pytest.raises(SettingError) as caught:
        replace(SCENE, **changed)
    assert caught.value.where == where


def test_a_scenario_draws_nothing_and_a_seed_makes_its_scene():
    drawn, again, other = SCENE.draw(5), replace(SCENE, seed=5).draw(), SCENE.draw(6)
    assert SCENE.seed == 0
    np.testing.assert_array_equal(drawn.problem().y, again.problem().y)
    assert not np.allclose(drawn.problem().y, other.problem().y)
    np.testing.assert_array_equal(drawn.truth[0].points, other.truth[0].points)


@pytest.mark.slow
@pytest.mark.parametrize("snr_db", [40.0, None])
def test_what_the_model_leaves_out_gives_no_targets(snr_db):
    """The turn of the phase within an interval, 2 % of the samples, is far above the noise."""
    scene = replace(read_scenario("road"), snr_db=snr_db).draw()
    problem = scene.receive()
    left = np.sqrt(np.mean(np.abs(scene.receive().y - scene.receive(doppler_within=False).y) ** 2))
    assert problem.sigma >= 0.95 * left
    assert [len(one.points) for one in solve(problem, certify=False).sources] == [3, 3]


def test_numbers_of_a_file_may_be_text_or_complex(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(
        "bandwidth_hz: 10e6\npulses: 5.0\ntargets: [{range_m: 60, velocity_m_s: 1e1, gain: 0.3 - 1j}]\nsnr_db: null\n"
    )
    scene = read_scenario(file)
    assert scene == Scenario([Target(60, 10, 0.3 - 1j)], [], bandwidth_hz=10e6, pulses=5)
    assert isinstance(scene.pulses, int)


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


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "bandwith_hz: 1e7",
            r"found bandwith_hz, expected targets, paths, bandwidth_hz, .*; did you mean bandwidth_hz\?",
        ),
        (
            "targets: [{range: 1, velocity_m_s: 2}]",
            r"range_m, velocity_m_s, gain, angle_deg, name; did you mean range_m\?",
        ),
        ("paths: [{length_m: 1, velocity_m_s: 2, colour: 3}]", r"found paths.0.colour, expected length_m, vel"),
    ],
)
def test_names_that_a_scenario_does_not_have_are_answered_with_those_it_has(tmp_path, text, said):
    file = tmp_path / "mine.yaml"
    file.write_text(text)
    with pytest.raises(DataError, match=said):
        read_scenario(file)


def test_numbers_of_targets_are_finite():
    with pytest.raises(SettingError) as caught:
        Target(60.0, float("nan"))
    assert caught.value.where == "velocity_m_s of a target"


def test_the_interval_between_pulses_stands_for_the_prefix(tmp_path):
    (tmp_path / "mine.yaml").write_text("useful_s: 3.3e-6\npri_s: 5.0e-6\n")
    scene = read_scenario(tmp_path / "mine.yaml")
    assert scene.interval_s == pytest.approx(5e-6)
    assert scene.prefix_s == pytest.approx(1.7e-6)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("pri_s: 5e-6\nprefix_s: 1e-6", "found pri_s and prefix_s, expected one of them"),
        ("pri_s: 3e-6", "found pri_s 3e-06, expected 3.3e-06 s, useful_s, or more"),
        ("pri_s: [1]", "numbers of seconds"),
        ("pri: 1e-6", "did you mean pri_s"),
    ],
)
def test_intervals_that_fit_no_prefix_are_named(tmp_path, text, said):
    (tmp_path / "mine.yaml").write_text(text)
    with pytest.raises(DataError, match=said):
        read_scenario(tmp_path / "mine.yaml")


def test_names_of_targets_stand_at_their_estimates(tmp_path):
    targets = [replace(SCENE.targets[0], name="truck"), replace(SCENE.targets[1], name="")]
    problem = replace(SCENE, targets=targets, snr_db=25.0).draw().problem()
    back = load_problem(save_problem(problem, tmp_path / "p.nc"))
    assert back.truth[0].names == ("truck", "")
    frame = solve(back, certify=False).to_pandas().set_index("name")
    assert list(frame.index) == ["truck", "target 2", "path 1", "path 2"]
    assert frame.loc["truck", "range_m"] == pytest.approx(60, abs=0.5)


@pytest.mark.parametrize("name", ["one\ntwo", "x" * 61, "a\tb"])
def test_names_that_no_table_has_room_for_are_refused(name):
    with pytest.raises(SettingError, match=r"name: found .*one line of at most 60 letters"):
        Target(60.0, 10.0, name=name)


@pytest.mark.slow
def test_a_name_is_drawn_as_it_is_written():
    scene = replace(SCENE, targets=[Target(60.0, 10.0, name="a $x_{ b$")])
    problem = scene.draw().receive()
    solve(problem).plot().savefig(BytesIO())
