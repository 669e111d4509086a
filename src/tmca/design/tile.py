"""Judging one period of a tiled code: every pixel of it is judged with its neighbours around."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import ceil

import torch
from torch import Tensor

from tmca.cameras import CodedCamera
from tmca.design.block_mse import BlockMse
from tmca.errors import SettingError, check_shape
from tmca.operators.taps import Taps
from tmca.priors.gaussian import BlockModel
from tmca.priors.mixture import GaussianMixturePrior

_ROWS, _JUDGED, _SQUARE = 4, 26, 9
_MOST_ENTRIES = 9000
"""Measurements times taps of a block: two matrices of that side, in double precision, are 1.3 GB."""


def design_model(taps: Taps, rows: int = _ROWS) -> BlockModel:
    """The block model of a camera's taps for designs: blocks as small as it allows, so that a search takes seconds.

    For 12 bands at one pixel per band it is 4×48: on real cubes codes found on it are as good under 12×36 blocks as
    codes found on 8×48 in four times the time. Where nothing is displaced, as behind the mask of a light-field camera,
    it is 9×9 or what fits.

    Raises:
        SettingError: a dispersion so wide, or so many bands, that no block fits the memory.
    """
    span = max(taps.offsets) - min(taps.offsets)
    if span == 0:
        side = min(_SQUARE, max(1, int((_MOST_ENTRIES / len(taps.offsets)) ** 0.5)))
        return BlockModel.of(taps, (taps.scene_channels, side, side))
    for height in range(rows, 0, -1):
        for width in (_JUDGED, _JUDGED // 2, 6):
            model = BlockModel.of(taps, (taps.scene_channels, height, 2 * span + width))
            if model.measurements * len(taps.offsets) <= _MOST_ENTRIES:
                return model
    text, remedy = f"{len(taps.offsets)} taps over {span} pixels", "design with fewer bands or a smaller dispersion"
    raise SettingError("bands", text, "blocks of 1.3 GB at most", remedy)


def phases(model: BlockModel, period: tuple[int, int], shift: tuple[int, int] = (0, 0)) -> list[tuple[int, int]]:
    """Corners (top, left) of blocks whose valid columns cover one period, moved by ``shift``."""
    first, last = model.valid
    rows, columns = range(0, period[0], model.block[1]), range(0, period[1], last - first)
    return [(top + shift[0], left - first + shift[1]) for top in rows for left in columns]


def even_shifts(model: BlockModel, count: int) -> list[tuple[int, int]]:
    """Shifts (rows, columns) that share out a block evenly."""
    first, last = model.valid
    return [(i * model.block[1] // count, i * (last - first) // count) for i in range(count)]


def even_places(model: BlockModel, period: tuple[int, int], count: int) -> list[tuple[int, int]]:
    """Corners of the blocks of all even shifts over one period."""
    return [place for shift in even_shifts(model, count) for place in phases(model, period, shift)]


def count_places(model: BlockModel, period: tuple[int, int], count: int) -> int:
    """How many corners ``even_places`` gives, without a list of them."""
    first, last = model.valid
    return count * ceil(period[0] / model.block[1]) * ceil(period[1] / (last - first))


def windows(code: Tensor, block: tuple[int, int, int], places: list[tuple[int, int]]) -> Tensor:
    """(P, taps, h, w) windows of a code (taps, period rows, period columns) that repeats itself for ever."""
    (_, h, w), (_, height, width) = block, code.shape
    top, left = torch.tensor(places).unbind(1)
    rows = (top[:, None] + torch.arange(h)) % height
    columns = (left[:, None] + torch.arange(w)) % width
    return code[:, rows[:, :, None], columns[:, None, :]].transpose(0, 1)


class CodeError(ABC):
    """Expected mean squared error of a tiled code, whatever scenes are expected.

    ``error(code, shift)`` is a scalar, in squared irradiance, of one period (taps, rows, columns) of a code, judged on
    blocks that are moved by ``shift`` (rows, columns); differentiable.
    """

    @property
    @abstractmethod
    def model(self) -> BlockModel:
        """Geometry of the blocks."""

    @abstractmethod
    def __call__(self, code: Tensor, shift: tuple[int, int] = (0, 0)) -> Tensor:
        """Of one period of a code."""

    @torch.no_grad()
    def whole(self, camera: CodedCamera, shifts: int = 4) -> float:
        """The error of a camera of one period, mean over shifts of the blocks that share it out evenly."""
        code = camera.taps().code
        return float(torch.stack([self(code, shift) for shift in even_shifts(self.model, shifts)]).mean())


@dataclass(frozen=True)
class TileMse(CodeError):
    """Expected error under a Gaussian prior.

    Args:
        error: of single blocks.
        most: blocks whose error is computed at once.
    """

    error: BlockMse
    most: int = 16

    @property
    def model(self) -> BlockModel:
        """See ``CodeError``."""
        return self.error.model

    def __call__(self, code: Tensor, shift: tuple[int, int] = (0, 0)) -> Tensor:
        """See ``CodeError``."""
        places = phases(self.model, (code.shape[1], code.shape[2]), shift)
        total = code.new_zeros((), dtype=torch.float64)
        for start in range(0, len(places), self.most):
            total = total + self.error(windows(code, self.model.block, places[start : start + self.most])).sum()
        return total / len(places)


@dataclass(frozen=True)
class MixtureTileMse(CodeError):
    """Expected error under a Gaussian mixture, of an estimator that is told each block's component.

    No estimator that has to guess the component does better: a lower bound, near where components are told apart
    easily. Serves wherever a ``TileMse`` does, but for flips.

    Args:
        parts: error of every component that counts.
        weights: (parts,) what each counts for: probability times squared gain.
    """

    parts: tuple[TileMse, ...]
    weights: tuple[float, ...]

    @classmethod
    def of(
        cls, prior: GaussianMixturePrior, model: BlockModel, read_noise: float, shot: float, *, least: float = 1e-3
    ) -> MixtureTileMse:
        """Under noise in snapshot units; components that are less probable than ``least`` do not count.

        A component at gain g is the same one at gain 1 under noise smaller by g, its error larger by g².

        Raises:
            ShapeError: a prior of other blocks.
            SettingError: negative noise, or no component that counts.
        """
        check_shape("mixture prior", prior.block, model.block, "learn it on the blocks that designs are judged on")
        share = prior.weights / prior.weights.sum()
        if not bool((share >= least).any()):
            raise SettingError("least", str(least), f"at most {float(share.max()):.2g}, the largest probability")
        total = float(share[share >= least].sum())
        parts, weights = list[TileMse](), list[float]()
        for kind, probabilities in enumerate(share):
            if not bool((probabilities >= least).any()):
                continue
            error = BlockMse.of(prior.component(kind), model)
            for index in (probabilities >= least).nonzero().flatten().tolist():
                gain = float(prior.gains[index]) / float(prior.gains[0])
                parts.append(TileMse(error.under(read_noise / gain, shot / gain)))
                weights.append(float(probabilities[index]) * gain**2 / total)
        return cls(tuple(parts), tuple(weights))

    @property
    def model(self) -> BlockModel:
        """See ``CodeError``."""
        return self.parts[0].model

    def __call__(self, code: Tensor, shift: tuple[int, int] = (0, 0)) -> Tensor:
        """See ``CodeError``."""
        pairs = zip(self.weights, self.parts, strict=True)
        return torch.stack([weight * part(code, shift) for weight, part in pairs]).sum()
