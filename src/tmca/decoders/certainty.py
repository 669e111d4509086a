"""Standard deviations that follow the scene: what decoders predict, brought to the errors of scenes that are known.

Under one Gaussian prior the predicted deviation is the same for every scene. Errors are not: they are large at edges,
in textures, and where spectra are steep. All of this an estimate shows itself. The calibrated deviation is a sum of
the predicted one and of such features, each with a coefficient that was fitted on scenes from which nothing was learned
(``studies/uncertainty``). Coefficients are not negative and features scale with the scene: so does their sum.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache, cached_property
from pathlib import Path
from typing import Annotated

import torch
from pydantic import Field, TypeAdapter
from torch import Tensor
from torch.nn.functional import pad

import tmca
from tmca.attributes import Attributes
from tmca.decoders.estimate import Estimate

FILE = Path(tmca.__file__).parent / "weights" / "certainty.json"
"""All calibrations that come with the package."""
CALIBRATION = "deviation_calibration"
"""Note of an estimate: the scenes that its deviation was calibrated on."""
_NEAR, _AROUND = 3, 5
"""Sides of the windows of features, pixels."""


class Certainty(Attributes):
    """How the deviation of a decoder's estimates is calibrated.

    Args:
        decoder, camera: name and kind.
        coefficients: of `Features` by name; that of ``predicted`` keeps the deviation above zero.
        scenes: that it was fitted on.
        cameras: that took them, each in a few words.
    """

    decoder: str
    camera: str
    coefficients: dict[str, Annotated[float, Field(ge=0)]]
    scenes: list[str]
    cameras: list[str]


@cache
def calibrations(file: Path = FILE) -> Mapping[tuple[str, str], Certainty]:
    """Those of a file, by decoder and kind of camera."""
    known = TypeAdapter(list[Certainty]).validate_json(file.read_text())
    return {(one.decoder, one.camera): one for one in known}


def calibrate(estimate: Estimate, decoder: str | None = None) -> None:
    """Calibrate the deviation of an estimate, of its depth where it has one, as far as a calibration is known.

    Args:
        decoder: whose calibration is taken; None for that of the estimate's decoder.
    """
    known = calibrations().get((estimate.decoder if decoder is None else decoder, estimate.camera.kind))
    if known is None:
        return
    if estimate.deviation is not None:
        estimate.deviation = calibrated(estimate.values, estimate.deviation, known.coefficients)
    elif estimate.depth is not None and estimate.depth_deviation is not None:
        apart = calibrated(estimate.depth, estimate.depth_deviation, known.coefficients)
        estimate.depth_deviation = apart.nan_to_num(nan=float("inf"), posinf=float("inf"))  # beside an infinite depth
    else:
        return
    estimate.notes[CALIBRATION] = ", ".join(known.scenes)


def calibrated(values: Tensor, deviation: Tensor, coefficients: Mapping[str, float]) -> Tensor:
    """The calibrated deviation of estimates.

    Args:
        values: (B, …, H, W) estimates, of light (bands or views before rows and columns) or depth.
        deviation: predicted, of the same shape.
        coefficients: see `Certainty`.
    """
    exact = torch.promote_types(values.dtype, torch.float32)  # the spread is a small difference of squares
    features = Features(values.to(exact), deviation.to(exact))
    total = torch.zeros_like(features.predicted)
    for name, coefficient in coefficients.items():
        if coefficient:
            total.add_(getattr(features, name), alpha=coefficient)
    return total.to(deviation.dtype)


def change(estimate: Tensor, start: Tensor) -> Tensor:
    """Root mean square, over the square of 5 pixels around, of what a network changed of its first estimate (B, …, H,
    W): the deviation of networks that predict none themselves. Only calibrated it has the size of errors."""
    return _mean((estimate - start).square(), _AROUND).clamp_min_(0).sqrt_()


class Features:
    """What errors follow, in the units of the values, each of their shape or less.

    Args:
        values, deviation: as of `calibrated`.
    """

    def __init__(self, values: Tensor, deviation: Tensor) -> None:
        self.values, self.predicted = values, deviation
        self._channels = tuple(range(1, values.ndim - 2))

    @cached_property
    def _smooth(self) -> Tensor:
        return _mean(self.values, _AROUND)

    @property
    def activity(self) -> Tensor:
        """The spread around."""
        return _spread(self.values, self._smooth, _AROUND)

    @property
    def edges(self) -> Tensor:
        """The spread of the mean over all bands or views."""
        grey = self.values.mean(self._channels, keepdim=True)
        return _spread(grey, _mean(grey, _NEAR), _NEAR)

    @property
    def slope(self) -> Tensor:
        """Difference of the band before and the one after; of views the larger one of both axes."""
        smooth, slope = self._smooth, torch.zeros_like(self.values)
        for axis in self._channels:
            last = smooth.shape[axis] - 1
            for index in range(last + 1):
                before, after = (smooth.select(axis, min(max(i, 0), last)) for i in (index - 1, index + 1))
                here = slope.select(axis, index)
                torch.maximum(here, (after - before).abs_(), out=here)
        return slope


def _spread(values: Tensor, mean: Tensor, side: int) -> Tensor:
    return (_mean(values.square(), side) - mean.square()).clamp_min_(0).sqrt_()


def _mean(values: Tensor, side: int) -> Tensor:
    """Mean over the square of this side around every pixel, whose margins are repeated: sums of shifted pictures, which
    take a tenth of the time of a pooling layer."""
    half, flat = side // 2, values.flatten(0, -3)[None]
    for axis, margin in ((-1, (half, half, 0, 0)), (-2, (0, 0, half, half))):
        wide, length = pad(flat, margin, mode="replicate"), flat.shape[axis]
        flat = wide.narrow(axis, 0, length).clone()
        for shift in range(1, side):
            flat += wide.narrow(axis, shift, length)
    return flat.div_(side**2).reshape(values.shape)
