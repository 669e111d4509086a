"""Decoding by a dictionary: exactly sparse patches come back exactly, and patches merge as numpy says."""

import numpy as np
import pytest
import torch

from tmca.decoders import DictionaryEstimator
from tmca.decoders.dictionary import MergedPatches
from tmca.operators.taps import Taps
from tmca.priors import BlockGrid, BlockModel, PatchDictionary
from tmca.sensor import Noise

VIEWS = (3, 3)


def sparse(dictionary, *how, **more):
    """``estimate(y, taps, read, shot)`` by a dictionary."""

    def estimate(y, taps, read=0.0, shot=0.0, progress=None):
        return DictionaryEstimator(dictionary, taps, Noise(read, shot), *how, **more)(y, progress)

    return estimate


def random_dictionary(patch=(6, 5), atoms=40, seed=0, residual=0.0):
    """Zero-mean unit atoms, all equally used."""
    generator = torch.Generator().manual_seed(seed)
    draw = torch.randn(atoms, 9, *patch, generator=generator, dtype=torch.float64)
    draw -= draw.mean((1, 2, 3), keepdim=True)
    unit = torch.nn.functional.normalize(draw.flatten(1), dim=1).reshape(draw.shape)
    return PatchDictionary(unit, torch.full((atoms,), 0.3, dtype=torch.float64), VIEWS, residual)


def light_field_taps(h, w, seed=0, period=None):
    """A random code behind which each view sees its own pattern, tiled if a period is given."""
    generator = torch.Generator().manual_seed(seed)
    rows, columns = period or (h, w)
    code = torch.rand(9, rows, columns, generator=generator, dtype=torch.float64)
    tiled = code.repeat(1, -(-h // rows), -(-w // columns))[:, :h, :w]
    return Taps(tiled, tuple(range(9)), (0,) * 9, 9, w)


def snapshot(taps, scene):
    return (taps.code * scene).sum(1, keepdim=True)


def sparse_scene(dictionary, rows, columns, entries=2, seed=1):
    """(1, L, rows·h, columns·w) patches side by side, each its mean and few atoms."""
    _, h, w = dictionary.block
    generator = torch.Generator().manual_seed(seed)
    scene = torch.empty(1, 9, rows * h, columns * w, dtype=torch.float64)
    for i, j in np.ndindex(rows, columns):
        chosen = torch.randperm(len(dictionary.atoms), generator=generator)[:entries]
        size = 0.5 + torch.rand(entries, generator=generator, dtype=torch.float64)
        patch = 0.5 + torch.einsum("k,klhw->lhw", size, dictionary.atoms[chosen])
        scene[0, :, i * h : (i + 1) * h, j * w : (j + 1) * w] = patch
    return scene


@pytest.mark.parametrize("period", [None, (6, 5)])
def test_exactly_sparse_patches_come_back_exactly(period):
    dictionary = random_dictionary()
    scene = sparse_scene(dictionary, 2, 3)
    taps = light_field_taps(12, 15, period=period)
    decoder = sparse(dictionary, "omp", stride=(6, 5), slack=0, dtype=torch.float64)
    found = decoder(snapshot(taps, scene), taps)
    torch.testing.assert_close(found, scene, atol=1e-8, rtol=0)


@pytest.mark.parametrize("method", ["omp", "lasso"])
@pytest.mark.parametrize("size", [(9, 11), (8, 10), (6, 5), (3, 7), (1, 1)])
def test_a_flat_scene_of_any_size_and_batch_stays_flat(method, size):
    taps = light_field_taps(*size)
    scene = torch.tensor([0.2, 0.9], dtype=torch.float64)[:, None, None, None].expand(2, 9, *size)
    decoder = sparse(random_dictionary(residual=1e-4), method, stride=(2, 3))
    found = decoder(snapshot(taps, scene), taps, 0.01, 0.001)
    assert found.dtype == torch.float64
    torch.testing.assert_close(found, scene.contiguous(), atol=2e-3, rtol=0)


@pytest.mark.parametrize("method", ["omp", "lasso"])
def test_patches_that_share_a_code_give_what_each_alone_gives(method, monkeypatch):
    dictionary, taps = random_dictionary(residual=1e-4), light_field_taps(13, 14, period=(2, 3))
    scene = torch.rand(2, 9, 13, 14, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    decoder = sparse(dictionary, method, stride=(2, 3), tolerance=1e-5, max_iterations=600, dtype=torch.float64)
    shared = decoder(snapshot(taps, scene), taps, 0.05)
    monkeypatch.setattr("tmca.decoders.dictionary.equal_windows", lambda grid, code, places: [[p] for p in places])
    alone = decoder(snapshot(taps, scene), taps, 0.05)
    torch.testing.assert_close(shared, alone, atol=1e-4, rtol=0)


@pytest.mark.parametrize(
    ("frame", "stride"), [((11, 14), (2, 3)), ((10, 9), (1, 1)), ((7, 5), (4, 5)), ((3, 2), (2, 2))]
)
def test_patches_merge_row_by_row_as_all_at_once(frame, stride):
    block = (2, 5, 5)
    grid = BlockGrid.cover(BlockModel(block, (0, 1), (0, 0), 0), frame, stride)
    generator = torch.Generator().manual_seed(0)
    layers = np.full((len(grid.positions), 1, 2, 20, 20), np.nan)
    overlaps, rows, at = MergedPatches(grid, 1, torch.zeros(1)), [], 0
    for top in grid.tops:
        patches = torch.rand(len(grid.lefts), 1, *block, generator=generator)
        for left, patch in zip(grid.lefts, patches, strict=True):
            layers[at, ..., top : top + 5, left : left + 5] = patch.numpy()
            at += 1
        rows.append(overlaps.add(patches))
    found = torch.cat(rows, -2)
    assert found.shape == (1, 2, *frame)
    np.testing.assert_allclose(found.numpy(), np.nanmedian(layers[..., : frame[0], : frame[1]], 0), atol=1e-6)
