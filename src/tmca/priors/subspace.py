"""Prior of scenes at any wavelengths: one Gaussian over wavelength and space, in the subspace of spectra."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self
from warnings import warn

import torch
from torch import Tensor

from tmca.errors import SettingError, ShapeError, check_range
from tmca.priors.gaussian import GaussianPrior
from tmca.priors.prior import Prior
from tmca.priors.statistics import FLOOR, checked_cubes, stationary_moments

BEYOND = 30e-9
"""Metres beyond what was learned in which bands are decoded: as far as their loss was measured."""
LOSS = "bands beyond lose 0.7 to 1.5 dB on average of five indoor scenes, 3 dB at most, and others up to 0.6 dB"
"""Under priors of 400 to 700 nm that 10 to 30 nm at both ends were withheld from (``studies/beyond.py``)."""
_NEAR = 1e-9
"""Metres beyond that count as within."""


class BandsBeyond(UserWarning):
    """Bands outside of the wavelengths that a prior or a network of any bands was learned at: estimates suffer."""


@dataclass(frozen=True, eq=False, repr=False)
class SubspacePrior(Prior):
    """Scenes as samples of one Gaussian over wavelength and space, for cameras of any bands in and near its range.

    Spectra lie in a subspace of R dimensions that is known at L wavelengths and interpolated linearly between them;
    ``at`` gives the `GaussianPrior` of a camera's bands, which equals the one that interpolated scenes teach, but for
    what they have outside of the subspace. Up to 30 nm beyond its range, a band differs from the outermost one as much
    as the band that lies as far inside, but independently.

    Args:
        mean: (L,) spectrum.
        basis: (L, R) orthonormal spectra.
        moments: (R, R, h, w) covariance of the components of two pixels by their distance in rows and columns.
        wavelengths: of the L channels, ascending, in metres.
        sources: names (and checksums) of the scenes it was learned from.

    Raises:
        ShapeError: parts that do not belong together.
        SettingError: fewer than two wavelengths, or some that do not ascend.
    """

    kind: ClassVar[str] = "subspace"
    called: ClassVar[str] = "a prior of any bands"
    of_rendered: ClassVar[bool] = False
    learned_by: ClassVar[str] = "`tmca prior learn --any-bands`"
    dimensions: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "mean": ("channel",),
        "basis": ("channel", "component"),
        "autocovariance": ("component", "other_component", "dy", "dx"),
    }
    mean: Tensor
    basis: Tensor
    moments: Tensor
    wavelengths: tuple[float, ...] = ()
    sources: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        count, rank = len(self.mean), self.basis.shape[-1]
        fits = self.basis.shape == (count, rank) and self.moments.ndim == 4 and self.moments.shape[:2] == (rank, rank)
        if not fits or self.mean.ndim != 1 or len(self.wavelengths) != count:
            found = ", ".join(f"{name} {tuple(getattr(self, name).shape)}" for name in ("mean", "basis", "moments"))
            raise ShapeError("prior", found, f"({count},), ({count}, R) and (R, R, h, w), and {count} wavelengths")
        interpolation(self.wavelengths, torch.tensor(self.wavelengths))  # refuses those that do not ascend

    @property
    def block(self) -> tuple[int, int, int]:
        return len(self.mean), self.moments.shape[2], self.moments.shape[3]

    @classmethod
    def learn(
        cls,
        cubes: Iterable[Tensor],
        block: tuple[int, int] = (12, 122),
        *,
        rank: int = 16,
        wavelengths: Sequence[float] | None = None,
        sources: Sequence[str] = (),
    ) -> Self:
        """The prior of example cubes (L, H, W) at ``wavelengths`` in metres.

        Args:
            rank: dimensions of the subspace, those of most energy; L at most.

        Raises:
            SettingError: no wavelengths, some that do not ascend, or no dimension.
        """
        check_range("rank", rank, 1, whole=True)
        if wavelengths is None:
            raise SettingError("wavelengths", "none", "those of the examples", "name them in metres")
        mean, moments = stationary_moments(checked_cubes(cubes, block), block, floor=0.0)
        mean = mean[:, 0, 0]
        _, vectors = torch.linalg.eigh(moments[:, :, 0, 0] + torch.outer(mean, mean))
        basis = vectors.flip(1)[:, :rank]
        inside = torch.einsum("ar,bs,abyx->rsyx", basis, basis, moments)
        return cls(mean, basis, inside, tuple(float(v) for v in wavelengths), tuple(sources))

    def at(self, wavelengths: Sequence[float], block: tuple[int, int] | None = None) -> GaussianPrior:
        """The prior of blocks (h, w) at other bands, in metres; of its own where they are not larger.

        Raises:
            SettingError: wavelengths more than 30 nm outside of its range.
        """
        rows, columns = block or self.block[1:]
        between = self._interpolation(within(wavelengths, self.wavelengths))
        part = self.moments[:, :, :rows, :columns]
        parts = [between @ self.basis, *self._increments(wavelengths, between)]
        moments = torch.stack([torch.einsum("lr,ms,rsyx->lmyx", one, one, part) for one in parts]).sum(0)
        moments[:, :, 0, 0] += FLOOR * torch.eye(len(moments)).to(moments)
        mean = (between @ self.mean)[:, None, None].expand(-1, *part.shape[2:]).clone()
        return GaussianPrior(mean, moments, tuple(wavelengths), self.sources)

    def _interpolation(self, wavelengths: Sequence[float]) -> Tensor:
        return interpolation(wavelengths, torch.tensor(self.wavelengths).to(self.mean)).to(self.mean)

    def _increments(self, wavelengths: Sequence[float], between: Tensor) -> Iterator[Tensor]:
        """(L, R) how bands below, and above, the range differ from the outermost: as the ones as far inside do."""
        first, last = self.wavelengths[0], self.wavelengths[-1]
        for end, sign in ((first, -1), (last, 1)):
            apart = [max(sign * far, 0.0) for far in beyond(wavelengths, self.wavelengths)]
            if any(apart):
                inside = [end - sign * far for far in apart]
                outermost = torch.tensor([[far > 0] for far in apart]).to(between)
                yield outermost * (between - self._interpolation(inside)) @ self.basis

    def sample(self, count: int, seed: int) -> Tensor:
        return self.at(self.wavelengths).sample(count, seed)

    def figure(self) -> Any:
        """Mean spectrum, basis, and how far components reach."""
        return self.at(self.wavelengths, (4, 8)).figure()

    def _picture(self) -> Any:
        return self.at(self.wavelengths, (4, 8))._picture()

    def arrays(self) -> dict[str, Tensor]:
        return {"mean": self.mean, "basis": self.basis, "autocovariance": self.moments.float()}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Tensor], about: Mapping[str, Any]) -> Self:
        prior = cls(arrays["mean"], arrays["basis"], arrays["autocovariance"], about["wavelengths"], about["sources"])
        prior.at(prior.wavelengths, (1, 1))
        return prior


def beyond(wavelengths: Sequence[float], known: Sequence[float]) -> list[float]:
    """Metres by which wavelengths lie below (negative) or above the known ones; 0 within them, and to a nanometre."""
    apart = [min(one - known[0], 0.0) + max(one - known[-1], 0.0) for one in wavelengths]
    return [far if abs(far) > _NEAR else 0.0 for far in apart]


def within(wavelengths: Sequence[float], known: Sequence[float]) -> list[float]:
    """Wavelengths, the known one at the end for those up to 30 nm beyond, or the width of the known range; metres.

    Raises:
        SettingError: wavelengths farther outside.
    """
    first, last = known[0], known[-1]
    most = min(BEYOND, last - first)
    if max(map(abs, beyond(wavelengths, known))) > most + _NEAR:
        found = f"bands from {min(wavelengths) * 1e9:.4g} to {max(wavelengths) * 1e9:.4g} nm"
        wanted = f"{first * 1e9:.4g} to {last * 1e9:.4g} nm, where it was learned, and up to {most * 1e9:.0f} nm beyond"
        remedy = f"leave these bands out, learn at them, or decode with admm-tv: up to 30 nm {LOSS}; farther ones more"
        raise SettingError("wavelengths", found, wanted, remedy)
    return [min(max(one, first), last) for one in wavelengths]


def warn_of_bands_beyond(wavelengths: Sequence[float], known: Sequence[float], what: str) -> None:
    """Warn that bands lie beyond what a prior or a network knows, and what that costs; `BandsBeyond`."""
    if any(beyond(wavelengths, known)):
        taken, learned = (f"{min(some) * 1e9:.4g} to {max(some) * 1e9:.4g} nm" for some in (wavelengths, known))
        text = f"bands from {taken} reach beyond those of the {what}, {learned}: {LOSS}"
        warn(f"{text}; learn at these bands for better ones", BandsBeyond, stacklevel=3)


def interpolation(wavelengths: Sequence[float], knots: Tensor) -> Tensor:
    """(L, K) weights, float64, by which values at K ascending knots make values at L wavelengths, linear between them.

    Args:
        wavelengths, knots: metres.

    Raises:
        SettingError: wavelengths outside of the knots, or knots that do not ascend.
    """
    knots, places = knots.double(), torch.tensor(tuple(wavelengths), dtype=torch.float64).to(knots.device)
    if len(knots) < 2 or not bool((knots.diff() > 0).all()):
        raise SettingError("wavelengths", f"{len(knots)} that do not ascend", "two at least, ascending")
    first, last = float(knots[0]), float(knots[-1])
    if float(places.min()) < first - _NEAR or float(places.max()) > last + _NEAR:
        found = f"bands from {float(places.min()) * 1e9:.4g} to {float(places.max()) * 1e9:.4g} nm"
        wanted = f"{first * 1e9:.4g} to {last * 1e9:.4g} nm, where it was learned"
        remedy = "leave these bands out, or learn at them"
        raise SettingError("wavelengths", found, wanted, remedy)
    left = (torch.searchsorted(knots, places, right=True) - 1).clamp(0, len(knots) - 2)
    share = ((places - knots[left]) / (knots[left + 1] - knots[left])).clamp(0, 1)
    weights = places.new_zeros(len(places), len(knots))
    rows = torch.arange(len(places))
    weights[rows, left], weights[rows, left + 1] = 1 - share, share
    return weights
