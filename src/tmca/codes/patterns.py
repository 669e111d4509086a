"""Families of binary patterns, one per time slot."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from tmca.codes.blue_noise import blue_noise_ranks
from tmca.errors import SettingError


def random_pattern(slots: int, size: tuple[int, int], density: float, seed: int) -> Tensor:
    """(slots, H, W) independent pixels, open with probability ``density``."""
    generator = torch.Generator().manual_seed(seed)
    return (torch.rand(slots, *size, generator=generator) < density).float()


def open_pattern(slots: int, size: tuple[int, int], density: float, seed: int) -> Tensor:
    """(slots, H, W) of ones: no aperture, or a shutter that stays open."""
    return torch.ones(slots, *size)


def static_pattern(slots: int, size: tuple[int, int], density: float, seed: int) -> Tensor:
    """(slots, H, W) one random pattern, the same in every slot."""
    return random_pattern(1, size, density, seed).expand(slots, -1, -1).clone()


def one_hot_pattern(slots: int, size: tuple[int, int], density: float, seed: int) -> Tensor:
    """(slots, H, W) each pixel open in exactly one slot, drawn evenly."""
    generator = torch.Generator().manual_seed(seed)
    choice = torch.randint(slots, size, generator=generator)
    return torch.nn.functional.one_hot(choice, slots).permute(2, 0, 1).float().contiguous()


def complementary_pattern(slots: int, size: tuple[int, int], density: float, seed: int) -> Tensor:
    """(slots, H, W) pairs of slots of which the second is the negative of the first; an odd last slot is unpaired."""
    first = random_pattern((slots + 1) // 2, size, density, seed)
    return torch.stack((first, 1 - first), dim=1).reshape(-1, *size)[:slots].contiguous()


def blue_noise_pattern(slots: int, size: tuple[int, int], density: float, seed: int) -> Tensor:
    """(slots, H, W) blue-noise patterns, each slot from its own place on the void-and-cluster torus."""
    ranks = blue_noise_ranks(seed=seed)
    side = ranks.shape[0]
    binary = ranks < density * side * side
    rng = np.random.default_rng(seed)
    rows, columns = np.arange(size[0]), np.arange(size[1])
    shifts = rng.integers(side, size=(slots, 2))
    slices = [binary[np.ix_((rows + dy) % side, (columns + dx) % side)] for dy, dx in shifts]
    return torch.from_numpy(np.stack(slices)).float()


def s_matrix_pattern(slots: int, size: tuple[int, int], density: float, seed: int) -> Tensor:
    """(slots, H, W) each pixel follows a random column of an S-matrix: any two columns are open together as often.

    The S-matrix is that of the next order 2^p - 1 at or above the number of slots, its first rows where it has more.

    Source: Harwit and Sloane 1979, "Hadamard Transform Optics".
    """
    from scipy.linalg import hadamard

    order = 1 << slots.bit_length()
    matrix = torch.from_numpy((1 - hadamard(order)[1:, 1:]) // 2).float()
    generator = torch.Generator().manual_seed(seed)
    return matrix[:slots, torch.randint(order - 1, size, generator=generator)].contiguous()


FAMILIES: dict[str, Callable[[int, tuple[int, int], float, int], Tensor]] = {
    "random": random_pattern,
    "static": static_pattern,
    "open": open_pattern,
    "one-hot": one_hot_pattern,
    "complementary": complementary_pattern,
    "blue-noise": blue_noise_pattern,
    "s-matrix": s_matrix_pattern,
}


def pattern(family: str, slots: int, size: tuple[int, int], density: float = 0.5, seed: int = 0) -> Tensor:
    """Binary patterns of a named family.

    Args:
        family: one of ``FAMILIES``.
        slots: number of time slots K.
        size: (H, W), pixels.
        density: share of open pixels, where the family leaves it free.
        seed: same seed, same pattern.

    Returns:
        (K, H, W) of zeros and ones.

    Raises:
        SettingError: unknown family, no slots, or a density outside [0, 1].
    """
    if family not in FAMILIES:
        raise SettingError(
            "pattern family",
            repr(family),
            f"one of {', '.join(FAMILIES)}",
            "or give the patterns as an array",
        )
    if slots < 1:
        raise SettingError("slots", str(slots), "at least 1")
    if not 0 <= seed < 2**31:
        raise SettingError("seed", str(seed), "0 or more, below 2^30")
    if not 0 <= density <= 1:
        raise SettingError("transmittance", str(density), "a share between 0 and 1")
    return FAMILIES[family](slots, size, density, seed)
