"""Samples that paths do not explain are not called found, and what would explain them is named."""

import warnings
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tmca.dbd import Channel, Chirp, Problem, Truth, simulate, solve, waveform_source
from tmca.dbd.doubts import _doubt, whole_doubt
from tmca.dbd.identifiability import LittleExplained
from tmca.dbd.tables import recovery_lines

PROBLEM = simulate(M=11, P=4, J=2, targets=1, paths=0, seed=1, snr_db=20, basis="gaussian")


def told(problem):
    """The recovery, and what was warned of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        recovery = solve(replace(problem, truth=None), certify=False)
    return recovery, [str(one.message) for one in caught if one.category is LittleExplained]


def with_rows(change):
    source = PROBLEM.sources[0]
    return replace(PROBLEM, sources=(replace(source, rows=change(source.rows)),))


@pytest.mark.parametrize("sigma", [PROBLEM.sigma, None])
@pytest.mark.parametrize(
    ("problem", "named"),
    [
        (with_rows(np.conj), "the conjugate of the basis explains 99%: is the sign of the time axis or the I/Q order"),
        (
            replace(PROBLEM, y=PROBLEM.y[..., ::-1].conj()),
            "reversed frequencies explains 99%: is the I/Q order swapped",
        ),
        (
            replace(PROBLEM, y=PROBLEM.y[..., ::-1]),
            "basis at reversed frequencies explains 99%: is the sign of the time",
        ),
    ],
)
def test_a_swapped_sign_is_named(problem, named, sigma):
    recovery, [line] = told(replace(problem, sigma=sigma))
    assert named in line
    assert not recovery.found
    assert recovery.doubt is not None


@pytest.mark.parametrize("sigma", [PROBLEM.sigma, None])
def test_the_right_basis_is_left_alone(sigma):
    recovery, lines = told(replace(PROBLEM, sigma=sigma))
    assert (lines, recovery.found, recovery.doubt) == ([], True, None)


def test_what_is_unexplained_is_the_energy_that_the_paths_leave():
    recovery, _ = told(PROBLEM)
    model = recovery["radar"].samples().reshape(PROBLEM.shape)
    left = np.sum(np.abs(PROBLEM.y - model) ** 2) / np.sum(np.abs(PROBLEM.y) ** 2)
    assert recovery.unexplained == pytest.approx(left)
    assert recovery.unexplained == pytest.approx(0.01, rel=0.4)


@pytest.mark.parametrize(("factor", "noted"), [(0.9, False), (1.0, False), (6.0, True)])
def test_a_sigma_that_is_too_large_is_noted(factor, noted):
    problem = scene(4e6, THREE)
    recovery, _ = told(replace(problem, sigma=factor * problem.sigma))
    notes = [note for note in recovery.notes if note.startswith("sigma seems too large")]
    assert len(notes) == noted
    if noted:
        energy = np.mean(np.abs(problem.y) ** 2)
        assert f"is {recovery.sigma**2 / energy:.1%} of the samples' energy" in notes[0]
        estimate = float(notes[0].split("as noise of ")[1].split()[0])
        assert estimate == pytest.approx(problem.sigma, rel=0.15)


def test_little_signal_in_unknown_noise_is_a_reason_too():
    unknown, said = replace(PROBLEM, sigma=None), "or is there little signal (then give sigma)?"
    channels = solve(PROBLEM, certify=False).sources
    assert said in whole_doubt(unknown, channels, 0.9, exact=False)
    assert said not in whole_doubt(PROBLEM, channels, 0.9, exact=False)


def test_progress_tells_of_every_round_of_other_bases_too():
    told = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        solve(with_rows(np.conj), progress=lambda share, detail: told.append((share, detail)), certify=False)
    assert {share for share, _ in told} == {None}
    details = [detail for _, detail in told]
    assert details[0] == "round 1, 0 points"
    assert any(one.startswith("other bases: round 2, ") for one in details)


def test_a_basis_of_something_else_is_told_without_a_name():
    silent = np.abs(np.arange(11) - 5) > 1
    recovery, [line] = told(with_rows(lambda rows: np.where(silent[:, None], 0, rows)))
    assert "are bases, messages and sigma those of y?" in line
    assert not recovery.found
    assert "found: no, the paths leave" in "\n".join(recovery_lines(recovery))


def scene(bandwidth, targets, seed=0, snr_db=20, frequencies=15):
    """A chirp of so many hertz, echoes of (delay, Doppler, gain) targets, 9 pulses of few frequencies in noise."""
    source = waveform_source("radar", Chirp(bandwidth, 1e-6), 9, frequencies, 3e-6)
    points = np.array([(delay, doppler, 0) for delay, doppler, _ in targets])
    truth = Truth(points, np.array([gain for *_, gain in targets], complex), np.ones(1, complex))
    y = Channel.true(source, truth, (1, 9, frequencies)).samples().reshape(1, 9, -1)
    sigma = np.sqrt(np.mean(np.abs(y) ** 2)) * 10 ** (-snr_db / 20)
    noise = np.random.default_rng(seed).standard_normal((2, *y.shape)) / 2**0.5
    return Problem(y + sigma * (noise[0] + 1j * noise[1]), (source,), sigma)


THREE = ((0.09, 0.12, 1), (0.25, 0.62, 0.8j), (0.44, 0.84, -0.7))


@cache
def of_another_pulse(share, known):
    """What is told where the pulse has a share of the bandwidth."""
    problem = scene(4e6, THREE)
    wrong = scene(4e6 * share, THREE).sources
    return told(replace(problem, sources=wrong, sigma=problem.sigma if known else None))


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("share", [0.5, 0.875, pytest.param(2, marks=pytest.mark.slow)])
def test_another_pulse_than_the_one_that_was_given_is_suspected(share, known):
    recovery, [line] = of_another_pulse(share, known)
    assert "3 with another pulse explain 99." in line
    assert line.endswith("is the pulse of radar right?")
    assert not recovery.found


@pytest.mark.parametrize("share", [0.94, 1.06])
def test_a_pulse_that_is_a_few_per_cent_off_is_suspected(share):
    problem = scene(10e6, THREE, frequencies=31)
    recovery, [line] = told(replace(problem, sources=scene(10e6 * share, THREE, frequencies=31).sources))
    assert len(recovery["radar"]) > 3
    assert "3 with another pulse explain 9" in line
    assert line.endswith("is the pulse of radar right?")


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize(
    "targets",
    [
        THREE,
        [(0.1 * place, 0.3, 1j**place) for place in range(1, 6)],  # all as fast
        [(0.08, 0.2, 1), (0.3, 0.2, 0.7), (0.45, 0.2, -0.9), (0.15, 0.7, 1), (0.26, 0.7, 0.8j)],
    ],
)
def test_targets_of_one_velocity_are_left_alone_with_the_right_pulse(targets, known):
    problem = scene(4e6, targets, seed=1)
    recovery, lines = told(problem if known else replace(problem, sigma=None))
    assert (lines, len(recovery["radar"])) == ([], len(targets))


def test_the_verdict_on_a_doubtful_recovery_comes_first_and_whole():
    recovery, [line] = of_another_pulse(0.5, True)
    assert recovery_lines(recovery)[0].startswith(f"found: no, {line}")
    assert line in repr(recovery)
    title = " ".join(recovery.plot().get_suptitle().split())
    assert title == f"in doubt: {line}"


@pytest.mark.parametrize("missing", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_a_source_that_is_not_in_the_file_is_missed(missing):
    problem = simulate(M=13, P=9, J=2, targets=2, paths=2, seed=1, snr_db=20)
    recovery, [line] = told(replace(problem, sources=(problem.sources[1 - missing],), truth=None))
    assert "of the samples' energy, the noise is 1.5% at most: is a source missing?" in line
    assert not recovery.found


def test_a_solution_stops_at_too_many_points_and_estimates_the_noise(monkeypatch):
    monkeypatch.setattr("tmca.dbd.frank_wolfe._FEWEST", 4)
    monkeypatch.setattr("tmca.dbd.frank_wolfe._SAMPLES", 1000)
    recovery, lines = told(replace(PROBLEM, sigma=PROBLEM.sigma / 20))  # so that noise gives points
    assert any(note.startswith("stopped at ") and "44 samples" in note for note in recovery.notes)
    assert recovery.sigma == pytest.approx(PROBLEM.sigma, rel=0.4)
    assert (lines, len(recovery["radar"])) == ([], 1)


def test_paths_that_cancel_are_doubted():
    channel = solve(PROBLEM, certify=False)["radar"]
    delays = np.repeat(np.linspace(0, 0.9, 7), 2) + np.tile([0, 1e-4], 7)
    gains = np.tile([1.0, -1.0], 7) + np.repeat(np.eye(7)[0] * 1e-3, 2)
    pairs = Channel(channel.atoms, np.column_stack([delays, np.full(14, 0.2)]), gains + 0j, channel.waveform)
    doubt = _doubt(replace(PROBLEM, sigma=None), [pairs], 0.1)
    assert doubt is None or doubt.endswith("real samples: any basis would")  # 14 paths of 44 samples
    large = simulate(M=31, P=9, J=2, targets=1, paths=0, seed=1, snr_db=20)
    atoms = Channel.true(large.sources[0], large.truth[0], large.shape).atoms
    pairs = Channel(atoms, pairs.positions, pairs.amplitudes, large.truth[0].waveform)
    assert _doubt(replace(large, sigma=None), [pairs], 0.1).startswith("14 of 14 paths lie within a resolution cell")
    spread = Channel(atoms, pairs.positions[::2], pairs.amplitudes[::2], large.truth[0].waveform)
    assert _doubt(replace(large, sigma=None), [spread], 0.1) is None


def test_a_table_in_doubt_has_the_strongest_and_says_where_all_are():
    recovery = solve(PROBLEM, certify=False)
    channel = recovery["radar"]
    places = np.column_stack([np.linspace(0, 0.9, 20), np.full(20, 0.2)])
    many = Channel(channel.atoms, places, np.arange(1.0, 21) + 0j, channel.waveform)
    doubted = replace(recovery, sources=(many,), doubt="odd", sigma=0.0)
    lines = recovery_lines(doubted, file="own.recovery.nc")
    assert sum(line.strip().startswith("target") for line in lines) == 12
    assert "target 20" in "\n".join(lines)
    assert "  and 8 weaker ones (all in own.recovery.nc)" in lines
    assert lines[0].startswith("found: no, odd")
    assert lines[-1] == "found: no, odd"
    assert sum("target" in line for line in recovery_lines(replace(doubted, doubt=None))) >= 20
