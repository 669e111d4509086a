"""What example scenes say about their blocks: moments, random blocks, and kinds of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import torch
from torch import Tensor
from torch.nn.functional import one_hot

from tmca.errors import DataError, SettingError, ShapeError, check_range, check_shape

if TYPE_CHECKING:
    from tmca.priors.gaussian import GaussianPrior

FLOOR = 1e-6
"""Variance of what examples cannot tell (quantisation, noise of the example camera), in squared irradiance."""
_SHRINKAGE = 400.0
"""Members of a kind that count as much as the common covariance it is shrunk towards."""
_OUTSIDE = 60
"""Independent dimensions that the light outside the subspace counts for in the likelihood of a kind: neighbouring
fine details are correlated, so far fewer than there are pixels."""
_CLUSTERED, _CLUSTER_STEPS = 25, 25
"""Leading dimensions in which k-means sorts blocks, and its steps."""
_SUBSTITUTED = 50
"""Rows of a factor, at least, that are inverted by substitution."""


def checked_cubes(
    cubes: Iterable[Tensor], block: tuple[int, int], views: tuple[int, int] | None = None
) -> list[Tensor]:
    """The example cubes (L, H, W) as float64, checked against each other, the block (h, w) and a grid of views (V, U).

    Raises:
        ShapeError: no cube, different band counts, a block larger than a cube, or another number of views.
        DataError: values that are not finite.
    """
    examples = [torch.as_tensor(cube).to(torch.float64) for cube in cubes]
    if not examples:
        raise ShapeError("cubes", "none", "at least one cube (L, H, W)")
    for i, cube in enumerate(examples):
        check_shape(f"cube {i}", cube, (len(examples[0]), "H", "W"))
        if min(block) < 1 or cube.shape[1] < block[0] or cube.shape[2] < block[1]:
            found, wanted = f"{tuple(cube.shape[1:])} pixels", f"at least the block {block}"
            raise ShapeError(f"cube {i}", found, wanted, "choose a smaller block")
        if not torch.isfinite(cube).all():
            raise DataError(f"cube {i}", "values that are not finite", "irradiance", "mask or fill them first")
    if views is not None and views[0] * views[1] != len(examples[0]):
        raise ShapeError("views", f"{views[0]}×{views[1]}", f"{len(examples[0])} in all, as the examples have")
    return examples


def stationary_moments(
    examples: list[Tensor], block: tuple[int, int], views: tuple[int, int] | None = None, floor: float = FLOOR
) -> tuple[Tensor, Tensor]:
    """Mean (L, h, w) and covariance of blocks of example cubes (L, H, W), averaged over every position.

    That of cubes is (L, L, h, w), by distance, averaged over mirror images. Each cube is continued by its mirror images
    and correlated with itself around the resulting torus. That keeps the block covariance positive semidefinite, which
    averages over the pairs inside the frame alone do not.

    That of light fields, whose (V, U) views are the channels, row by row, is (L, L, 2h-1, 2w-1), by displacement:
    ``moments[c, o, h-1 + dy, w-1 + dx]`` is that of channel c at one pixel with channel o dy rows and dx columns on, as
    what parallax couples depends on the direction. It is averaged over what turns a light field into another one of the
    same depths: mirroring pixels and views together along an axis and, where views and block are square, exchanging the
    axes. Each example is dark beyond its frame, around its mean, to the same end.

    Raises:
        SettingError: a variance ``floor``, which is added to every pixel, below 0.
    """
    check_range("floor", floor, 0)
    (h, w), pixels = block, sum(cube[0].numel() for cube in examples)
    mean = torch.stack([cube.sum((1, 2)) for cube in examples]).sum(0) / pixels
    if views is None:
        products = [_mirrored_products(cube - mean[:, None, None], block) for cube in examples]
        moments = _symmetric(torch.stack(products).sum(0) / pixels, [], [1, 0, 2, 3])
        same = moments[:, :, 0, 0]
    else:
        turned = h == w and views[0] == views[1]
        mean = _symmetric(mean.reshape(views), [(0,), (1,)], [1, 0] if turned else None).flatten()
        reach = (torch.arange(1 - h, h), torch.arange(1 - w, w))
        frames = [(cube.shape[1] + h - 1, cube.shape[2] + w - 1) for cube in examples]
        pairs = zip(examples, frames, strict=True)
        products = [_products(cube - mean[:, None, None], frame, reach) for cube, frame in pairs]
        grid = (torch.stack(products).sum(0) / pixels).unflatten(1, views).unflatten(0, views)
        grid = _symmetric(grid, [(0, 2, 4), (1, 3, 5)], [1, 0, 3, 2, 5, 4] if turned else None)
        moments = grid.flatten(2, 3).flatten(0, 1)
        same = moments[:, :, h - 1, w - 1]
    same += floor * torch.eye(len(same)).to(same)  # a view: of a pixel with itself
    return mean[:, None, None].expand(-1, h, w).clone(), moments


def _mirrored_products(cube: Tensor, block: tuple[int, int]) -> Tensor:
    """(L, L, h, w) sums of the products of pixels of a cube, by distance, over all pairs of its mirrored torus."""
    mirrored = torch.cat([cube, cube.flip(-1)], -1)
    torus = torch.cat([mirrored, mirrored.flip(-2)], -2)
    reach = (torch.arange(block[0]), torch.arange(block[1]))
    return _products(torus, (torus.shape[1], torus.shape[2]), reach) / 4  # it holds four copies of the cube


def _products(cube: Tensor, frame: tuple[int, int], reach: tuple[Tensor, Tensor]) -> Tensor:
    """(L, L, rows, columns) sums of the products of pixels, by displacement, of a cube that begins anew after a frame,
    dark where it does not fill it."""
    spectrum, (rows, columns) = torch.fft.rfft2(cube, s=frame), reach
    bands = [torch.fft.ifft(spectrum * one.conj(), dim=-2)[:, rows] for one in spectrum]  # of all rows, those in reach
    return torch.stack([torch.fft.irfft(band, n=frame[1])[:, :, columns] for band in bands])


def _symmetric(values: Tensor, mirrors: list[tuple[int, ...]], exchange: list[int] | None) -> Tensor:
    """The mean over mirror images along groups of axes, and over an exchange of axes."""
    for axes in mirrors:
        values = (values + values.flip(axes)) / 2
    return values if exchange is None else (values + values.permute(exchange)) / 2


def pooled(priors: Sequence[GaussianPrior], weights: Sequence[float] | None = None) -> GaussianPrior:
    """The prior of a scene that is one of several, each with a stationary prior of its own.

    With weights in proportion to the scenes' areas it is the prior that ``GaussianPrior.learn`` finds from all of them.

    Args:
        priors: stationary, of the same block and wavelengths.
        weights: share of each, in any unit; equal if None.

    Raises:
        SettingError: no priors, weights that are not positive, or a prior that is not stationary.
        ShapeError: priors of different blocks.
    """
    if not priors or any(not prior.stationary for prior in priors):
        raise SettingError("pooled", f"{len(priors)} priors", "one stationary prior at least")
    if len({(prior.block, prior.mirrored) for prior in priors}) > 1:
        raise ShapeError("pooled", f"blocks {sorted({prior.block for prior in priors})}", "one block for all")
    shares = torch.ones(len(priors)) if weights is None else torch.tensor(list(weights))
    if len(shares) != len(priors) or not bool((shares > 0).all()):
        raise SettingError("weights", f"{shares.tolist()}", f"{len(priors)} numbers above 0")
    parts = list(zip((shares.double() / shares.double().sum()).tolist(), priors, strict=True))
    mean = torch.stack([share * prior.mean for share, prior in parts]).sum(0)
    moments = torch.stack([share * prior.around(mean).moments for share, prior in parts]).sum(0)
    return replace(priors[0], mean=mean, moments=moments, sources=tuple(s for prior in priors for s in prior.sources))


def random_blocks(
    examples: list[Tensor],
    block: tuple[int, int],
    count: int,
    seed: int,
    mirrored: bool,
    views: tuple[int, int] | None = None,
) -> Tensor:
    """(count, L, h, w) blocks at uniformly random places, each axis mirrored half of the time if ``mirrored``; where
    the channels are (V, U) views, together with these."""
    (h, w), generator = block, torch.Generator().manual_seed(seed)
    areas = torch.tensor([cube[0].numel() for cube in examples], dtype=torch.float64)
    chosen = torch.multinomial(areas, count, replacement=True, generator=generator).tolist()
    places = torch.rand(count, 2, generator=generator, dtype=torch.float64).tolist()
    flips = (torch.rand(count, 2, generator=generator) < 0.5).tolist()
    out = torch.empty(count, examples[0].shape[0], h, w, dtype=torch.float64)
    for i, (which, (v, u), flip) in enumerate(zip(chosen, places, flips, strict=True)):
        cube = examples[which]
        y, x = int(v * (cube.shape[1] - h + 1)), int(u * (cube.shape[2] - w + 1))
        axes = [axis for axis, turn in zip((-2, -1), flip, strict=True) if turn and mirrored]
        cut = cube[:, y : y + h, x : x + w].unflatten(0, views or (-1, 1))
        out[i] = cut.flip(axes + [axis - 2 for axis in axes if views]).flatten(0, 1)
    return out


def normalised(blocks: Tensor, gains: int) -> tuple[Tensor, Tensor, Tensor]:
    """Blocks (N, n) divided by their gain, the gains (G,) and (N,) the gain that each block has.

    Gains are powers of two below twice the mean brightness; a single gain is 1.
    """
    brightness = blocks.mean(1)
    if gains == 1:
        return blocks, blocks.new_ones(1), torch.zeros(len(blocks), dtype=torch.long)
    top = 2 * brightness.mean()
    chosen = (top / brightness.clamp(min=1e-6)).log2().round().clamp(0, gains - 1).long()
    levels = top * 2.0 ** -torch.arange(gains, dtype=torch.float64)
    return blocks / levels[chosen, None], levels, chosen


@dataclass(frozen=True)
class Kinds:
    """Moments of K kinds of blocks in a subspace, and (samples, K) the share of each block in each kind."""

    means: Tensor
    covariances: Tensor
    scales: Tensor
    members: Tensor

    @classmethod
    def fit(cls, centred: Tensor, basis: Tensor, covariance: Tensor, kinds: int, steps: int, seed: int) -> Kinds:
        """Kinds of centred blocks (N, n) in the subspace ``basis`` (n, d) of a covariance (n, n): by k-means, then by
        steps of expectation-maximisation."""
        inside = centred @ basis
        outside = (centred.square().sum(1) - inside.square().sum(1)).clamp(min=1e-9)
        shared = covariance.trace() - (basis * (covariance @ basis)).sum()
        parts = cls._of(inside, outside, one_hot(_k_means(inside[:, :_CLUSTERED], kinds, seed), kinds).double())
        for _ in range(steps):
            parts = cls._of(inside, outside, torch.softmax(parts._log_shares(inside, outside), 1))
        return replace(parts, scales=parts.scales / shared.clamp(min=1e-12))

    @classmethod
    def _of(cls, inside: Tensor, outside: Tensor, members: Tensor) -> Kinds:
        """Weighted moments of every kind, shrunk to the common covariance at the kind's own energy."""
        counts, one = members.sum(0) + 1e-9, 1e-9 * torch.eye(inside.shape[1])
        means = members.mT @ inside / counts[:, None]
        common = torch.cov(inside.mT, correction=0).reshape(one.shape) + one
        covariances = []
        for kind, count in enumerate(counts):
            away = inside - means[kind]
            alone = (away * members[:, kind : kind + 1]).mT @ away / count
            share = _SHRINKAGE / (count + _SHRINKAGE)
            covariances.append((1 - share) * alone + share * common * (alone.trace() / common.trace()) + one)
        return cls(means, torch.stack(covariances), members.mT @ outside / counts, members)

    def _log_shares(self, inside: Tensor, outside: Tensor) -> Tensor:
        """(N, K) log of the joint density of each block and kind, up to a constant."""
        columns, counts = [], self.members.sum(0)
        for mean, covariance, scale, count in zip(self.means, self.covariances, self.scales, counts, strict=True):
            factor = torch.linalg.cholesky(covariance + 1e-6 * torch.eye(len(mean)))
            white = torch.linalg.solve_triangular(factor, (inside - mean).mT, upper=False)
            distance = white.square().sum(0) + _OUTSIDE * (outside / scale + scale.log())
            columns.append((count + 1e-9).log() - factor.diagonal().log().sum() - 0.5 * distance)
        return torch.stack(columns, 1)


def _k_means(points: Tensor, count: int, seed: int) -> Tensor:
    """(N,) cluster of each point (N, d); empty clusters start again at a random point."""
    generator = torch.Generator().manual_seed(seed)
    centres = points[torch.randperm(len(points), generator=generator)[:count]]
    for _ in range(_CLUSTER_STEPS):
        nearest = torch.cdist(points, centres).argmin(1)
        fresh = points[torch.randint(len(points), (count,), generator=generator)]
        sums = torch.zeros_like(centres).index_add_(0, nearest, points)
        sizes = torch.bincount(nearest, minlength=count)[:, None]
        centres = torch.where(sizes > 0, sums / sizes.clamp(min=1), fresh)
    return torch.cdist(points, centres).argmin(1)


def lower_factor(covariance: Tensor) -> Tensor:
    """(..., n, n) lower Cholesky factor of what a prior says about measurements or pixels.

    Raises:
        SettingError: it is not positive definite.
    """
    try:
        return torch.linalg.cholesky(covariance)
    except torch.linalg.LinAlgError:  # type: ignore[attr-defined]
        wanted, remedy = "one that is positive definite", "learn the prior again"
        raise SettingError("prior", "a covariance that no scenes have", wanted, remedy) from None


def lower_inverse(factor: Tensor) -> Tensor:
    """(..., n, n) inverse of lower triangular factors, most of it by products, which are faster than substitution."""
    half = factor.shape[-1] // 2
    if half < _SUBSTITUTED:
        one = torch.eye(factor.shape[-1]).to(factor)
        return torch.linalg.solve_triangular(factor, one, upper=False)
    first, last = lower_inverse(factor[..., :half, :half]), lower_inverse(factor[..., half:, half:])
    across = last @ (factor[..., half:, :half] @ first)
    above = torch.cat([first, torch.zeros_like(across.mT)], -1)
    return torch.cat([above, torch.cat([-across, last], -1)], -2)


def leading_eigenvectors(covariance: Tensor, rank: int) -> Tensor:
    """(n, rank) orthonormal eigenvectors of a covariance (n, n), largest eigenvalue first.

    Found by subspace iteration from a fixed start, which is enough: the mixture needs a good subspace, and its
    formulas hold for the exact eigenvalues of the covariance inside it.
    """
    n = len(covariance)
    if n <= 4 * rank:
        return torch.linalg.eigh(covariance)[1].flip(1)[:, :rank].contiguous()
    start = torch.randn(n, rank + 20, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    for _ in range(12):
        start = torch.linalg.qr(covariance @ start)[0]
    inside = torch.linalg.eigh(start.mT @ covariance @ start)[1].flip(1)[:, :rank]
    return start @ inside
