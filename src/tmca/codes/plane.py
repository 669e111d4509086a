"""One plane of codes, aperture or shutter: K binary patterns, fixed or learnable, full frame or tiled.

Hard binary codes have a smooth derivative, so that devices show what training optimised.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from math import ceil
from typing import Any

import torch
from torch import Tensor, nn

from tmca.codes.buckets import check_patterns, plane_patterns
from tmca.codes.patterns import FAMILIES, balanced_choice, one_hot_planes, pattern
from tmca.errors import SettingError, ShapeError, check_choice, check_range

_MARGIN = 0.5


class _HardThreshold(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, logits: Tensor, slope: float) -> Tensor:
        ctx.save_for_backward(logits)
        ctx.slope = slope
        return (logits > 0).to(logits.dtype)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None]:
        (logits,) = ctx.saved_tensors
        open_share = torch.sigmoid(ctx.slope * logits)
        return grads[0] * ctx.slope * open_share * (1 - open_share), None


def hard_threshold(logits: Tensor, slope: float = 4.0) -> Tensor:
    """Binary code ``1[logits > 0]`` with the derivative of ``sigmoid(slope · logits)``.

    Args:
        logits: any shape; its sign is the code.
        slope: steepness of the smooth stand-in, 1/unit of the logits; raised during training (annealing).

    Source: Martel et al. 2020, "Neural sensors", as used in thesis sections 3.1 and 4.2.
    """
    return _HardThreshold.apply(logits, float(slope))


def one_hot_slots(logits: Tensor, slope: float = 4.0) -> Tensor:
    """One-hot choice over the slot axis: 1 in the slot with the largest logit, derivative of the softmax.

    Args:
        logits: (K, H, W).
        slope: inverse temperature of the softmax.
    """
    soft = torch.softmax(slope * logits, dim=0)
    hard = torch.zeros_like(soft).scatter_(0, logits.argmax(0, keepdim=True), 1.0)
    return soft + (hard - soft).detach()


def check_shares(where: str, values: Tensor, expected: str, remedy: str = "") -> None:
    """Raises SettingError unless all values are in [0, 1]."""
    smallest, largest = torch.aminmax(values)  # NaN where any value is
    if not 0 <= smallest <= largest <= 1 + 1e-6:
        raise SettingError(where, "values outside [0, 1]", expected, remedy)


class CodePlane(nn.Module):
    """K patterns of one device, all of them 0 or 1 in the forward pass.

    Args:
        patterns: a family name (see ``tmca.codes.pattern``) or the patterns, (K, h, w), or (h, w) for all slots.
            Grey values between 0 and 1 (a measured mask) are kept as they are and cannot be learned.
        slots: number of time slots K.
        size: (H, W) of the plane, pixels.
        period: side, or (height, width), of the tile that is repeated over the plane; full frame if None.
        density: share of open pixels of a named family.
        seed: of a named family.
        learnable: logits become a ``Parameter``; the structure of the family (static, one-hot, complementary) is kept.
        slope: of the surrogate derivative, see ``hard_threshold``; assign to ``plane.slope`` to anneal it. With
            ``plane.relaxed = True`` the patterns are the smooth stand-in itself, grey between 0 and 1.
        jitter: share by which the distances of the logits from their threshold differ at random, 0 to 1, so that equal
            patterns of different slots can part ways when they are learned.

    Raises:
        SettingError: unknown family, bad period, values outside [0, 1], grey codes that should be learned.
        ShapeError: patterns of another number of slots or another size.
    """

    def __init__(
        self,
        patterns: str | Tensor,
        slots: int,
        size: tuple[int, int],
        *,
        period: int | tuple[int, int] | None = None,
        density: float = 0.5,
        seed: int = 0,
        learnable: bool = False,
        slope: float = 4.0,
        jitter: float = 0.0,
        name: str = "code",
    ) -> None:
        super().__init__()
        self.name, self.slots, self.size, self.slope, self.relaxed = name, slots, size, float(slope), False
        self.period = tile_of(period)
        self.family = patterns if isinstance(patterns, str) else "own"
        tile = self.period or size
        if isinstance(patterns, str):
            check_choice(name, patterns, FAMILIES)
            values = pattern(patterns, slots, tile, density, seed)
        else:
            values = _own_patterns(patterns, slots, size, tile, name)
        self.grey = bool(((values != 0) & (values != 1)).any())
        if learnable and self.grey:
            expected = "zeros and ones where codes are learned"
            raise SettingError(name, "grey values", expected, "binarise it or leave it fixed")
        latent = self._latent(values, jitter, seed)
        if learnable and self.family != "open":
            self.latent = nn.Parameter(latent)
        else:
            self.register_buffer("latent", latent)

    @torch.no_grad()
    def show(self, patterns: Tensor, *, jitter: float = 0.0, seed: int = 0) -> None:
        """Show patterns (K, h, w) of one period from now on; the structure of the family stays.

        Raises:
            ShapeError: patterns of another shape.
            SettingError: patterns that the family does not contain, such as different ones for a static plane.
        """
        values = _own_patterns(patterns, self.slots, self.size, self.period or self.size, self.name)
        before = self.latent.clone()
        self.latent.copy_(self._latent(values.to(before), jitter, seed))
        if not self.tile().equal(values.to(before)):
            self.latent.copy_(before)
            raise SettingError(self.name, f"patterns that are not {self.family}", f"{self.family} ones")

    def _latent(self, values: Tensor, jitter: float, seed: int) -> Tensor:
        """Latent values that show these patterns."""
        independent = {"static": values[:1], "complementary": values[::2]}.get(self.family, values)
        latent = independent.clone() if self.grey else independent.mul(2 * _MARGIN).sub_(_MARGIN)
        if jitter and not self.grey:
            source = torch.Generator().manual_seed(seed)
            latent = latent * (1 - jitter * torch.rand(latent.shape, generator=source))
        return latent

    @property
    def learnable(self) -> bool:
        """Whether the patterns are a ``Parameter``."""
        return isinstance(self.latent, nn.Parameter)

    def tile(self) -> Tensor:
        """(K, h, w) patterns of one period."""
        if self.grey:
            return self.latent
        if self.family == "one-hot" and self.relaxed:
            return torch.softmax(self.slope * self.latent, 0)
        if self.family == "one-hot":
            return one_hot_slots(self.latent, self.slope)
        binary = torch.sigmoid(self.slope * self.latent) if self.relaxed else hard_threshold(self.latent, self.slope)
        if self.family == "static":
            return binary.expand(self.slots, -1, -1)
        if self.family == "complementary":
            return torch.stack((binary, 1 - binary), dim=1).flatten(0, 1)[: self.slots]
        return binary

    def resized(self, size: tuple[int, int]) -> CodePlane:
        """The same tile over a plane of another size (H, W); itself at its own size.

        Raises:
            ShapeError: patterns that do not repeat.
        """
        if size == self.size:
            return self
        if self.period is None or any(have < tile for have, tile in zip(self.size, self.period, strict=True)):
            patterns = f"patterns of {self.size[0]}×{self.size[1]} pixels that do not repeat"
            raise ShapeError(self.name, patterns, f"{size[0]}×{size[1]}", "crop the scene, or take tiled codes")
        other = copy.copy(self)  # parameters and buffers, those of one tile, are shared
        other.size = size
        return other

    def forward(self) -> Tensor:
        """(K, H, W) patterns of the whole plane."""
        values = self.tile()
        if self.period is None:
            return values
        repeats = (ceil(self.size[0] / self.period[0]), ceil(self.size[1] / self.period[1]))
        return values.repeat(1, *repeats)[:, : self.size[0], : self.size[1]]

    def part(self, rows: slice, columns: slice) -> Tensor:
        """(K, h, w) patterns over some pixels of the plane; the rest of it is not made."""
        values = self.tile()
        if self.period is None:
            return values[:, rows, columns]
        y, x = (
            torch.arange(length, device=values.device)[which] % period
            for length, which, period in zip(self.size, (rows, columns), self.period, strict=True)
        )
        return values[:, y[:, None], x]

    def extra_repr(self) -> str:
        """Shown by ``print``."""
        return f"{self.name}: {self.family}, slots={self.slots}, size={self.size}, period={self.period}"


def shutter_plane(
    shutter: str | Tensor | nn.Module,
    slots: int,
    buckets: int,
    size: tuple[int, int],
    period: int,
    seed: int,
    learnable: bool,
) -> CodePlane:
    """K shutter patterns on a sensor (H, W), or R·K of R buckets, tiled unless they are given for all of it.

    A one-hot shutter that is drawn opens as many pixels of a tile in every slot.

    Raises:
        SettingError: more slots than a tile has pixels, or patterns of other buckets.
    """
    if isinstance(shutter, nn.Module):
        plane = shutter.resized(size) if isinstance(shutter, CodePlane) else shutter
        check_patterns(getattr(plane, "slots", slots), buckets, slots)
        return plane  # type: ignore[return-value]
    shutter, count = plane_patterns(shutter, slots, buckets, (period, period))
    tile, own_seed = None if isinstance(shutter, Tensor) and tuple(shutter.shape[1:]) == size else period, 2 * seed + 1
    plane = CodePlane(shutter, count, size, period=tile, seed=own_seed, learnable=learnable, name="shutter")
    if isinstance(shutter, str) and shutter == "one-hot":
        if slots > period**2:
            expected = f"at most {period**2}, the pixels of its period"
            raise SettingError("slots", f"{slots} with a one-hot shutter", expected, "take a longer period")
        plane.show(one_hot_planes(balanced_choice(slots, (period, period), own_seed), slots))
    return plane


def tile_of(period: int | Sequence[int] | None) -> tuple[int, int] | None:
    """(rows, columns) of a period that may be given by one side; None of a full frame.

    Raises:
        SettingError: a side below 1.
    """
    if period is None:
        return None
    tile = (period, period) if isinstance(period, int) else (int(period[0]), int(period[1]))
    check_range("period", min(tile), 1, unit="pixels", remedy="leave it out for a full frame")
    return tile


def _own_patterns(values: Tensor, slots: int, size: tuple[int, int], tile: tuple[int, int], name: str) -> Tensor:
    values = torch.as_tensor(values).to(torch.get_default_dtype())
    if values.ndim == 2:
        values = values.expand(slots, -1, -1)
    if values.ndim != 3 or values.shape[0] != slots:
        remedy = f"pass slots={values.shape[0]} (--slots {values.shape[0]})" if values.ndim == 3 else ""
        raise ShapeError(name, f"patterns of shape {tuple(values.shape)}", f"({slots}, H, W) for {slots} slots", remedy)
    if tuple(values.shape[1:]) == size and tile != size:
        values = _one_tile(values, tile, name)
    if tuple(values.shape[1:]) != tuple(min(t, s) for t, s in zip(tile, size, strict=True)):
        found = f"patterns of {values.shape[1]}×{values.shape[2]} pixels"
        remedy = "make them of this size (a mask: sensor and the views' shear around it), or give period= their size"
        remedy += " if they repeat (in a file of codes the attribute period: [rows, columns])"
        raise ShapeError(name, found, f"{size[0]}×{size[1]}", remedy)
    check_shares(name, values, "0 = closed, 1 = open", "scale the patterns")
    return values.contiguous()


def _one_tile(values: Tensor, tile: tuple[int, int], name: str) -> Tensor:
    """The first tile of full-size patterns, once they are seen to repeat."""
    for axis, step in ((1, tile[0]), (2, tile[1])):
        length = values.shape[axis] - step
        if length > 0 and not torch.equal(values.narrow(axis, 0, length), values.narrow(axis, step, length)):
            raise SettingError(name, f"patterns that do not repeat every {step} pixels", "patterns of this period")
    return values[:, : tile[0], : tile[1]]
