"""A network in the subspace of spectra: one for cameras of any bands, codes, buckets and noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from typing import Any, NamedTuple, Self

import torch
from torch import Tensor, nn
from torch.nn.functional import softplus

from tmca.decoders.nets.network import (
    LEVEL_REACH,
    RESIDUAL,
    Network,
    code_maps,
    data_step,
    local_level,
    noise_maps,
    settings_of,
)
from tmca.decoders.nets.unet import ConvolutionalBody
from tmca.errors import check_range
from tmca.operators import TapOperator
from tmca.priors import beyond, interpolation, within
from tmca.sensor import Noise

_FIRST_SHIFT = -3.0  # softplus: 0.05
_RIDGE = 1e-5  # of the least squares that find coefficients, relative to their own variance
_DATA, _CODES = 4.0, 0.25  # bring what the data step adds, and codes, to the size of the other inputs
_MOST_CODE = 20.0
_SHAPES = 6
"""Smooth functions of wavelength whose sum is the logarithm of the standard deviation."""
_LEAST_DEVIATION, _WIDEST = 1e-4, 6.0  # of the local level, and of its logarithm


class Moments(NamedTuple):
    """Estimates (B, L, H, W) of scenes, and their standard deviation."""

    estimate: Tensor
    deviation: Tensor


class SubspaceNetwork(Network):
    """Unrolled stages that add spectra of a subspace: ``x ← x + B · prox(B⁺x, B⁺Aᵀ(A Aᵀ + μ)⁻¹(y - A x), T, noise)``.

    Spectra of scenes lie close to a subspace of few dimensions, whose basis B is known at some wavelengths and
    interpolated to the camera's: the layers see coefficients, never bands, so that one network serves cameras of any
    bands within its range, any codes, one bucket and two. What the first estimate has outside of the subspace stays,
    and so do bands up to 30 nm beyond the range; their standard deviation is that of a band at its end.
    All stages share their layers. Beside the estimate the network predicts its standard deviation.

    >>> network = SubspaceNetwork(rank=3, widths=[8], blocks=1).at([450e-9, 550e-9, 650e-9])
    >>> network.bands
    3

    Args:
        rank: dimensions of the subspace.
        stages: number of data steps.
        widths: channels of each level of the shared proximal network, finest first.
        blocks: residual blocks on each level.
        gather: pixels gathered along each axis at the entrance.
        knots: number of wavelengths at which the basis is known.
        start: first estimate, ``"lmmse"``.

    Raises:
        SettingError: no stage, no dimension, or fewer than two wavelengths.
    """

    kind, any_bands = "subspace", True
    knots: Tensor
    basis: Tensor
    spectra: Tensor
    inverse: Tensor
    shapes: Tensor

    def __init__(
        self,
        *,
        rank: int = 16,
        stages: int = 3,
        widths: Sequence[int] = (96, 128, 160),
        blocks: int = 2,
        gather: int = 2,
        knots: int = 31,
        start: str = "lmmse",
    ) -> None:
        settings = settings_of(locals())
        super().__init__({**settings, "bands": knots})
        self.settings = settings
        check_range("stages", stages, 1)
        check_range("rank", rank, 1)
        check_range("knots", knots, 2)
        self.rank, self.stages = rank, stages
        self.shift = nn.Parameter(torch.full((stages,), _FIRST_SHIFT))
        self.body = ConvolutionalBody(4 * rank + 3, rank + _SHAPES, tuple(widths), blocks, gather)
        self.register_buffer("knots", torch.linspace(400, 700, knots))
        self.register_buffer("basis", torch.eye(knots, rank))
        self.reach, self.multiple = stages * self.body.reach + LEVEL_REACH, self.body.multiple
        self.wavelengths: tuple[float, ...] = ()

    def at(self, wavelengths: Sequence[float]) -> Self:
        """The network, with the same layers, for bands at other wavelengths, in metres.

        Raises:
            SettingError: wavelengths more than 30 nm outside of its range.
        """
        there = copy(self)
        there.wavelengths, there.bands = tuple(wavelengths), len(wavelengths)
        there._buffers = dict(self._buffers)
        for name, part in zip(("spectra", "inverse", "shapes"), self._directions(there.wavelengths), strict=True):
            there.register_buffer(name, part, persistent=False)
        return there

    def _directions(self, wavelengths: tuple[float, ...]) -> tuple[Tensor, Tensor, Tensor]:
        """(L, R) spectra of coefficients of variance one, nothing at bands beyond the range, which keep their first
        estimate; (R, L) what gives the coefficients of a spectrum, and (L, shapes) smooth functions of wavelength."""
        knots = self.knots.double() * 1e-9
        spectra = interpolation(within(wavelengths, knots.tolist()), knots) @ self.basis.double()
        gram = spectra.mT @ spectra / len(spectra) + _RIDGE * torch.eye(self.rank).to(spectra)
        inverse = torch.linalg.solve(gram, spectra.mT) / len(spectra)
        place = (torch.tensor(wavelengths).to(spectra) * 1e9 - self.knots[0]) / (self.knots[-1] - self.knots[0])
        shapes = torch.cos(torch.pi * place.clamp(0, 1)[:, None] * torch.arange(_SHAPES).to(place))
        spectra[[far != 0 for far in beyond(wavelengths, knots.tolist())]] = 0
        return spectra.to(self.basis), inverse.to(self.basis), shapes.to(self.basis)

    def forward(self, snapshot: Tensor, operator: TapOperator, noise: Noise, start: Tensor) -> Tensor:
        return self.moments(snapshot, operator, noise, start).estimate

    def moments(self, snapshot: Tensor, operator: TapOperator, noise: Noise, start: Tensor) -> Moments:
        """Estimates and their standard deviation."""
        *_, last = self.steps(snapshot, operator, noise, start)
        return last

    def outputs(self, *given: Any) -> tuple[Tensor, ...]:
        """See `Network`: the estimate and its standard deviation."""
        return tuple(self.moments(*given))

    def steps(self, snapshot: Tensor, operator: TapOperator, noise: Noise, start: Tensor) -> Iterator[Moments]:
        """What every stage says."""
        if not self.wavelengths:
            yield from self.at([1e-9 * one for one in self.knots.tolist()]).steps(snapshot, operator, noise, start)
            return
        self.check(start)
        level = local_level(start)
        given = (self._code_coefficients(operator).expand(len(start), -1, -1, -1), noise_maps(noise, level))
        floor, estimate = noise.variance(snapshot.detach()), start
        for stage, shift in enumerate(softplus(self.shift)):
            change = _DATA * data_step(snapshot, operator, estimate, shift + floor)
            parts = [torch.asinh(self._coefficients(one) / level) for one in (estimate, change)]
            turn = torch.full_like(level, stage / max(1, self.stages - 1))
            added = self.body(torch.cat((*parts, *given, turn), 1)).to(estimate.dtype)
            more, spread = added.split([self.rank, _SHAPES], 1)
            estimate = estimate + RESIDUAL * level * torch.einsum("lr,brhw->blhw", self.spectra, more)
            spread = torch.einsum("ls,bshw->blhw", self.shapes, spread)
            yield Moments(estimate, level * (_LEAST_DEVIATION + RESIDUAL * torch.exp(spread.clamp(max=_WIDEST) - 2)))

    def _code_coefficients(self, operator: TapOperator) -> Tensor:
        """(1, 2·R, H, W) of the code of the first bucket and of all together."""
        codes = code_maps(operator)
        both = torch.cat([self._coefficients(one[None]) for one in (codes[0], codes.sum(0))], 1)
        return _CODES * both.clamp(-_MOST_CODE, _MOST_CODE)

    def _coefficients(self, cube: Tensor) -> Tensor:
        """(B, R, H, W) of the spectra of a cube (B, L, H, W)."""
        return torch.einsum("rl,blhw->brhw", self.inverse, cube)
