"""Families of binary patterns, one per time slot, and balanced random choices."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from tmca.errors import check_choice, check_range


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


def balanced_pattern(slots: int, size: tuple[int, int], density: float, seed: int) -> Tensor:
    """(slots, H, W) each pixel open in the same number of slots, ``density`` of them, drawn evenly."""
    generator = torch.Generator().manual_seed(seed)
    ranks = torch.rand(slots, *size, generator=generator).argsort(0).argsort(0)
    return (ranks < round(density * slots)).float()


FAMILIES: dict[str, Callable[[int, tuple[int, int], float, int], Tensor]] = {
    "random": random_pattern,
    "static": static_pattern,
    "open": open_pattern,
    "one-hot": one_hot_pattern,
    "complementary": complementary_pattern,
    "blue-noise": blue_noise_pattern,
    "s-matrix": s_matrix_pattern,
    "balanced": balanced_pattern,
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
    check_choice("family", family, FAMILIES)
    check_range("slots", slots, 1)
    check_range("seed", seed, 0, below=2**31)
    check_range("density", density, 0, 1)
    return FAMILIES[family](slots, size, density, seed)


def balanced_choice(count: int, size: tuple[int, int], seed: int = 0) -> Tensor:
    """(h, w) whole numbers from 0 to ``count - 1`` in random order, as often as each other, or once more.

    Raises:
        SettingError: nothing to choose from.
    """
    check_range("choices", count, 1)
    pixels = size[0] * size[1]
    order = torch.randperm(pixels, generator=torch.Generator().manual_seed(seed))
    return (torch.arange(pixels) % count)[order].reshape(size)


def one_hot_planes(choice: Tensor, count: int) -> Tensor:
    """(count, h, w) zeros and ones: one in the plane that every pixel of ``choice`` (h, w) names."""
    return torch.nn.functional.one_hot(choice.long(), count).movedim(-1, 0).to(torch.get_default_dtype())


@lru_cache(maxsize=8)
def blue_noise_ranks(size: int = 48, seed: int = 0, sigma: float = 1.5) -> np.ndarray:
    """Void-and-cluster ranks on a torus: every threshold of them is a binary pattern without low frequencies.

    Args:
        size: side of the square tile, pixels.
        seed: of the initial random pattern.
        sigma: width of the Gaussian that measures crowding, pixels.

    Returns:
        (size, size) permutation of 0 … size²-1; ``ranks < p * size**2`` is a pattern of density p.

    Source: Ulichney 1993, "The void-and-cluster method for dither array generation".
    """
    axis = np.minimum(np.arange(size), size - np.arange(size))
    line = np.exp(-(axis**2) / (2 * sigma**2))
    kernel = np.outer(line, line)
    order = np.random.default_rng(seed).permutation(size * size).reshape(size, size)
    start = order < max(1, size * size // 10)
    crowding = _crowding(start, kernel)
    for _ in range(size * size):  # from the tightest cluster to the largest void, until nothing moves
        cluster = _turn(start, crowding, kernel, cluster=True)
        if _turn(start, crowding, kernel, cluster=False) == cluster:
            break
    ranks, count = np.empty((size, size), dtype=np.int64), int(start.sum())
    for taken, ranking in ((True, range(count - 1, -1, -1)), (False, range(count, size * size))):
        pattern = start.copy()
        crowding = _crowding(pattern, kernel)
        for rank in ranking:
            ranks[_turn(pattern, crowding, kernel, cluster=taken)] = rank
    return ranks


def _crowding(pattern: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    return np.fft.irfft2(np.fft.rfft2(pattern.astype(float)) * np.fft.rfft2(kernel), s=pattern.shape)


def _turn(pattern: np.ndarray, crowding: np.ndarray, kernel: np.ndarray, *, cluster: bool) -> tuple[int, int]:
    """Take the pixel of the tightest cluster out, or put one into the largest void; its place."""
    masked = np.where(pattern == cluster, crowding, -np.inf if cluster else np.inf)
    place = divmod(int(masked.argmax() if cluster else masked.argmin()), pattern.shape[1])
    pattern[place] = not cluster
    crowding += np.roll(-kernel if cluster else kernel, place, axis=(0, 1))
    return place
