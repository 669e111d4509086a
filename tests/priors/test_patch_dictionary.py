"""A dictionary finds the atoms that made its examples."""

import numpy as np
import pytest
import torch

from tmca.errors import DataError, SettingError, ShapeError
from tmca.priors import PatchDictionary

VIEWS = (3, 3)


def light_field(h=30, w=33, disparity=1, seed=0):
    """(9, h, w) shifted copies of one texture, half of it flat."""
    generator = torch.Generator().manual_seed(seed)
    wide = torch.rand(1, 1, (h + 8) // 2 + 1, (w + 8) // 2 + 1, generator=generator)
    plane = torch.nn.functional.interpolate(wide, size=(h + 8, w + 8), mode="bilinear", align_corners=True)[0, 0]
    plane[:, : w // 2] = 0.4
    shifts = [(4 + v * disparity, 4 + u * disparity) for v in (-1, 0, 1) for u in (-1, 0, 1)]
    return torch.stack([plane[y : y + h, x : x + w] for y, x in shifts])


SMALL = {"patch": (4, 5), "views": VIEWS, "atoms": 24, "coreset": 300, "rank": 40, "batch": 50}


@pytest.fixture(scope="module")
def learned():
    return PatchDictionary.learn([light_field(), light_field(25, 40, 0, 1)], **SMALL, sources=("a", "b"))


def test_atoms_are_of_unit_norm_zero_mean_and_sorted_by_use(learned):
    assert learned.block == (9, 4, 5)
    assert learned.views == VIEWS
    flat = learned.atoms.flatten(1)
    torch.testing.assert_close(torch.linalg.vector_norm(flat, dim=1), torch.ones(24, dtype=torch.float64))
    assert flat.mean(1).abs().max() < 1e-6
    assert (learned.scales.diff() <= 0).all()
    assert learned.notes["coreset"] == 300


def test_the_learner_finds_the_atoms_that_made_the_patches():
    generator = np.random.default_rng(0)
    true = generator.standard_normal((12, 9 * 16))
    true -= true.mean(1, keepdims=True)
    true /= np.linalg.norm(true, axis=1, keepdims=True)
    fields = []
    for _ in range(500):  # as many light fields of one patch each, of two atoms and a mean of its own
        patch = 0.5 + generator.choice([-1, 1], 2) @ true[generator.choice(12, 2, replace=False)]
        fields.append(torch.from_numpy(patch.reshape(9, 4, 4)))
    how = {"atoms": 16, "coreset": 500, "rank": 144, "penalty": 0.15, "passes": 20, "batch": 50}
    found = PatchDictionary.learn(fields, (4, 4), views=VIEWS, **how)
    alike = (found.atoms.flatten(1) @ torch.from_numpy(true).mT).abs().amax(0)
    assert alike.min() > 0.98
    assert found.residual < 0.1 * 2 / 144


def test_samples_use_atoms_as_much_as_the_examples_did(learned):
    blocks = learned.sample(20000, seed=0)
    assert blocks.shape == (20000, *learned.block)
    means = blocks.flatten(1).mean(1)
    assert float(means.mean()) == pytest.approx(learned.notes["mean"], rel=0.01)
    assert float(means.std()) == pytest.approx(learned.notes["mean_deviation"], rel=0.05)
    atoms = learned.atoms.flatten(1)  # Laplacian coefficients have twice their squared scale as variance
    expected = 2 * atoms.mT @ torch.diag(learned.scales.square()) @ atoms
    away = blocks.flatten(1) - means[:, None]
    assert float((torch.cov(away.mT) - expected).norm() / expected.norm()) < 0.1


def test_progress_is_told_to_the_end():
    shares = []
    small = SMALL | {"atoms": 4, "coreset": 40}
    PatchDictionary.learn([light_field(15, 15)], **small, progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


@pytest.mark.parametrize(
    ("fields", "changes", "error", "where"),
    [
        ([], {}, ShapeError, "cubes"),
        ([light_field(), light_field()[:3]], {}, ShapeError, "cube 1"),
        ([light_field()], {"views": (3, 5)}, ShapeError, "views"),
        ([light_field()], {"patch": (40, 4)}, ShapeError, "cube 0"),
        ([light_field()], {"coreset": 10**6}, SettingError, "coreset"),
        ([light_field()], {"atoms": 0}, SettingError, "atoms"),
        ([light_field()], {"penalty": 0.0}, SettingError, "penalty"),
        ([torch.full((9, 20, 20), 0.5)], {"coreset": 50}, DataError, "light fields"),
    ],
)
def test_what_cannot_teach_is_refused(fields, changes, error, where):
    with pytest.raises(error) as caught:
        PatchDictionary.learn(fields, **SMALL | changes)
    assert caught.value.where == where
