"""The planes: every source, the estimate, the truth where it is known, in units where there are any."""

from dataclasses import replace

import numpy as np
import pytest

from tmca.dbd import Units, simulate, solve
from tmca.dbd.atoms import Atoms
from tmca.dbd.planes import planes
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
    assert list(axes) == ["radar: norm of the dual polynomial", "communications: norm of the dual polynomial"]
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
    assert figure.axes[-1].get_ylabel() == "‖f‖ / weight; black line: 0.98"


def test_a_scene_of_antennas_without_truth_has_units_and_says_at_which_angle():
    problem = simulate(M=7, P=4, J=2, targets=1, paths=1, antennas=3, seed=2)
    scales = Units(3e-6, 2e5, 77e9)
    _, axes = drawn(solve(replace(problem, truth=None, units=scales)))
    (radar,) = (axis for title, axis in axes.items() if title.startswith("radar"))
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
