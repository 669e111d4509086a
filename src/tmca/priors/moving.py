"""The prior of scenes that move within an exposure, from that of scenes that stand still."""

from __future__ import annotations

from dataclasses import replace
from math import ceil, prod
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import conv2d

from tmca.cameras.motion import places_passed
from tmca.errors import DataError
from tmca.priors.gaussian import GaussianPrior

_ENTRIES, _COMPLETE, _FEWEST_COLUMNS, _VIEW_ENTRIES = 8064, 6, 12, 2600


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
    prior: GaussianPrior, frames: int, motion: float, block: tuple[int, int] | None = None
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

    Returns:
        The prior of blocks (G·L, h - r, w - r), r = ``reach_of(motion)``; channel g·L + l is channel l in frame g.

    Raises:
        DataError: a prior of blocks that are too small, or that is not the same everywhere.
    """
    (channels, h, w), reach = prior.block, reach_of(motion)
    if not prior.stationary or min(h, w) <= reach:
        found = f"blocks of {h}×{w} pixels" if prior.stationary else "one that is not the same everywhere"
        raise DataError("prior", found, f"larger ones than {reach}×{reach}, the same everywhere", "learn it again")
    lags = prior.displaced.flatten(0, 1)[:, None]
    kernels = _pairs(frames, motion).to(lags).flatten(0, 1)[:, None]
    moved = conv2d(lags, kernels.flip(-2, -1)).unflatten(0, (channels, channels)).unflatten(2, (frames, frames))
    rows, columns = (min(side - reach, most) for side, most in zip((h, w), block or (h, w), strict=True))
    away = (slice(h - reach - rows, h - reach + rows - 1), slice(w - reach - columns, w - reach + columns - 1))
    moments = moved[..., *away].permute(2, 0, 3, 1, 4, 5).flatten(2, 3).flatten(0, 1).contiguous()
    mean = prior.mean[:, :rows, :columns].repeat(frames, 1, 1)
    lengths = None if prior.wavelengths is None else prior.wavelengths * frames
    return replace(prior, mean=mean, moments=moments, wavelengths=lengths)


def _pairs(frames: int, motion: float) -> Tensor:
    """(G, G, 2r+1, 2r+1), r = ``reach_of(motion)``: how often frames see places that are so far from each other."""
    steps = torch.linspace(-motion, motion, 2 * ceil(motion) + 1).tolist() if motion else [0.0]
    seen = torch.stack([_seen(frames, (down, across), motion) for down in steps for across in steps])
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
