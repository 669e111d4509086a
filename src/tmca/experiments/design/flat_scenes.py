"""How well masks tell depths apart on real textures: example scenes that stand at every plane in turn, decoded."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from tmca.cameras import SpectralDepthCamera
from tmca.data.light_fields import centre_window
from tmca.decoders.depth_likelihood import PatchLikelihood
from tmca.design.mask_search import SIZE, Judge
from tmca.priors import GaussianPrior

JUDGING = 6
"""Example scenes at most on which designs are judged."""


def some_of(scenes: Sequence[Any]) -> list[Any]:
    """At most ``JUDGING`` of them, spread over the list."""
    return list(scenes[:: -(-len(scenes) // JUDGING)])


def judge_on(cubes: Sequence[Tensor], prior: GaussianPrior, window: int) -> Judge | None:
    """``flat_error`` on some of the scenes that are as large as searched cameras; None if none is.

    Args:
        cubes: (L, H, W) at the searched bands.
        prior: of such scenes.
        window: of the likelihood, pixels; at least a tile is taken.
    """
    large = [cube for cube in cubes if cube.shape[1] >= SIZE[0] and cube.shape[2] >= SIZE[1]]
    if not large:
        return None
    chosen = some_of(large)
    return lambda camera: flat_error(camera, prior, chosen, max(window, camera.tile_size))


@torch.no_grad()
def flat_error(camera: SpectralDepthCamera, prior: GaussianPrior, cubes: Sequence[Tensor], window: int) -> float:
    """Mean absolute error, in depth bins, of the patch likelihood on scenes without edges of depth.

    No expectation under the prior: it shows what a mask loses where textures are not what the prior has them to be.

    Args:
        camera: no larger than the scenes.
        prior: of the scenes.
        cubes: (L, H, W) at the camera's bands.
        window: of the likelihood, pixels.
    """
    scenes = torch.stack([_middle(cube, camera.size) for cube in cubes]).float()
    decoder, planes, errors = PatchLikelihood(prior, camera, window), camera.planes, list[Tensor]()
    for place, metres in enumerate(planes.metres.tolist()):
        depth = scenes.new_full((len(scenes), 1, *camera.size), metres)
        found = decoder(camera(scenes, depth, place), planes=False, spectrum=False)
        errors.append((1 / found.depth - 1 / depth).abs().mean() / planes.step)
    return float(torch.stack(errors).mean())


def _middle(cube: Tensor, size: tuple[int, int]) -> Tensor:
    rows, columns = centre_window((cube.shape[1], cube.shape[2]), size, None, "an example scene")
    return cube[:, rows, columns]
