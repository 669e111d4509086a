"""Atoms are what a path puts on the samples; measures are sums of them."""

import numpy as np
import pytest

from tests.dbd.loops import KINDS, full, noise, samples, slopes, small
from tmca.dbd import Truth
from tmca.dbd.atoms.atoms import Atoms
from tmca.dbd.atoms.measure import Measure
from tmca.errors import SettingError


def alone(atoms, point, weight):
    """The samples of one path by the slow loop."""
    truth = Truth(np.array([full(atoms, point)]), np.ones(1), weight)
    return samples(atoms.shape, (atoms.source,), (truth,)).reshape(-1)


def both(kind):
    problem = small(kind)
    return [Atoms(source, problem.shape) for source in problem.sources]


def crowded(kind="shared", count=3, seed=0):
    """A measure with random atoms."""
    rng, measure = np.random.default_rng(seed), Measure.empty(small(kind))
    for index, atoms in enumerate(measure.atoms):
        measure.points[index] = rng.random((count, len(atoms.axes)))
        measure.weights[index] = noise(rng, count, atoms.size)
    return measure


@pytest.mark.parametrize("kind", KINDS)
def test_an_atom_is_a_path_of_the_slow_loop(kind):
    rng = np.random.default_rng(1)
    for atoms in both(kind):
        point, weight = rng.random(len(atoms.axes)), noise(rng, atoms.size)
        expected = alone(atoms, point, weight)
        np.testing.assert_allclose(atoms.matrix(point) @ weight, expected, atol=1e-12)
        np.testing.assert_allclose(atoms.signals(point[None], weight)[0], expected, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_slopes_are_finite_differences(kind):
    rng = np.random.default_rng(2)
    for atoms in both(kind):
        point, weight = rng.random(len(atoms.axes)), noise(rng, atoms.size)
        expected = slopes(lambda x, atoms=atoms, weight=weight: alone(atoms, x, weight), point)
        np.testing.assert_allclose(atoms.slopes(point[None], weight), expected, atol=1e-6)


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


def test_absorbed_dopplers_can_be_kept():
    problem = small("block")
    assert Atoms(problem.sources[1], problem.shape, every_axis=True).axes == ("delay", "doppler")


def test_samples_on_which_nothing_shows_are_refused():
    link = small("block").sources[1]
    with pytest.raises(SettingError, match="samples of communications: found 1 antenna, 5 pulses and 1 frequency"):
        Atoms(link, (1, 5, 1))


@pytest.mark.parametrize("kind", ["shared", "block", "antennas"])
def test_a_residual_is_what_the_atoms_leave(kind):
    measure = crowded(kind)
    left = measure.y - sum(alone(*one) for one in measure.each())
    np.testing.assert_allclose(measure.residual(), left, atol=1e-11)
    np.testing.assert_allclose(measure.y - measure.matrix() @ measure.vector(), left, atol=1e-11)
    assert measure.relative_residual() == pytest.approx(np.linalg.norm(left) / np.linalg.norm(measure.y))


def test_a_measure_moves_as_its_slopes_say():
    measure = crowded()

    def explained(step):
        other = measure.copy()
        other.move(step)
        return measure.y - other.residual()

    expected = slopes(explained, np.zeros(measure.slopes().shape[1]))
    np.testing.assert_allclose(measure.slopes(), expected, atol=1e-6)


def test_weights_survive_a_vector_and_a_copy():
    measure = crowded("block")
    other = measure.copy()
    other.set_vector(2 * measure.vector())
    for before, after in zip(measure.weights, other.weights, strict=True):
        np.testing.assert_array_equal(after, 2 * before)
    assert measure.unknowns == 3 * (2 * 2 + 2) + 3 * (2 * 10 + 1)


def test_fitted_weights_leave_nothing_that_the_atoms_could_explain():
    measure = crowded()
    measure.fit_weights()
    np.testing.assert_allclose(measure.matrix().conj().T @ measure.residual(), 0, atol=1e-10)


def test_points_that_are_there_are_not_added():
    measure = crowded()
    near = measure.points[0][1] + np.array([[1e-4, 0], [0.2, 0]])
    assert measure.add(0, near) == 1
    assert measure.counts == (4, 3)
    np.testing.assert_array_equal(measure.weights[0][-1], 0)


def test_atoms_are_kept_by_their_norms():
    measure = crowded()
    norms = [np.linalg.norm(weight) for _, _, weight in measure.each()]
    measure.keep(lambda one: one > np.median(norms))
    kept = [np.linalg.norm(weight) for _, _, weight in measure.each()]
    np.testing.assert_allclose(sorted(kept), sorted(norms)[3:])


def test_one_atom_less_leaves_the_measure_alone():
    measure = crowded()
    fewer = measure.without(1, 0)
    np.testing.assert_array_equal(fewer.points[1], measure.points[1][1:])
    assert (fewer.counts, measure.counts) == ((3, 2), (3, 3))


def test_twins_merge_across_the_edge_and_keep_their_signal():
    measure = crowded(count=2)
    measure.points[0] = np.array([[0.9999, 0.5], [0.0001, 0.5]])
    measure.points[1] = np.array([[0.1, 0.2], [0.1, 0.45]])
    before = measure.residual()
    assert measure.merge(0.5)
    assert measure.counts == (1, 2)
    assert np.linalg.norm(measure.residual() - before) < 0.02 * np.linalg.norm(before)
    assert not measure.merge(0.5)


def test_the_strongest_of_a_cluster_stays():
    measure = crowded(count=3)
    measure.points[0] = np.array([[0.30, 0.5], [0.32, 0.5], [0.34, 0.5]])
    measure.weights[0][1] *= 10
    measure.merge(0.5)
    np.testing.assert_array_equal(measure.points[0], [[0.32, 0.5]])
