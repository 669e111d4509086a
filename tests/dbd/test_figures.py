"""The planes: every source, the estimate, the truth where it is known, in units where there are any."""

from dataclasses import replace

import numpy as np
import pytest

from tmca.dbd import Units, delay_doppler_planes, simulate, solve
from tmca.dbd.atoms import Atoms
from tmca.dbd.planes import planes
from tmca.errors import SettingError
from tmca.plots.dbd import Plane, planes_figure


def drawn(recovery):
    """The figure and its axes by title."""
    figure = planes_figure([Plane(**one) for one in planes(recovery)])
    return figure, {axis.get_title(): axis for axis in figure.axes if axis.get_title()}


def line(axis, label):
    return next(one for one in axis.lines if one.get_label() == label).get_xydata()


def test_a_plane_shows_unit_norms_where_paths_are():
    problem = simulate(M=9, P=5, J=2, targets=2, paths=1, seed=0)
    recovery = solve(problem)
    figure, axes = drawn(recovery)
    pictures = ("matched filter", "norm of the dual polynomial")
    assert list(axes) == [f"{source}: {one}" for source in ("radar", "communications") for one in pictures]
    radar = axes["radar: norm of the dual polynomial"]
    image = radar.images[0]
    left, right, low, high = image.get_extent()
    assert (left, right, low, high) == (0, 1, -0.5, 0.5)
    norms = np.asarray(image.get_array())
    for delay, doppler in line(radar, "estimate"):
        row, column = int((doppler + 0.5) * norms.shape[0]), int(delay * norms.shape[1])
        assert norms[row % norms.shape[0], column] > 0.97
    atoms, sizes = Atoms(problem.sources[0], problem.shape), norms.shape
    for row, column in [(3, 5), (sizes[0] // 2, 0), (sizes[0] - 1, sizes[1] - 1)]:
        point = np.array([column / sizes[1], (row / sizes[0] - 0.5) % 1])
        value = np.linalg.norm(atoms.matrix(point).conj().T @ recovery.q.reshape(-1))
        assert norms[row, column] == pytest.approx(value / problem.sources[0].weight, abs=1e-9)
    np.testing.assert_allclose(np.sort(line(radar, "truth"), 0), np.sort(line(radar, "estimate"), 0), atol=1e-6)
    assert figure.axes[-1].get_xlabel() == "‖f‖ / weight; black line: 0.98"


def test_matched_filters_are_slow_correlations_and_gains_of_single_paths():
    problem = simulate(M=9, P=5, J=2, targets=1, paths=0, seed=1)
    recovery = solve(problem)
    planes_of = delay_doppler_planes(recovery)["radar"]
    matched, sent = planes_of["matched_filter"], recovery["radar"].signal
    assert matched.dims == ("delay", "doppler")
    n, p = np.arange(9) - 4, np.arange(5)
    for row, column in ((3, 5), (50, 0), (107, 59)):
        tau, nu = float(matched.delay[row]), float(matched.doppler[column])
        total = 0.0
        for pulse in range(5):
            for k in range(9):
                turned = np.exp(2j * np.pi * (n[k] * tau + p[pulse] * nu))
                total += np.conj(sent[pulse, k]) * problem.y[0, pulse, k] * turned
        assert float(matched[row, column]) == pytest.approx(abs(total) / np.sum(np.abs(sent) ** 2), abs=1e-9)
    assert float(matched.max()) == pytest.approx(abs(recovery["radar"].amplitudes[0]), rel=0.03)


def test_ellipses_are_those_of_the_covariance_in_units_of_the_axes():
    problem = replace(simulate(M=9, P=5, J=2, targets=2, paths=1, seed=2, snr_db=10), units=Units(3e-6, 2e5))
    recovery = solve(problem)
    [plane] = [one for one in planes(recovery, "time") if one["title"].startswith("radar")]
    assert plane["labels"] == ["delay, µs", "Doppler, kHz"]
    deviations = recovery["radar"].bounds[:, :2] * (3.0, 200.0)
    np.testing.assert_allclose(np.sqrt(np.diagonal(plane["covariances"], axis1=1, axis2=2)), deviations)
    figure = planes_figure([Plane(**plane)])
    ellipses = [one for one in figure.axes[0].lines if len(one.get_xdata()) > 50]
    factor = float(ellipses[0].get_label().split()[2]) if "times" in ellipses[0].get_label() else 1.0
    for one, centre, covariance in zip(ellipses, plane["estimate"], plane["covariances"], strict=True):
        away = (one.get_xydata() - centre) / factor
        np.testing.assert_allclose(np.einsum("ki,ij,kj->k", away, np.linalg.inv(covariance), away), 1, rtol=1e-6)


def test_axes_that_units_do_not_allow_are_refused():
    recovery = solve(simulate(M=9, P=5, J=2, targets=1, paths=0, seed=1), certify=False)
    with pytest.raises(SettingError, match="carrier_hz; take auto"):
        planes(recovery, "range")
    with pytest.raises(SettingError, match="one of auto"):
        planes(recovery, "furlongs")


def test_a_column_of_a_paper_is_as_wide_as_one():
    recovery = solve(simulate(M=9, P=5, J=2, targets=1, paths=1, seed=1), certify=False)
    figure = planes_figure([Plane(**one) for one in planes(recovery)], "a line", column=True)
    assert figure.get_size_inches()[0] == 3.5
    sizes = [text.get_fontsize() for axis in figure.axes for text in (axis.title, axis.xaxis.label)]
    assert min(sizes) >= 5.5


def test_a_scene_of_antennas_without_truth_has_units_and_says_at_which_angle():
    problem = simulate(M=7, P=4, J=2, targets=1, paths=1, antennas=3, seed=2)
    scales = Units(3e-6, 2e5, 77e9)
    _, axes = drawn(solve(replace(problem, truth=None, units=scales)))
    (radar,) = (axis for title, axis in axes.items() if title.startswith("radar: norm"))
    angle = problem.truth[0].points[0, 2]
    assert radar.get_title() == f"radar: norm of the dual polynomial at the angle {angle:.3f}"
    assert (radar.get_xlabel(), radar.get_ylabel()) == ("range, m", "radial velocity, m/s")
    delay = problem.truth[0].points[0, 0]
    assert line(radar, "estimate")[0, 0] == pytest.approx(delay * 3e-6 * 299_792_458 / 2)
    assert not any(one.get_label() == "truth" for one in radar.lines)


def test_block_messages_are_drawn_over_the_delay():
    problem = simulate(M=13, P=4, J=1, targets=1, paths=2, seed=1, messages="block", basis="gaussian")
    _, axes = drawn(solve(problem, certify=False))
    link = axes["communications: norm of the dual polynomial, no certificate"]
    assert not link.images
    assert link.get_xlabel() == "normalised delay"
    np.testing.assert_allclose(np.sort(line(link, "estimate")[:, 0]), np.sort(problem.truth[1].points[:, 0]), atol=1e-6)
