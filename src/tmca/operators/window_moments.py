"""Second moments of what a spectral-depth camera records of a patch at every depth, under a Gaussian prior of scenes.

A plane of constant depth is blurred by one point spread function a slot, so that a stationary prior stays stationary
behind it: the covariance of two pixels of the snapshot depends on their displacement and on which shutter pattern and
filter each of them has. It is made in the Fourier domain, without the matrix of the camera, and is differentiable in
point spread functions, filters and shutter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from tmca.errors import SettingError, ShapeError, check_range
from tmca.operators.spectral_depth import framed, transfer_functions

WINDOW = 12
"""Side of the windows that depth is decoded from, pixels."""
CONTAMINATION = 0.1
"""Share of what a window sees that decoders and designs expect from any plane: the one with which the spectrum of
training scenes is identified best behind random masks and optimised ones (``benchmarks/depth_likelihood.py``)."""


class SceneMoments(Protocol):
    """What of a prior of scene blocks (L, h, w) counts here, such as a ``GaussianPrior``.

    ``displaced`` is the covariance (L, L, 2h-1, 2w-1) of two pixels by their displacement; it is of use where it is the
    same everywhere and ``mirrored``, the same in mirror image.
    """

    @property
    def block(self) -> tuple[int, int, int]: ...
    @property
    def mean(self) -> Tensor: ...
    @property
    def displaced(self) -> Tensor: ...
    @property
    def mirrored(self) -> bool: ...


@dataclass(frozen=True)
class SnapshotMoments:
    """Of windows (C, m, m) of a snapshot that begin at the first pixel of a tile, flattened to n = C·m·m.

    Args:
        covariance: (D, n, n) second moment of the noise-free window at every depth plane.
        cross: (D, L·m·m, n) that of the scene behind the window with it, or None.
        window: m, pixels.
    """

    covariance: Tensor
    cross: Tensor | None
    window: int


def needed_block(window: int, psf: tuple[int, int]) -> tuple[int, int]:
    """(h, w) of the prior's blocks that hold all that a window of m pixels sees."""
    return (window + psf[0] - 1, window + psf[1] - 1)


def snapshot_moments(
    prior: SceneMoments,
    psf: Tensor,
    colour: Tensor,
    shutters: Tensor,
    window: int,
    *,
    exposure: str = "equal",
    brightness: float = 1.0,
    contamination: float = 0.0,
    cross: bool = False,
) -> SnapshotMoments:
    """Moments of windows of m pixels at every depth plane.

    Args:
        prior: of the scene; stationary, its blocks at least ``needed_block``.
        psf: (K, D, L, h, w).
        colour: (C, L, Q, Q) filters of a tile times the response of the sensor's channels.
        shutters: (R, K, Q, Q) of a tile of pixels with R buckets, whose windows are of R·C channels.
        window: m, pixels.
        exposure: ``"equal"`` or ``"per-slot"``.
        brightness: variance of the scene's overall brightness, in squares of its mean; 0 takes the mean as given.
        contamination: share of what a window sees that is of any plane, all as likely, rather than of its own: around
            every real window depth changes, and who does not expect it mistakes it for something else.
        cross: whether the moments with the scene are wanted.

    Raises:
        ShapeError: a prior whose blocks are too small or of other bands.
        SettingError: a prior that is not stationary, or a contamination that is no share.
    """
    _check(prior, psf, window)
    check_range("contamination", contamination, 0, 1)
    colour, shutters, tile = _kinds(colour, shutters)
    seen = sensed_psf(psf, colour, shutters, exposure)
    needed = needed_block(window, (psf.shape[-2], psf.shape[-1]))
    frame = framed(needed, (psf.shape[-2] + window, psf.shape[-1] + window))
    power = _power(prior, needed, frame).to(torch.promote_types(seen.dtype, torch.complex64))
    mean = prior.mean[:, 0, 0].to(seen)
    pairs, kinds = _pairs(len(colour) * len(shutters), tile, window)
    covariances, crosses = [], []
    for sensed in seen.unbind(1):
        spectrum = transfer_functions(sensed, frame).flatten(2).permute(2, 0, 1)
        with_scene = power @ spectrum.mH
        level = sensed.sum((-2, -1)) @ mean
        lags = _lags(spectrum @ with_scene, frame, window) + brightness * torch.outer(level, level)[..., None, None]
        covariances.append(_gathered(lags, pairs, kinds, kinds))
        if cross:
            lags = _lags(with_scene, frame, window) + brightness * torch.outer(mean, level)[..., None, None]
            scene = torch.arange(len(mean), device=kinds.device).repeat_interleave(window**2)
            crosses.append(_gathered(lags, pairs, scene, kinds))
    with_scenes = _mixed(crosses, contamination) if cross else None
    return SnapshotMoments(_mixed(covariances, contamination), with_scenes, window)


def _mixed(moments: list[Tensor], contamination: float) -> Tensor:
    """(D, …) moments of every plane with a share of the mean of all planes."""
    every = torch.stack(moments)
    return torch.lerp(every, every.mean(0, keepdim=True), contamination) if contamination else every


def sensed_psf(psf: Tensor, colour: Tensor, shutters: Tensor, exposure: str = "equal") -> Tensor:
    """(R·C·Q·Q, D, L, h, w) response of every kind of pixel to points around it: eq. (35) as a pixel sees it.

    Arguments as in ``snapshot_moments``.
    """
    kinds = torch.cat([torch.einsum("clij,kij->cijkl", colour, one).flatten(0, 2) for one in shutters])
    return torch.einsum("jkl,kdlhw->jdlhw", kinds, psf) / (len(psf) if exposure == "equal" else 1)


def _kinds(colour: Tensor, shutters: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Filters (C, L, P, 1) and shutter (R, K, P, 1) of the P kinds of pixels, and the kind of every pixel (Q, Q).

    Pixels of the same filter and shutter are one kind, unless gradients tell them apart.
    """
    patterns = shutters.flatten(0, 1)
    flat = torch.cat((colour.flatten(0, 1), patterns)).flatten(1)
    kind = torch.arange(flat.shape[1], device=flat.device)
    if not flat.requires_grad:
        flat, kind = torch.unique(flat, dim=1, return_inverse=True)
    filters = flat[: -len(patterns), :, None].unflatten(0, colour.shape[:2])
    shown = flat[-len(patterns) :, :, None].unflatten(0, shutters.shape[:2])
    return filters, shown, kind.reshape(shutters.shape[-2:])


def _check(prior: SceneMoments, psf: Tensor, window: int) -> None:
    if not prior.mirrored:
        raise SettingError("prior", "one that depends on place or direction", "a stationary one", "learn it anew")
    bands, wanted = psf.shape[2], needed_block(window, (psf.shape[-2], psf.shape[-1]))
    if prior.block[0] != bands or prior.block[1] < wanted[0] or prior.block[2] < wanted[1]:
        found, needed = f"blocks {prior.block}", f"({bands}, {wanted[0]}, {wanted[1]}) or larger"
        raise ShapeError("prior", found, needed, "learn it with larger blocks, or take a smaller window")


def _power(prior: SceneMoments, needed: tuple[int, int], frame: tuple[int, int]) -> Tensor:
    """(F, L, L) spectrum of the prior's covariance over the displacements that are needed, F frequencies."""
    rows, columns = (slice(have - need, have + need - 1) for have, need in zip(prior.block[1:], needed, strict=True))
    return transfer_functions(prior.displaced[..., rows, columns], frame).flatten(2).permute(2, 0, 1)


def _lags(spectrum: Tensor, frame: tuple[int, int], window: int) -> Tensor:
    """(a, b, 2m-1, 2m-1) of (F, a, b): values by displacement.

    A Fourier transform that makes only what is asked for: matrix products, several times faster than whole ones.
    """
    rows, columns = (_phases(side, window, spectrum) for side in frame)
    columns = columns[:, : frame[1] // 2 + 1] * 2
    columns[:, 0] /= 2
    if frame[1] % 2 == 0:
        columns[:, -1] /= 2
    pairs = spectrum.shape[1:]
    half = rows @ spectrum.reshape(frame[0], -1)
    half = half.unflatten(1, (columns.shape[1], -1))
    lags = columns.real @ half.real - columns.imag @ half.imag
    return lags.permute(2, 0, 1).unflatten(0, pairs)


def _phases(side: int, window: int, like: Tensor) -> Tensor:
    """(2m-1, side) ``exp(2πi x k / side) / side`` of displacements x from 1-m to m-1."""
    around = torch.arange(1 - window, window, device=like.device, dtype=torch.float64)
    turns = torch.outer(around, torch.arange(side, device=like.device, dtype=torch.float64)) * (2 * torch.pi / side)
    return torch.polar(torch.full_like(turns, 1 / side), turns).to(like.dtype)


def _pairs(channels: int, tile: Tensor, window: int) -> tuple[tuple[Tensor, Tensor], Tensor]:
    """Displacement of every pair of pixels (rows, columns; each (m², m²)), and the kind of every sample (n,)."""
    y, x = (axis.flatten() for axis in torch.meshgrid(2 * [torch.arange(window, device=tile.device)], indexing="ij"))
    kind = torch.arange(channels, device=tile.device)[:, None] * (int(tile.max()) + 1)
    kind = kind + tile[y % tile.shape[0], x % tile.shape[1]]
    return (y[:, None] - y + window - 1, x[:, None] - x + window - 1), kind.flatten()


def _gathered(lags: Tensor, pairs: tuple[Tensor, Tensor], one: Tensor, other: Tensor) -> Tensor:
    """(len(one), len(other)) values of pairs of pixels of these kinds, planes of m² pixels after one another."""
    planes = tuple(len(kinds) // len(pairs[0]) for kinds in (one, other))
    rows, columns = (axis.repeat(planes) for axis in pairs)
    return lags[one[:, None], other[None], rows, columns]
