"""Paths are recovered off the grid, to rounding errors, in every setting of the model."""

import subprocess
import sys
import warnings
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest

from tests.dbd.loops import noise, samples
from tmca.dbd import Problem, Source, Truth, Units, simulate, solve, solving
from tmca.dbd.identifiability import LittleExplained, SameSignals, taken_one_way
from tmca.dbd.simulation import overlaid
from tmca.errors import SettingError

CASES = {
    "shared": {"seed": 2},
    "even sizes": {"M": 10, "P": 6},
    "block": {"messages": "block"},
    "dense": {"messages": "dense", "M": 13, "P": 4, "targets": 1, "paths": 1, "seed": 1},
    "antennas": {"M": 7, "P": 4, "antennas": 3, "seed": 2},
    "antennas, block": {"M": 7, "P": 4, "antennas": 3, "messages": "block", "seed": 2},
    "two radars": {"M": 11, "P": 6, "targets": (2, 1), "seed": 3},
    "three pulses a symbol": {"P": 6, "symbol_ratio": 3, "seed": 2},
    "known waveforms": {"known_waveforms": True, "seed": 2},
    "one pulse": {"M": 25, "P": 1, "seed": 2},
    "one frequency": {"M": 1, "P": 11, "J": 1, "paths": 0},
    "no communications": {"targets": 3, "paths": 0},
    "no radar": {"targets": 0, "paths": 3},
    "unequal numbers": {"targets": 3, "paths": 1},
    "late clock": {"late_samples": 3, "seed": 2},
    "late clock, block": {"late_samples": 3, "messages": "block", "M": 15, "targets": 1, "paths": 1},
    "fading": {"amplitudes": (0.3, 1.0)},
}


def of(case, **more):
    return simulate(**{"M": 9, "P": 5, "J": 2, "targets": 2, "paths": 2, **CASES.get(case, {}), **more})


@cache
def recovered(case):
    return solve(of(case), certify=False)


@pytest.mark.parametrize("case", CASES)
def test_all_paths_are_found_to_rounding_errors(case):
    recovery = recovered(case)
    score = recovery.score()
    assert score.success
    assert score.max_error < 1e-8
    assert recovery.exact
    assert recovery.found
    assert recovery.residual < 1e-9
    for one in score.sources:
        assert one.waveform_correlation == pytest.approx(1, abs=1e-9)


@pytest.mark.parametrize("case", ["shared", "block", "antennas"])
def test_what_was_found_makes_the_samples_again(case):
    recovery, problem = recovered(case), recovered(case).problem
    truth = [Truth(np.nan_to_num(one.points), one.amplitudes, one.waveform) for one in recovery.sources]
    np.testing.assert_allclose(samples(problem.shape, problem.sources, truth), problem.y, atol=1e-8)
    for one, source in zip(recovery.sources, problem.sources, strict=True):
        assert np.linalg.norm(one.waveform) == pytest.approx(1)
        np.testing.assert_allclose(one.signal, source.signal(one.waveform), atol=1e-12)


def test_dopplers_of_block_messages_count_from_the_strongest_path():
    fading = of("block", M=11, P=4, J=1, targets=1, basis="gaussian", amplitudes=(0.4, 1.0), seed=3)
    recovery = solve(fading, certify=False)
    link = recovery["communications"]
    assert link.relative_doppler
    assert not recovery["radar"].relative_doppler
    assert link.points[np.argmax(np.abs(link.amplitudes)), 1] == 0
    assert any("absorb the absolute Doppler" in note for note in recovery.notes)


def louder(problem, gains):
    """The same problem with the paths of each source times a gain."""
    pairs = zip(problem.truth, gains, strict=True)
    truth = tuple(Truth(one.points, gain * one.amplitudes, one.waveform) for one, gain in pairs)
    return Problem(overlaid(problem.sources, truth, problem.shape[0]), problem.sources, 0.0, truth)


@pytest.mark.parametrize(
    ("gains", "messages"),
    [((0.1, 1), "shared"), ((0.02, 1), "shared"), ((1, 0.02), "shared"), ((0.1, 1), "block"), ((1, 0.02), "block")],
)
def test_the_weaker_signal_is_found_beside_the_stronger(gains, messages):
    problem = simulate(M=13, P=5, J=2, targets=2, paths=1, messages=messages, seed=3)
    recovery = solve(louder(problem, gains), certify=False)
    assert recovery.exact
    assert recovery.score().success


@pytest.mark.parametrize("scale", [1e-2, 30.0])
@pytest.mark.parametrize("weights", [None, "balanced"])
def test_the_scale_of_a_basis_makes_no_difference(scale, weights):
    problem = of("block", M=13, paths=1, basis="gaussian", seed=1)
    radar, link = problem.sources
    other = Source(link.name, scale * link.rows, link.message)
    same, scaled = (
        solve(replace(problem, sources=(radar, one)), certify=False, weights=weights) for one in (link, other)
    )
    assert same.score().success
    np.testing.assert_allclose(scaled["radar"].points, same["radar"].points, atol=1e-9)
    np.testing.assert_allclose(scaled[link.name].amplitudes * scale, same[link.name].amplitudes, rtol=1e-6)


@pytest.mark.parametrize("method", ["sfw", "sdp"])
def test_guard_carriers_carry_nothing(method):
    problem = simulate(M=9, P=4, J=2, targets=1, paths=1, seed=1)
    mask = np.ones(9)
    mask[[0, -1]] = 0
    sources = [Source(one.name, one.rows * mask[:, None], one.message) for one in problem.sources]
    recovery = solve(Problem(problem.y * mask, sources, 0.0, problem.truth), method)
    assert recovery.score().success
    assert np.all(recovery.q[..., [0, -1]] == 0) or method == "sfw"
    if method == "sdp":
        with pytest.raises(SettingError, match="8 samples that no basis reaches, expected zeros there"):
            solve(Problem(problem.y, sources, 0.0), method)


@pytest.mark.slow
def test_more_unknowns_than_samples_mean_nothing():
    rng = np.random.default_rng(0)
    sources = (Source("radar", noise(rng, 4, 6, 2), np.zeros(4, int)), Source("link", noise(rng, 4, 6, 2), range(4)))
    recovery = solve(Problem(noise(rng, 4, 6), sources, 0.0), certify=False)
    assert any("paths have more lifted unknowns than there are samples: they mean nothing" in n for n in recovery.notes)


def test_a_silent_source_does_not_spoil_an_exact_fit():
    problem = simulate(M=5, P=5, J=2, targets=1, paths=0, seed=1)
    silent = Source("silent", noise(np.random.default_rng(0), 5, 5, 5), range(5))
    with pytest.warns(SameSignals, match="radar and silent can send the same signals"):
        recovery = solve(Problem(problem.y, (*problem.sources, silent), 0.0), certify=False)
    assert [len(one.points) for one in recovery.sources] == [1, 0]
    assert recovery.exact


@pytest.mark.slow
@pytest.mark.parametrize(("frequencies", "pulses", "seed"), [(6, 4, 2), (7, 5, 2)])
def test_noise_is_never_explained_exactly(frequencies, pulses, seed):
    problem = simulate(M=frequencies, P=pulses, J=2, targets=1, paths=1, basis="gaussian")
    recovery = solve(Problem(noise(np.random.default_rng(seed), pulses, frequencies), problem.sources, 0.0))
    assert not recovery.exact
    assert recovery.certificate is None


@pytest.mark.parametrize("method", ["sdp", "cvxpy"])
@pytest.mark.parametrize("messages", ["shared", "block"])
def test_the_semidefinite_programme_finds_the_same_paths(method, messages):
    problem = simulate(M=7, P=3, J=1, targets=1, paths=1, messages=messages, basis="gaussian", seed=3)
    recovery = solve(problem, method, certify=False)
    assert recovery.method == method
    assert recovery.score().success
    assert recovery.exact


def test_the_semidefinite_programme_takes_noise_and_the_thesis_gram():
    problem = simulate(M=9, P=3, J=1, targets=1, paths=1, basis="gaussian", seed=3, snr_db=30)
    by_dual, by_atoms = solve(problem, "sdp", gram="shared"), solve(problem)
    for one, other in zip(by_dual.sources, by_atoms.sources, strict=True):
        np.testing.assert_allclose(one.points, other.points, atol=1e-6)


@pytest.mark.parametrize(
    ("where", "case", "changed", "given"),
    [
        ("method", "shared", {}, {"method": "magic"}),
        ("gram", "shared", {}, {"gram": "none"}),
        ("accuracy", "shared", {}, {"accuracy": 1.0}),
        ("weights", "shared", {}, {"weights": "heavy"}),
        ("weights", "shared", {}, {"weights": (1.0,)}),
        ("weight of communications", "shared", {}, {"weights": (1.0, 0.0)}),
        ("y", "shared", {"y": np.zeros((5, 9))}, {}),
        ("method=sdp", "shared", {"sigma": None}, {"method": "sdp"}),
        ("method=cvxpy", "shared", {"sigma": None}, {"method": "cvxpy"}),
        ("gram=shared", "block", {}, {"method": "sdp", "gram": "shared"}),
    ],
)
def test_what_no_method_can_do_is_refused(where, case, changed, given):
    with pytest.raises(SettingError) as caught:
        solve(replace(of(case), **changed), **given)
    assert caught.value.where == where


@pytest.mark.parametrize(("method", "frequencies"), [("cvxpy", 3000), ("sdp", 300_000)])
def test_sizes_beyond_the_memory_are_refused_before_the_work(method, frequencies):
    source = Source("radar", np.ones((frequencies, 1)), [0])
    with pytest.raises(SettingError, match=f"{frequencies} samples, about .* GB, expected at most .* on this machine"):
        solve(Problem(np.ones((1, frequencies)), (source,), 0.0), method)


@pytest.mark.parametrize(("name", "near"), [("radr", True), ("Radar 2", True), ("radio", False), ("radar 2", False)])
def test_a_name_that_may_be_a_misspelt_radar_is_warned_of(name, near):
    source = replace(simulate(M=5, P=3, J=1, targets=1, paths=0).sources[0], name=name)
    lines = taken_one_way(Problem(np.ones((3, 5)), (source,)))
    assert any("did you mean radar?" in line for line in lines) == near


def test_units_give_seconds_and_hertz():
    problem = replace(of("no communications"), units=Units(delay_s=1e-5, doppler_hz=2000.0, carrier_hz=1e10))
    recovery = solve(problem, certify=False)
    delays, dopplers = np.sort(problem.truth[0].points[:, 0]), problem.truth[0].points[:, 1]
    np.testing.assert_allclose(np.sort(recovery.delays_s["radar"]), 1e-5 * delays, atol=1e-12)
    signed = np.where(dopplers < 0.5, dopplers, dopplers - 1)
    np.testing.assert_allclose(np.sort(recovery.dopplers_hz["radar"]), np.sort(2000 * signed), atol=1e-4)
    with pytest.raises(SettingError, match="units: found none"):
        _ = recovered("no communications").delays_s


def test_neither_import_nor_solution_loads_torch():
    script = (
        "import sys, tmca.dbd;"
        "assert not {'numpy', 'scipy', 'torch'} & set(sys.modules);"
        "from tmca.dbd import simulate, solve;"
        "assert solve(simulate(M=7, P=3, J=1, targets=1, paths=0)).exact;"
        "print(' '.join({'torch', 'cvxpy', 'matplotlib', 'xarray'} & set(sys.modules)))"
    )
    told = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert told.stdout.split() == []


@pytest.mark.parametrize("snr_db", [None, 20.0])
def test_samples_that_the_bases_hardly_reach_are_told(snr_db):
    problem = simulate(M=9, P=3, J=2, targets=1, paths=0, seed=1, snr_db=snr_db)
    silent = np.abs(np.arange(9) - 4) > 1
    one = problem.sources[0]
    narrow = replace(problem, sources=(Source("radar", np.where(silent[:, None], 0, one.rows), one.message),))
    left = np.linalg.norm(problem.y[..., silent]) ** 2 / np.linalg.norm(problem.y) ** 2
    for given, known in ((narrow, r"\d% at most"), (replace(narrow, sigma=None), "unknown")):
        with pytest.warns(LittleExplained, match=rf"energy \(noise: {known}\)") as told:
            recovery = solve(given, certify=False)
        assert recovery.residual**2 >= left - 1e-12
        assert left > 0.5
        assert f"{recovery.residual**2:.0%} of the samples' energy" in str(told[0].message)


@pytest.mark.parametrize(("snr_db", "sigma"), [(20, "known"), (20, None), (-20, "known")])
def test_good_samples_and_those_that_may_be_noise_alone_are_not_told_of(snr_db, sigma):
    problem = simulate(M=9, P=3, J=2, targets=1, paths=0, seed=1, snr_db=snr_db)
    with warnings.catch_warnings():
        warnings.simplefilter("error", LittleExplained)
        solve(replace(problem, sigma=problem.sigma if sigma else None), certify=False)


def test_a_programme_that_has_not_converged_says_so(monkeypatch):
    problem = simulate(M=7, P=4, J=2, targets=1, paths=1, seed=1)
    monkeypatch.setattr(solving, "solve_admm", partial(solving.solve_admm, iterations=50))
    assert any("has not converged: residual" in note for note in solve(problem, "sdp", early=False).notes)
    monkeypatch.undo()
    assert not any("converged" in note for note in solve(problem, "sdp", early=False).notes)
