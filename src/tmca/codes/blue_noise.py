"""Blue-noise ranks: every threshold of them is a binary pattern without low frequencies."""

from __future__ import annotations

from functools import lru_cache

import numpy as np


@lru_cache(maxsize=8)
def blue_noise_ranks(size: int = 48, seed: int = 0, sigma: float = 1.5) -> np.ndarray:
    """Void-and-cluster ranks on a torus.

    Args:
        size: side of the square tile, pixels.
        seed: of the initial random pattern.
        sigma: width of the Gaussian that measures crowding, pixels.

    Returns:
        (size, size) permutation of 0 … size²-1; ``ranks < p * size**2`` is a pattern of density p.

    Source: Ulichney 1993, "The void-and-cluster method for dither array generation".
    """
    kernel = _torus_gaussian(size, sigma)
    start = _relaxed_seed_pattern(size, seed, kernel)
    ranks = np.empty((size, size), dtype=np.int64)
    count = int(start.sum())
    _rank_by_removing(start.copy(), kernel, ranks)
    _rank_by_adding(start.copy(), kernel, ranks, count)
    return ranks


def _torus_gaussian(size: int, sigma: float) -> np.ndarray:
    axis = np.minimum(np.arange(size), size - np.arange(size))
    line = np.exp(-(axis**2) / (2 * sigma**2))
    return np.outer(line, line)


def _crowding(pattern: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    return np.fft.irfft2(np.fft.rfft2(pattern) * np.fft.rfft2(kernel), s=pattern.shape)


def _extreme(crowding: np.ndarray, among: np.ndarray, *, largest: bool) -> tuple[int, int]:
    worst = -np.inf if largest else np.inf
    masked = np.where(among, crowding, worst)
    flat = int(masked.argmax() if largest else masked.argmin())
    return flat // crowding.shape[1], flat % crowding.shape[1]


def _relaxed_seed_pattern(size: int, seed: int, kernel: np.ndarray) -> np.ndarray:
    """A tenth of the pixels, moved from the tightest cluster to the largest void until nothing moves."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(size * size).reshape(size, size)
    pattern = order < max(1, size * size // 10)
    crowding = _crowding(pattern.astype(float), kernel)
    for _ in range(size * size):
        cluster = _extreme(crowding, pattern, largest=True)
        pattern[cluster] = False
        crowding -= np.roll(kernel, cluster, axis=(0, 1))
        void = _extreme(crowding, ~pattern, largest=False)
        pattern[void] = True
        crowding += np.roll(kernel, void, axis=(0, 1))
        if void == cluster:
            break
    return pattern


def _rank_by_removing(pattern: np.ndarray, kernel: np.ndarray, ranks: np.ndarray) -> None:
    crowding = _crowding(pattern.astype(float), kernel)
    for rank in range(int(pattern.sum()) - 1, -1, -1):
        cluster = _extreme(crowding, pattern, largest=True)
        pattern[cluster] = False
        crowding -= np.roll(kernel, cluster, axis=(0, 1))
        ranks[cluster] = rank


def _rank_by_adding(pattern: np.ndarray, kernel: np.ndarray, ranks: np.ndarray, first: int) -> None:
    crowding = _crowding(pattern.astype(float), kernel)
    for rank in range(first, pattern.size):
        void = _extreme(crowding, ~pattern, largest=False)
        pattern[void] = True
        crowding += np.roll(kernel, void, axis=(0, 1))
        ranks[void] = rank
