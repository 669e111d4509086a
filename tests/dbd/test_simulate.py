"""Simulated samples are those of thesis equation (58), sample by sample."""

import numpy as np
import pytest

from tests.dbd.loops import KINDS, samples, small
from tmca.dbd import simulate
from tmca.dbd.simulation import fourier, random_rows
from tmca.errors import SettingError

MORE = [{"lag": 0.13}, {"late_samples": 2, "basis": "gaussian"}, {"paths": (1, 2)}, {"amplitudes": (0.2, 3.0)}]


@pytest.mark.parametrize(
    ("kind", "more"),
    [*((kind, {}) for kind in KINDS), *((kind, more) for kind in ("shared", "block") for more in MORE)],
)
def test_samples_are_those_of_the_slow_loop(kind, more):
    problem = small(kind, **more)
    slow = samples(problem.shape, problem.sources, problem.truth)
    assert np.abs(slow).max() > 0.1
    np.testing.assert_allclose(problem.y, slow, atol=1e-12)


@pytest.mark.parametrize(
    ("kind", "message", "subspace"),
    [
        ("shared", [0, 0, 0, 0, 0], 2),
        ("block", [0, 1, 2, 3, 4], 2),
        ("dense", [0, 0, 0, 0, 0], 10),
        ("three pulses a symbol", [0, 0, 0, 1, 1], 2),
        ("two symbols a pulse", [0, 1, 2, 3, 4], 4),
    ],
)
def test_messages_spread_as_they_are_named(kind, message, subspace):
    link = small(kind).sources[1]
    assert (link.message.tolist(), link.subspace) == (message, subspace)
    assert small(kind).sources[0].message.tolist() == [0] * 5
    assert np.all(small(kind).sources[0].rows == small(kind).sources[0].rows[0])
    assert not np.any([np.allclose(link.rows[p], link.rows[0]) for p in range(1, 5)])


@pytest.mark.parametrize("frequencies", [8, 9])
def test_short_symbols_keep_to_their_part_of_the_interval(frequencies):
    link = simulate(M=frequencies, P=2, J=2, targets=0, paths=1, symbol_ratio=0.5).sources[0]
    in_time = np.abs(fourier(frequencies).conj().T @ link.rows)
    first = (frequencies + 1) // 2
    np.testing.assert_allclose(in_time[:, first:, :2], 0, atol=1e-14)
    np.testing.assert_allclose(in_time[:, :first, 2:], 0, atol=1e-14)
    assert in_time[:, :first, :2].min() > 0.1
    assert in_time[:, first:, 2:].min() > 0.1


def test_a_known_waveform_is_the_whole_basis():
    problem, blind = small("known waveforms"), small("shared")
    for known, source, truth in zip(problem.sources, blind.sources, blind.truth, strict=True):
        np.testing.assert_allclose(known.rows[..., 0], source.signal(truth.waveform), atol=1e-14)
    np.testing.assert_allclose(problem.y, blind.y, atol=1e-12)


def test_noise_has_the_power_it_should_have():
    problem = simulate(M=41, P=31, J=2, snr_db=7, seed=1)
    clean = simulate(M=41, P=31, J=2, seed=1).y
    added = problem.y - clean
    assert problem.sigma == pytest.approx(np.sqrt(np.mean(np.abs(clean) ** 2) / 10**0.7))
    assert np.mean(np.abs(added) ** 2) == pytest.approx(problem.sigma**2, rel=0.1)
    assert abs(np.mean(added**2)) < 0.1 * problem.sigma**2
    assert simulate(M=9, P=5, J=2).sigma == 0


@pytest.mark.parametrize(
    ("targets", "paths", "names"),
    [
        (2, 0, ["radar"]),
        (0, 1, ["communications"]),
        ((), (1,), ["communications"]),
        ((1, 2), 1, ["radar 1", "radar 2", "communications"]),
        (np.int64(1), (2, 0, 1), ["radar", "communications 1", "communications 2"]),
    ],
)
def test_only_sources_with_paths_are_there(targets, paths, names):
    problem = simulate(M=7, P=5, J=2, targets=targets, paths=paths)
    assert [source.name for source in problem.sources] == names
    counts = [n for n in (*np.atleast_1d(targets), *np.atleast_1d(paths)) if n]
    assert [len(truth.points) for truth in problem.truth] == counts


def test_paths_are_apart_where_it_shows():
    for seed in range(5):
        problem = simulate(M=9, P=6, J=2, targets=2, paths=2, messages="block", seed=seed)
        radar, link = (truth.points for truth in problem.truth)
        assert np.any(np.minimum((radar[0] - radar[1]) % 1, (radar[1] - radar[0]) % 1) >= [1 / 4, 1 / 3, 1])
        assert 1 / 4 <= (link[0, 0] - link[1, 0]) % 1 <= 3 / 4
        assert np.all(radar[:, 2] == 0)
        assert np.all(link[:, 2] == 0)


@pytest.mark.parametrize("kind", ["vandermonde", "gaussian", "dft", "sign"])
def test_bases_are_of_unit_power_and_full_rank(kind):
    rows = random_rows(np.random.default_rng(0), 400, 3, kind)
    np.testing.assert_allclose(np.mean(np.abs(rows) ** 2, axis=0), 1, atol=0.2)
    off = rows.conj().T @ rows / 400 - np.eye(3)
    assert np.abs(off).max() < 0.2
    if kind != "gaussian":
        np.testing.assert_allclose(np.abs(rows), 1)


@pytest.mark.parametrize(
    ("where", "given"),
    [
        ("M", {"M": 0}),
        ("M", {"M": 10**12}),
        ("P", {"P": -1}),
        ("antennas", {"antennas": 0}),
        ("targets and paths", {"targets": 0, "paths": 0}),
        ("targets and paths", {"targets": 10**9}),
        *(("numbers of the bases", {one: 10**9}) for one in ("P", "J", "antennas")),
        ("numbers of the bases", {"M": 200, "P": 300, "messages": "dense"}),
        ("targets", {"targets": -1}),
        ("targets", {"targets": 1.5}),
        ("snr_db", {"snr_db": float("nan")}),
        ("amplitudes", {"amplitudes": (0.0, 1.0)}),
        ("amplitudes", {"amplitudes": (2.0, 1.0)}),
        ("messages", {"messages": "loud"}),
        ("basis", {"basis": "wavelets"}),
        *(("symbol_ratio", {"symbol_ratio": one}) for one in (1.5, 0, float("nan"), 1 / 6)),
        ("separation", {"separation": (0.1,)}),
        ("late_samples", {"late_samples": 14}),
        ("basis of radar", {"J": 14}),
        ("samples of radar", {"M": 1, "P": 1, "J": 1, "targets": 1, "paths": 0}),
    ],
)
def test_impossible_settings_are_refused(where, given):
    with pytest.raises(SettingError) as caught:
        simulate(**given)
    assert caught.value.where == where
