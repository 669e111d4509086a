"""A coreset of light-field patches: few of the many, chosen so that texture is not drowned out by flat ground."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from tmca.errors import SettingError


def patch_variance(cube: Tensor, patch: tuple[int, int]) -> Tensor:
    """(H - h + 1, W - w + 1) variance of all entries of the patch (L, h, w) at each place of a cube (L, H, W)."""
    pool = torch.nn.functional.avg_pool2d
    first, second = (
        pool(values[None, None], patch, stride=1)[0, 0] for values in (cube.mean(0), cube.square().mean(0))
    )
    return (second - first.square()).clamp_min(0)


def sample_places(maps: Sequence[Tensor], count: int, generator: torch.Generator) -> list[tuple[int, int, int]]:
    """``count`` different places (map, row, column), drawn with probability in proportion to the maps.

    Raises:
        SettingError: fewer places than asked for.
    """
    most = sum(values.numel() for values in maps)
    if not 1 <= count <= most:
        raise SettingError("coreset", f"{count} patches", f"1 to {most}, the places there are", "take fewer patches")
    keys, kept = [], []
    for values in maps:  # the largest of log p + Gumbel noise are a draw without replacement
        uniform = torch.rand(values.numel(), generator=generator, dtype=torch.float64).clamp_min(1e-300)
        key = values.flatten().double().log() - (-uniform.log()).log()
        found = key.topk(min(count, len(key)))
        keys.append(found.values)
        kept.append(found.indices)
    best = torch.cat(keys).topk(count).indices
    which = torch.cat([torch.full_like(indices, i) for i, indices in enumerate(kept)])[best].tolist()
    widths = [values.shape[1] for values in maps]
    return [(i, *divmod(p, widths[i])) for i, p in zip(which, torch.cat(kept)[best].tolist(), strict=True)]


def cut(cubes: Sequence[Tensor], places: Sequence[tuple[int, int, int]], patch: tuple[int, int]) -> Tensor:
    """(N, L, h, w) patches at the places, single precision."""
    h, w = patch
    return torch.stack([cubes[i][:, y : y + h, x : x + w].float() for i, y, x in places])


def coreset(cubes: Sequence[Tensor], patch: tuple[int, int], count: int, seed: int, flat: float = 0.25) -> Tensor:
    """(N, L, h, w) patches drawn with probability ∝ variance + ``flat`` times the mean variance.

    A patch teaches a dictionary in proportion to what it varies by; the share for flat ones keeps them in.

    Raises:
        SettingError: fewer places than patches, or a share that is not above 0.
    """
    if not flat > 0:
        raise SettingError("flat", f"{flat}", "above 0", "flat patches need some probability")
    maps = [patch_variance(cube, patch) for cube in cubes]
    mean = torch.cat([values.flatten() for values in maps]).mean().clamp_min(1e-12)
    places = sample_places([values + flat * mean for values in maps], count, torch.Generator().manual_seed(seed))
    return cut(cubes, places, patch)


def even_sample(cubes: Sequence[Tensor], patch: tuple[int, int], count: int, seed: int) -> Tensor:
    """(N, L, h, w) patches from places that are all equally likely, as many as there are at most."""
    maps = [torch.ones(cube.shape[1] - patch[0] + 1, cube.shape[2] - patch[1] + 1) for cube in cubes]
    most = min(count, sum(values.numel() for values in maps))
    return cut(cubes, sample_places(maps, most, torch.Generator().manual_seed(seed)), patch)
