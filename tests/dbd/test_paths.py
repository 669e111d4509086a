"""Targets and paths by their names, in tables of every kind; how far they are apart."""

from dataclasses import replace
from io import StringIO

import numpy as np
import pandas as pd
import pytest

from tmca.dbd import Channel, Problem, Source, Truth, Units, joint_separation, read_scenario, simulate, solve
from tmca.dbd.model import LIGHT_M_S
from tmca.dbd.paths import path_csv, path_rows
from tmca.dbd.separation import Separation
from tmca.dbd.tables import recovery_lines, recovery_values, resolution_line, separation_line

C = 299_792_458.0


@pytest.fixture(scope="module")
def road():
    scenario = read_scenario("road")
    smaller = replace(scenario, pulses=9, targets=scenario.targets[:2], paths=scenario.paths[:1], subspace=2)
    return solve(smaller.draw().receive())


def test_targets_and_paths_have_names_units_and_deviations(road):
    rows = path_rows(road)
    assert [row["name"] for row in rows] == ["target 1", "target 2", "path 1"]
    assert [row["role"] for row in rows] == ["radar", "radar", "communications"]
    for row, metres, speed in zip(rows, (60, 150, 90), (10, -35, 5), strict=True):
        name, trips = ("range_m", 2) if row["role"] == "radar" else ("length_m", 1)
        assert abs(row[name] - metres) < 5 * row[f"{name}_std"] < 5
        assert abs(row["velocity_m_s"] - speed) < 5 * row["velocity_m_s_std"] < 8
        assert row["delay_s"] == pytest.approx(row[name] * trips / C)
        assert row["doppler_hz"] == pytest.approx(trips * 77e9 * row["velocity_m_s"] / C)
        assert row["delay_s_std"] == pytest.approx(row[f"{name}_std"] * trips / C)
        assert row["power_db"] == pytest.approx(10 * np.log10(row["gain_real"] ** 2 + row["gain_imag"] ** 2))


def test_lines_are_tables_of_markdown_if_asked(road):
    lines = recovery_lines(road, markdown=True)
    heads = [place for place, line in enumerate(lines) if "---" in line]
    assert len(heads) == len(road.sources)
    assert all(lines[place].count("|") == lines[place - 1].count("|") == lines[place + 1].count("|") for place in heads)
    assert not any(line.startswith("|") for line in recovery_lines(road))


def test_frames_files_and_arrays_say_the_same(road):
    frame, back = road.to_pandas(), pd.read_csv(StringIO(path_csv(road)))
    pd.testing.assert_frame_equal(frame, back, check_dtype=False, rtol=1e-12)
    assert frame.name.tolist() == ["target 1", "target 2", "path 1"]
    assert "angle" not in frame
    arrays = road.to_xarray()
    assert arrays.sizes == {"path": 3}
    assert arrays.range_m.attrs["units"] == "m"
    assert arrays.attrs["unexplained"] == road.unexplained
    np.testing.assert_array_equal(arrays.delay_s.sel(path="path 1"), frame.delay_s[2])
    assert recovery_values(road)["paths"] == path_rows(road)


def test_targets_that_are_not_resolved_are_marked(road):
    radar, link = road.sources
    cell = 1 / road.problem.shape[2]
    points, bounds = radar.positions.copy(), radar.bounds.copy()
    points[1], bounds[1, :2] = points[0] + (0.3 * cell, 0), 0.4 * cell
    for factor, names in ((1.0, ["", "target 1", ""]), (0.1, ["", "", ""])):
        near = replace(radar, positions=points, bounds=factor * bounds, amplitudes=np.array([1, 0.5 + 0j]))
        recovery = replace(road, sources=(near, link))
        assert [row["not_resolved_from"] for row in path_rows(recovery)] == names
        assert ("not_resolved_from" in path_csv(recovery)) == any(names)
        assert any(line.endswith("  target 1") for line in recovery_lines(recovery)) == any(names)
        assert ("not_resolved_from" in recovery.to_xarray().coords) == any(names)


def test_tables_say_who_is_there_and_back(road):
    lines = recovery_lines(road)
    assert {"radar: 2 paths, there and back", "communications: 1 path, one way"} <= set(lines)


def test_without_a_carrier_dopplers_stay_in_hertz():
    problem = replace(simulate(M=9, P=5, J=2, targets=1, paths=1, seed=2), units=Units(1e-6, 2e4))
    frame = solve(problem, certify=False).to_pandas()
    assert "velocity_m_s" not in frame
    assert {"doppler_hz", "range_m", "length_m"} <= set(frame)
    assert frame.doppler_hz.abs().max() <= 1e4


def test_nothing_recovered_is_an_empty_table():
    problem = simulate(M=7, P=5, J=2, targets=1, paths=0, seed=2, snr_db=-40)
    recovery = solve(problem)
    assert recovery.to_pandas().empty
    assert recovery.to_xarray().sizes == {"path": 0}
    assert "no paths" in recovery_lines(recovery)[0]


def test_joint_separation_is_the_least_distance_of_any_two_of_all_sources():
    problem = simulate(M=9, P=5, J=2, targets=2, paths=1, seed=0)
    recovery = solve(problem, certify=False)
    points = np.concatenate([one.points for one in problem.truth])
    for one, samples in zip(joint_separation(recovery.sources), (9, 5), strict=True):
        axis = ("delay", "doppler").index(one.axis)
        least = min(
            min(abs(a - b), 1 - abs(a - b)) for i, a in enumerate(points[:, axis]) for b in points[i + 1 :, axis]
        )
        assert one.least == pytest.approx(least, abs=1e-6)
        assert one.needed == 1 / (samples - 1)
        assert one.satisfied == (least > 1 / (samples - 1))
    assert separation_line(recovery).startswith("joint separation (Monsalve et al. 2022): ")
    assert recovery_values(recovery)["joint_separation"]["delay"]["needed"] == 0.125


@pytest.mark.parametrize(("apart", "count"), [(0.13, 7), (0.2, 5), (0.24, 4)])
def test_points_that_are_jointly_apart_have_a_well_conditioned_matrix(apart, count):
    rng, samples = np.random.default_rng(count), 13
    for _ in range(20):
        gaps = apart + (1 - apart * count) * rng.dirichlet(np.ones(count))
        places = np.cumsum(gaps)
        values = np.linalg.svd(np.exp(2j * np.pi * np.outer(np.arange(samples), places)), compute_uv=False)
        bound = Separation("delay", float(gaps.min()), 1 / (samples - 1), ()).condition_number
        assert values[0] / values[-1] <= bound


def test_relative_dopplers_do_not_count():
    problem = simulate(M=13, P=4, J=1, targets=1, paths=2, seed=1, messages="block", basis="gaussian")
    assert [one.axis for one in joint_separation(solve(problem, certify=False).sources)] == ["delay"]


def test_joint_separation_takes_a_recovery_and_is_noted_where_it_fails():
    problem = simulate(M=9, P=5, J=2, targets=2, paths=1, seed=0)
    recovery = solve(problem, certify=False)
    assert joint_separation(recovery) == joint_separation(recovery.sources)
    near = simulate(M=9, P=5, J=2, targets=2, paths=1, seed=0, separation=0.05)
    for one in (recovery, solve(near, certify=False)):
        fails = not any(axis.satisfied for axis in joint_separation(one))
        assert any("not satisfied" in note for note in one.notes) == fails
        assert sum("joint separation" in line for line in recovery_lines(one)) == 1


def close_targets(apart, gain, carrier_hz=None, doppler=0.3):
    """Two targets of a known waveform in noise, in units of 3 µs and 100 kHz."""
    rows = np.exp(2j * np.pi * np.random.default_rng(0).random((15, 1)))
    source = Source("radar", rows, np.zeros(9, int))
    points = np.array([[0.2, doppler, 0], [0.2 + apart, doppler + apart, 0]])
    truth = Truth(points, np.array([1, gain], complex), np.ones(1, complex))
    y = Channel.true(source, truth, (1, 9, 15)).samples()
    noise = np.random.default_rng(1).standard_normal((2, y.size)) * 0.1 / 2**0.5
    return Problem(y + noise[0] + 1j * noise[1], (source,), 0.1, (truth,), Units(3e-6, 1e5, carrier_hz))


@pytest.mark.parametrize(("apart", "gain"), [(0.07, 0.8), (0.4, 0.0)])
def test_correlations_are_those_of_a_slow_fisher_matrix(apart, gain):
    problem = close_targets(apart, gain)
    recovery = solve(problem, certify=False)
    channel = recovery["radar"]
    n, p = np.arange(15) - 7, np.arange(9)[:, None]

    def model(x):
        return sum(
            (x[i + 2] + 1j * x[i + 3])
            * problem.sources[0].rows[..., 0]
            * np.exp(-2j * np.pi * (n * x[i] + p * x[i + 1]))
            for i in range(0, len(x), 4)
        )

    gains = channel.amplitudes * channel.waveform[0]
    x = np.column_stack([channel.positions, gains.real, gains.imag]).ravel()
    steps = 1e-6 * np.eye(len(x))
    jacobian = np.stack([(model(x + one) - model(x - one)).ravel() / 2e-6 for one in steps])
    covariance = np.linalg.inv((jacobian.conj() @ jacobian.T).real)
    rows = {row["delay"]: row["delay_doppler_correlation"] for row in path_rows(recovery)}
    for path, delay in enumerate(channel.points[:, 0]):
        at = 4 * path
        slow = covariance[at, at + 1] / np.sqrt(covariance[at, at] * covariance[at + 1, at + 1])
        assert rows[delay] == pytest.approx(slow, abs=1e-4)
    assert (abs(slow) < 1e-4) == (len(channel) == 1)


def test_range_walk_is_said_in_metres():
    slow, fast = close_targets(0.4, 0.8, 77e9), close_targets(0.4, 0.8, 10e6)  # 15 cells of 3 µs: 30 m each
    assert not any("range walk" in note for note in solve(slow, certify=False).notes)
    recovery = solve(fast, certify=False)
    [note] = [note for note in recovery.notes if "range walk" in note]
    doppler = 1e5 * 0.3  # Hz; both are 0.3 turns a pulse from none
    metres = LIGHT_M_S * doppler / (2 * 10e6) * 8 / 1e5
    assert f"by {metres:.2g} m, {metres / 30:.2g} of a resolution cell" in note


def test_a_value_has_the_decimals_of_its_deviation():
    exact = replace(close_targets(0.4, 0.8, 24e9), sigma=1e-4)
    truth = exact.truth[0]
    y = Channel.true(exact.sources[0], truth, exact.shape).samples().reshape(exact.shape)
    noise = np.random.default_rng(0).standard_normal((2, *y.shape)) * 1e-4 / 2**0.5
    recovery = solve(replace(exact, y=y + noise[0] + 1j * noise[1]), certify=False)
    [line] = [line for line in recovery_lines(recovery) if line.strip().startswith("target 1")]
    value, _, deviation = line.split()[2:5]
    assert len(value.partition(".")[2]) == len(deviation.partition(".")[2]) > 2


def test_resolution_and_what_is_unambiguous_are_said_in_units():
    problem = close_targets(0.4, 0.8, 24e9)
    metres, speed = LIGHT_M_S * 3e-6 / 2, LIGHT_M_S / 24e9 / 2 * 1e5
    recovery = solve(problem, certify=False)
    ends = f"unambiguous to {metres:.4g} m, ±{speed / 2:.4g} m/s"
    assert f"resolution: radar {metres / 15:.3g} m, {speed / 9:.3g} m/s, {ends}" in recovery_lines(recovery)
    assert resolution_line(replace(recovery, problem=close_targets(0.4, 0.8))).endswith("±50 kHz")
    assert resolution_line(replace(recovery, problem=replace(problem, units=None))) == ""


def test_joint_separation_says_which_axis_satisfies_it_and_of_what():
    line = separation_line(solve(close_targets(0.07, 0.8, doppler=0.3), certify=False))
    assert "not satisfied: delays" in line
    apart = replace(close_targets(0.4, 0.8), truth=None)
    recovery = solve(apart, certify=False)
    assert "satisfied by the delays and Dopplers: " in separation_line(recovery)
    [channel] = recovery.sources
    near = np.column_stack([channel.positions[:, 0], channel.positions[:1, 1].repeat(len(channel))])
    line = separation_line(replace(recovery, sources=(replace(channel, positions=near),)))
    assert "satisfied by the delays: delays" in line
    assert "Dopplers 0 kHz (target 1 and target 2) apart, not more than 12.5 kHz" in line
    assert line.endswith("(of the points that were found; two closer than a resolution cell may appear as one)")
