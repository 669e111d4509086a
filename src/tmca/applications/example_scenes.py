"""How well masks tell depths apart on real textures: example scenes at known depths, decoded without a network."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tmca.cameras import SpectralDepthCamera
from tmca.data.fitting import centre_window
from tmca.data.spectral_depth import drawn_nearness
from tmca.decoders import PatchLikelihood
from tmca.design.mask_search import SIZE, Judge
from tmca.priors import GaussianPrior

Error = Callable[[SpectralDepthCamera, GaussianPrior, Sequence[Tensor], int], float]
FRAME = 4
"""Sides of a judged window in the frame whose depths are drawn: 64 pixels of 256."""
JUDGING = 6
"""Example scenes at most on which designs are judged."""


def some_of(scenes: Sequence[Any]) -> list[Any]:
    """At most ``JUDGING`` of them, spread over the list."""
    return list(scenes[:: -(-len(scenes) // JUDGING)])


def judge_on(cubes: Sequence[Tensor], prior: GaussianPrior, window: int, error: Error | None = None) -> Judge | None:
    """The error on some of the scenes that are as large as searched cameras; None if none is.

    Args:
        cubes: (L, H, W) at the searched bands.
        prior: of such scenes.
        window: of the likelihood, pixels; at least a tile is taken.
        error: ``placed_error`` or ``flat_error``; the first if None.
    """
    large = [cube for cube in cubes if cube.shape[1] >= SIZE[0] and cube.shape[2] >= SIZE[1]]
    if not large:
        return None
    chosen, error_of = some_of(large), error or placed_error
    return lambda camera: error_of(camera, prior, chosen, max(window, camera.tile_size))


def placed_error(camera: SpectralDepthCamera, prior: GaussianPrior, cubes: Sequence[Tensor], window: int) -> float:
    """Mean absolute error, in depth bins, of the patch likelihood on scenes at drawn depths, with edges and slopes.

    No expectation under the prior: it shows what a mask loses where textures are not what the prior has them to be, and
    at edges of depth. Every camera is judged at the same depths, as many draws a scene as there are planes.

    Args:
        camera: no larger than the scenes.
        prior: of the scenes.
        cubes: (L, H, W) at the camera's bands.
        window: of the likelihood, pixels.
    """
    planes = camera.planes
    drawn = [[_nearness(camera.size, draw, number) for number in range(len(cubes))] for draw in range(planes.count)]
    inverse = 1 / planes.far + (1 / planes.near - 1 / planes.far) * torch.from_numpy(np.array(drawn))
    return _error(camera, prior, cubes, window, (1 / inverse).float()[:, :, None])


def _nearness(size: tuple[int, int], draw: int, number: int) -> NDArray[np.float64]:
    """(H, W) share of the range: the middle of a frame that is ``FRAME`` times as wide, with as few edges."""
    whole = drawn_nearness((FRAME * size[0], FRAME * size[1]), np.random.default_rng([draw, number]))
    rows, columns = centre_window((whole.shape[0], whole.shape[1]), size, None, "a drawn depth")
    return whole[rows, columns]


def flat_error(camera: SpectralDepthCamera, prior: GaussianPrior, cubes: Sequence[Tensor], window: int) -> float:
    """The same on scenes without edges of depth, which stand at every plane in turn; arguments as of `placed_error`."""
    depths = camera.planes.metres.float()[:, None, None, None, None].expand(-1, len(cubes), 1, *camera.size)
    return _error(camera, prior, cubes, window, depths)


@torch.no_grad()
def _error(
    camera: SpectralDepthCamera, prior: GaussianPrior, cubes: Sequence[Tensor], window: int, depths: Tensor
) -> float:
    """Mean error in bins over depths (draws, scenes, 1, H, W) of the middles of scenes."""
    device = camera.point_spread.waves.device
    scenes = torch.stack([_middle(cube, camera.size) for cube in cubes]).float().to(device)
    decoder, errors = PatchLikelihood(prior.to(device), camera, window), list[Tensor]()
    for draw, depth in enumerate(depths.to(device)):
        estimate = decoder(camera(scenes, depth, generator=draw), planes=False, spectrum=False)
        errors.append((1 / estimate.depth - 1 / depth).abs().mean() / camera.planes.step)
    return float(torch.stack(errors).mean())


def _middle(cube: Tensor, size: tuple[int, int]) -> Tensor:
    rows, columns = centre_window((cube.shape[1], cube.shape[2]), size, None, "an example scene")
    return cube[:, rows, columns]
