"""A small prior, and small cameras of one period under it."""

import torch

from tests.small_scenes import smooth_scene
from tmca.cameras import SpectralCamera
from tmca.design import BlockMse, TileMse, designable
from tmca.priors import BlockModel, GaussianPrior

PRIOR = GaussianPrior.learn([smooth_scene(40, 47, seed=s) for s in (1, 2)], (3, 9))
BANDS = 3


def designed(kind="free", slots=2, period=(4, 5), **settings):
    return designable(kind, slots, period, bands=BANDS, **settings)


def block_error(read_noise=0.05, shot=0.0, prior=PRIOR, **settings):
    wide = SpectralCamera(bands=BANDS, size=prior.block[1:], slots=1, shutter="open", **settings)
    return BlockMse.of(prior, BlockModel.of(wide.operator().taps, prior.block), read_noise, shot)


def tile_error(read_noise=0.05, shot=0.0):
    return TileMse(block_error(read_noise, shot))


def binary(camera):
    return all(bool(((plane == 0) | (plane == 1)).all()) for plane in map(torch.Tensor.detach, camera.codes()))
