"""The prior of scenes that move within an exposure, from that of scenes that stand still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import ceil, comb, prod
from typing import Any

import torch
from torch import Tensor

from tmca.cameras.motion import places_passed
from tmca.errors import DataError
from tmca.priors.gaussian import GaussianPrior

_ENTRIES, _COMPLETE, _FEWEST_COLUMNS, _VIEW_ENTRIES = 8064, 6, 12, 2600
_DETAIL = 0.1
"""Share of a prior's covariance that smoother scenes have of it: an edge in one is not smoothed away."""
_NO_SHARE = 1e-12
"""Rounding of shares that are none."""


def reach_of(motion: float) -> int:
    """Pixels by which blocks of a moving scene are smaller than those of the prior that it is made of."""
    return 2 * ceil(motion / 2)


def moving_block(camera: Any, frames: int) -> tuple[int, int]:
    """(rows, columns) of the blocks of a scene that moves before a camera, whose frames are channels of their own.

    For 12 bands in four frames 6×28: on a CAVE scene 4×28 gave 0.5 dB less, and 6×36 no more in longer time.
    """
    channels = frames * prod(camera.scene_shape[:-2])
    if camera.views is not None:
        side = max(3, int((_VIEW_ENTRIES / channels) ** 0.5))
        return side - 1 + side % 2, side - 1 + side % 2
    columns = max(2 * camera.dispersion_extent + _COMPLETE, _FEWEST_COLUMNS)
    return max(2, min(12, _ENTRIES // (channels * columns))), columns


def moving_prior(
    prior: GaussianPrior,
    frames: int,
    motion: float,
    block: tuple[int, int] | None = None,
    displacements: Sequence[tuple[float, float]] | None = None,
) -> GaussianPrior:
    """Blocks of the frames of scenes that move as a whole, every displacement up to ``motion`` being as likely.

    Frame g of a scene s is ``x_g = E_t s(p - v t)`` over its time t, bilinear between pixels. The covariance of two
    frames is that of the still scene, averaged over displacements v along both axes and over the times of both: exactly
    that of moved scenes, without a movie to learn from.

    Args:
        prior: of still scenes (L, h, w), the same everywhere.
        frames: G of equal length in the exposure.
        motion: largest displacement over the exposure along each axis, pixels.
        block: (rows, columns) at most.
        displacements: (rows, columns) over the exposure, none beyond ``motion``, that are as likely instead of all.

    Returns:
        The prior of blocks (G·L, h - r, w - r), r = ``reach_of(motion)``; channel g·L + l is channel l in frame g.

    Raises:
        DataError: a prior of blocks that are too small, or that is not the same everywhere.
    """
    (channels, h, w), reach = prior.block, reach_of(motion)
    if not prior.stationary or min(h, w) <= reach:
        found = f"blocks of {h}×{w} pixels" if prior.stationary else "one that is not the same everywhere"
        raise DataError("prior", found, f"larger ones than {reach}×{reach}, the same everywhere", "learn it again")
    rows, columns = (min(side - reach, most) for side, most in zip((h, w), block or (h, w), strict=True))
    pairs = _pairs(frames, motion, all_displacements(motion) if displacements is None else displacements)
    lags = prior.displaced
    moments = lags.new_zeros(frames, channels, frames, channels, 2 * rows - 1, 2 * columns - 1)
    for one, other, down, across in (pairs.abs() > _NO_SHARE).nonzero().tolist():
        top, left = h - rows + reach - down, w - columns + reach - across
        seen = lags[..., top : top + 2 * rows - 1, left : left + 2 * columns - 1]
        moments[one, :, other].add_(seen, alpha=float(pairs[one, other, down, across]))
    mean = prior.mean[:, :rows, :columns].repeat(frames, 1, 1)
    lengths = None if prior.wavelengths is None else prior.wavelengths * frames
    return replace(prior, mean=mean, moments=moments.flatten(2, 3).flatten(0, 1), wavelengths=lengths)


def smoother_prior(prior: GaussianPrior, reach: int) -> GaussianPrior:
    """Blocks of scenes with a tenth of the fine detail: nine tenths of the covariance are those of the same scenes
    blurred by a binomial kernel of ``reach`` + 1 pixels along each axis.

    Args:
        prior: (L, h, w), the same everywhere.
        reach: pixels by which the blocks (L, h - reach, w - reach) are smaller, even.
    """
    shares = [comb(2 * reach, tap) / 4**reach for tap in range(2 * reach + 1)]
    lags = prior.displaced
    for axis in (2, 3):
        length = lags.shape[axis] - 2 * reach
        lags = torch.stack([share * lags.narrow(axis, tap, length) for tap, share in enumerate(shares)]).sum(0)
    rows, columns = (lags.shape[2] + 1) // 2, (lags.shape[3] + 1) // 2
    sharp = prior.displaced[..., reach : reach + lags.shape[2], reach : reach + lags.shape[3]]
    moments = (1 - _DETAIL) * lags + _DETAIL * sharp
    return replace(prior, mean=prior.mean[:, :rows, :columns], moments=moments)


def all_displacements(motion: float) -> list[tuple[float, float]]:
    """(rows, columns) up to ``motion`` along each axis, a pixel or less apart."""
    steps = torch.linspace(-motion, motion, 2 * ceil(motion) + 1).tolist() if motion else [0.0]
    return [(down, across) for down in steps for across in steps]


def _pairs(frames: int, motion: float, displacements: Sequence[tuple[float, float]]) -> Tensor:
    """(G, G, 2r+1, 2r+1), r = ``reach_of(motion)``: how often frames see places that are so far from each other."""
    seen = torch.stack([_seen(frames, displacement, motion) for displacement in displacements])
    side = 2 * seen.shape[-1] - 1
    spectra = torch.fft.rfft2(seen, s=(side, side))
    together = torch.einsum("ngyx,nfyx->gfyx", spectra.conj(), spectra) / len(seen)
    return torch.fft.irfft2(together, s=(side, side)).roll((side // 2, side // 2), (-2, -1))


def _seen(frames: int, displacement: tuple[float, float], motion: float) -> Tensor:
    """(G, r+1, r+1) shares of the displacements by whole pixels that each frame of one motion sees."""
    half = reach_of(motion) // 2
    shares = torch.zeros(frames, 2 * half + 1, 2 * half + 1, dtype=torch.float64)
    for frame, places in enumerate(places_passed(displacement, frames)):
        for (row, column), share in places.items():
            shares[frame, half + row, half + column] += share
    return shares
