"""Blocks of space and time, sparse in their cosine transform: a slow loop, scenes whose frames are known."""

import numpy as np
import pytest
import scipy.fft
import torch
from scipy.ndimage import gaussian_filter

from tmca.cameras import SpectralCamera
from tmca.decoders.space_time import BlockThreshold, local_means, space_time_dct
from tmca.operators import SlotwiseDisperser


def operator(slots, size, bands=1, share=None, seed=0):
    """One-hot shutters, or random ones of which a share is open."""
    generator = torch.Generator().manual_seed(seed)
    own = SpectralCamera(bands=bands, size=size, slots=slots, dispersion=1.0 if bands > 1 else 0.0)
    wide = (size[0], size[1] + bands - 1)
    if share is None:
        shutter = (torch.randint(slots, wide, generator=generator) == torch.arange(slots)[:, None, None]).double()
    else:
        shutter = (torch.rand(slots, *wide, generator=generator) < share).double()
    aperture = torch.ones(slots, *size).double()
    return SlotwiseDisperser(aperture, shutter, own.dispersion, None, "per-slot", moving=True)


def falling_edge(slots, size):
    rows = torch.arange(size[0], dtype=torch.float64)[None, :, None]
    edge = 0.2 * size[0] + 0.5 * size[0] * torch.arange(slots, dtype=torch.float64)[:, None, None] / slots
    return torch.sigmoid((edge - rows) / 1.5).expand(slots, *size)[None, :, None].clone()


def thresholded_slowly(movie, threshold, block, stride):
    """Block by block, SciPy's transform; movies of no more frames than a block has."""
    total, weight = np.zeros(movie.shape), np.zeros(movie.shape)
    _, height, width = movie.shape
    padded = [length + (-(length - side)) % stride for length, side in zip((height, width), block, strict=True)]
    laid = np.pad(movie, ((0, 0), (0, padded[0] - height), (0, padded[1] - width)), mode="edge")
    for top in range(0, padded[0] - block[0] + 1, stride):
        for left in range(0, padded[1] - block[1] + 1, stride):
            where = (slice(None), slice(top, top + block[0]), slice(left, left + block[1]))
            spectrum = scipy.fft.dctn(laid[where], norm="ortho")
            keep = np.abs(spectrum) >= threshold
            keep[0, 0, 0] = True
            found = scipy.fft.idctn(spectrum * keep, norm="ortho") / keep.sum()
            inside = tuple(slice(0, size) for size in total[where].shape)
            total[where] += found[inside]
            weight[where] += 1 / keep.sum()
    return total / weight


@pytest.mark.parametrize("size", [(11, 14), (8, 9)])
def test_blocks_are_thresholded_as_in_a_slow_loop(size):
    movie = torch.rand(2, 5, *size, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    found = BlockThreshold(5, size, (8, 6, 5), stride=3)(movie, 0.4)
    wanted = [thresholded_slowly(one, 0.4, (6, 5), 3) for one in movie.numpy()]
    np.testing.assert_allclose(found, wanted, rtol=1e-12)


@pytest.mark.parametrize("frames", [1, 3, 8, 9, 21])
def test_nothing_is_lost_without_a_threshold(frames):
    movie = torch.rand(1, frames, 7, 9, dtype=torch.float64)
    torch.testing.assert_close(BlockThreshold(frames, (7, 9), (8, 4, 4), stride=2)(movie, 0.0), movie)


def test_the_first_estimate_is_the_light_from_around():
    own = operator(6, (9, 10))
    snapshot = torch.rand(1, 1, 9, 10, dtype=torch.float64)
    shutter = own.shutter.numpy()
    light, back = (
        gaussian_filter(shutter * part, (1, 1.5, 1.5), mode="nearest") for part in (1.0, snapshot[0].numpy())
    )
    np.testing.assert_allclose(local_means(own, snapshot)[0, :, 0], back / light, rtol=1e-10)


def test_where_no_light_came_from_the_mean_is_taken():
    own = operator(2, (6, 60))
    own.shutter[:, :, 30:] = 0
    found = local_means(own, own.A(torch.full((1, 2, 1, 6, 60), 0.4, dtype=torch.float64)))
    torch.testing.assert_close(found, torch.full_like(found, 0.4))


@pytest.mark.parametrize(("bands", "share"), [(1, None), (1, 0.4), (2, None)])
def test_an_even_scene_comes_back(bands, share):
    own = operator(5, (18, 19), bands, share)
    scene = torch.full((1, 5, bands, 18, 19), 0.4, dtype=torch.float64)
    found = space_time_dct(own, own.A(scene), last=1e-3, iterations=10)
    torch.testing.assert_close(found, scene, atol=5e-3, rtol=0)


def test_an_edge_that_falls_is_followed_better_than_by_local_means():
    size, slots = (33, 34), 8
    own, scene = operator(slots, size), falling_edge(slots, size)
    snapshot = own.A(scene)
    shares = []
    found = space_time_dct(own, snapshot, last=0.005, progress=shares.append)
    error, before = ((one - scene).square().mean().sqrt() for one in (found, local_means(own, snapshot)))
    still = (scene - scene.mean(1, keepdim=True)).square().mean().sqrt()
    assert float(error) < 0.5 * float(before)
    assert float(error) < 0.15 * float(still)
    assert shares[-1] == 1
    assert len(shares) == 40
