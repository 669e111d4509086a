"""Atoms are what a path puts on the samples; lifted channels are sums of them."""

import numpy as np
import pytest

from tests.dbd.loops import KINDS, alone, lifted, noise, scattered, slopes, small
from tmca.dbd.atoms import Atoms
from tmca.dbd.channel import each_atom, paths, relative_residual, residual, with_fitted_weights
from tmca.errors import SettingError


def families(kind):
    problem = small(kind)
    return [Atoms(source, problem.shape) for source in problem.sources]


@pytest.mark.parametrize("kind", KINDS)
def test_an_atom_is_a_path_of_the_slow_loop_and_slopes_are_its_differences(kind):
    rng = np.random.default_rng(1)
    for atoms in families(kind):
        point, weight = rng.random(len(atoms.axes)), noise(rng, atoms.size)
        expected = alone(atoms, point, weight)
        np.testing.assert_allclose(atoms.matrix(point) @ weight, expected, atol=1e-12)
        np.testing.assert_allclose(atoms.signals(point[None], weight)[0], expected, atol=1e-12)
        differences = slopes(lambda x, atoms=atoms, weight=weight: alone(atoms, x, weight), point)
        np.testing.assert_allclose(atoms.slopes(point[None], weight), differences, atol=1e-6)


@pytest.mark.parametrize(
    ("kind", "axes"),
    [
        ("shared", ("delay", "doppler")),
        ("block", ("delay",)),
        ("three pulses a symbol", ("delay", "doppler")),
        ("two symbols a pulse", ("delay",)),
        ("antennas", ("delay", "doppler", "angle")),
        ("antennas, block", ("delay", "angle")),
        ("one pulse", ("delay",)),
        ("one frequency", ("doppler",)),
    ],
)
def test_a_point_has_the_coordinates_that_show(kind, axes):
    problem = small(kind)
    atoms = Atoms(problem.sources[-1], problem.shape)
    assert atoms.axes == axes
    sizes = dict(zip(("angle", "doppler", "delay"), problem.shape, strict=True))
    assert atoms.counts.tolist() == [sizes[axis] for axis in axes]
    points = np.random.default_rng(0).random((2, len(axes)))
    np.testing.assert_array_equal(atoms.seen(atoms.full(points)), points)


def test_samples_on_which_nothing_shows_are_refused():
    with pytest.raises(SettingError) as caught:
        Atoms(small("block").sources[1], (1, 5, 1))
    assert caught.value.where == "samples of communications"


@pytest.mark.parametrize("kind", ["shared", "block", "antennas"])
def test_a_residual_is_what_the_atoms_leave(kind):
    problem = small(kind)
    channels, y = scattered(problem, 3), problem.y.reshape(-1)
    left = y - sum(alone(*one) for one in each_atom(channels))
    np.testing.assert_allclose(residual(channels, problem.y), left, atol=1e-11)
    assert relative_residual(channels, problem.y) == pytest.approx(np.linalg.norm(left) / np.linalg.norm(y))


def test_fitted_weights_leave_nothing_that_the_atoms_could_explain():
    problem = small("shared")
    channels = with_fitted_weights(scattered(problem, 3), problem.y)
    left = residual(channels, problem.y)
    for one in channels:
        np.testing.assert_allclose(one.linear().conj().T @ left, 0, atol=1e-10)


def test_twins_merge_across_the_edge_and_keep_their_signal():
    problem = small("shared")
    places = [[0.9999, 0.5], [0.0001, 0.5]], [[0.1, 0.2], [0.1, 0.45]]
    channels = lifted(problem, places, noise(np.random.default_rng(0), 2, 2, 2))
    merged = [one.merged(0.5) for one in channels]
    assert paths(merged) == (1, 2)
    before, after = residual(channels, problem.y), residual(merged, problem.y)
    assert np.linalg.norm(after - before) < 0.02 * np.linalg.norm(before)
