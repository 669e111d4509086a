"""Error of the linear estimate where the scene is not what its prior says: the price of example scenes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import torch
from torch import Tensor

from tmca.cameras import CodedCamera
from tmca.design.expected_error import BlockMse, Products, TileMse, even_places, quadratic, windows
from tmca.devices import search_device
from tmca.errors import DataError, SettingError, ShapeError, check_range
from tmca.operators.blocks import BlockModel
from tmca.priors.gaussian import GaussianPrior
from tmca.priors.gaussian_posterior import noise_variance
from tmca.priors.statistics import pooled
from tmca.sensor import Noise

_PLACES = 16
"""Blocks that are judged at once."""


@dataclass(frozen=True)
class TransferMse:
    """Mean squared error over the valid pixels of scenes with moments of their own, estimated under a prior.

    With the estimator ``K = S_J· Aᵀ G⁻¹`` of the prior and the scene's second moments T around the prior's mean, it is
    ``tr T_JJ - 2 tr K A T_·J + tr K (A T Aᵀ + noise) Kᵀ``. For a scene that is as the prior says, T = S, it is the
    expected error.

    Args:
        error: of the prior.
        covariance: (m, T, m, T) the scene's moments of the pixels under the taps.
        crossed: (m, T, m, T) ``T_·J S_J·``, symmetrised.
        mean: (m, T) the scene's mean.
        variance: mean of the scene's moments of a valid pixel.
    """

    error: BlockMse
    covariance: Tensor
    crossed: Tensor
    mean: Tensor
    variance: float

    @classmethod
    def of(cls, error: BlockMse, prior: GaussianPrior, scene: GaussianPrior) -> TransferMse:
        """The error on scenes of one stationary prior of an estimator built on another."""
        model = error.model
        pixels, moved = model.for_buckets(1).pixels(), scene.around(prior.mean)
        flat, shape = pixels.flatten(), error.covariance.shape
        true, expected = moved.rows(flat, torch.float64), prior.rows(flat, torch.float64)
        crossed = model.in_valid(true) @ model.in_valid(expected).mT
        crossed = (crossed + crossed.mT) / (2 * model.in_valid(true[:1]).shape[1])
        mean = scene.mean.reshape(-1).double()[pixels]
        variance = float(model.in_valid(moved.variance).mean())
        return cls(error, true[:, flat].reshape(shape), crossed.reshape(shape), mean, variance)

    def to(self, device: torch.device) -> TransferMse:
        """The same scenes, and the prior's error, on another device."""
        moved = {name: getattr(self, name).to(device) for name in ("error", "covariance", "crossed", "mean")}
        return replace(self, **moved)

    def for_buckets(self, buckets: int) -> TransferMse:
        """See ``BlockMse``."""
        return replace(self, error=self.error.for_buckets(buckets))

    def __call__(self, seen: Tensor, read_noise: float, shot: float) -> Tensor:
        """(P,) errors of blocks under code windows (P, taps, h, w)."""
        weights = self.error.weights(seen)
        products = Products.of(self.error.under(read_noise, shot), weights)
        measured = quadratic(self.covariance, weights)[1]
        crossed = quadratic(self.crossed, weights)[1]
        mean = self.mean.repeat(self.error.model.buckets, 1)
        noise = noise_variance((weights * mean).sum(-1), Noise(read_noise, shot))
        spent = (products.sandwiched * (measured + torch.diag_embed(noise))).sum((1, 2))
        return self.variance - 2 * (products.inverse * crossed).sum((1, 2)) + spent


@dataclass(frozen=True)
class Examples:
    """Example scenes as stationary priors of the same block, by name: what designs are judged by.

    Args:
        model: geometry of the blocks.
        scenes: prior of each scene alone, by name.
        areas: pixels of each.
        peaks: largest value of each, share of white.
        device: where codes are judged by them.
    """

    model: BlockModel
    scenes: dict[str, GaussianPrior]
    areas: dict[str, int]
    peaks: dict[str, float]
    device: torch.device = field(default_factory=search_device)

    @property
    def light(self) -> float:
        """Mean irradiance of the scenes, share of white, by area."""
        return float(self.prior.mean.mean())

    @property
    def most_light(self) -> float:
        """Mean irradiance at which their brightest value is white: a sensor that saturates is not modelled."""
        return self.light / min(1.0, max(self.peaks.values()))

    def under(self, light: float) -> Examples:
        """The same scenes dimmed, or lit more, so that this is their mean irradiance, share of white.

        Every value is scaled alike. A scene of this mean with bright parts on black is another scene.

        Raises:
            SettingError: no light, white or more, or so much that the brightest value would be above white.
        """
        check_range("light", light, above=0, below=1)
        gain = light / self.light
        if light > 1.001 * self.most_light:  # a limit that was rounded for the message is taken
            text = f"{light:g}, which brings the brightest value to {gain * max(self.peaks.values()):.3g} times white"
            raise SettingError("light", text, f"at most {self.most_light:.4g} with these scenes")
        scenes = {name: prior.scaled(gain) for name, prior in self.scenes.items()}
        return replace(self, scenes=scenes, peaks={name: gain * peak for name, peak in self.peaks.items()})

    @cached_property
    def prior(self) -> GaussianPrior:
        """Of all scenes together."""
        return self.without(None)

    def without(self, name: str | None) -> GaussianPrior:
        """The prior of all scenes but one; of all where there is but one."""
        others = [n for n in self.scenes if n != name] or list(self.scenes)
        return pooled([self.scenes[n] for n in others], [float(self.areas[n]) for n in others])

    @cached_property
    def error(self) -> BlockMse:
        """Expected error under the prior of all, without noise."""
        return BlockMse.of(self.prior, self.model).to(self.device)

    @cached_property
    def transfers(self) -> dict[str, TransferMse]:
        """Error on each scene under the prior of the others."""
        priors = {name: self.without(name) for name in self.scenes}
        errors = {n: TransferMse.of(BlockMse.of(p, self.model), p, self.scenes[n]) for n, p in priors.items()}
        return {name: error.to(self.device) for name, error in errors.items()}

    def tile_mse(self, read_noise: float, shot: float) -> TileMse:
        """What optimisers lower."""
        return TileMse(self.error.under(read_noise, shot))

    @torch.no_grad()
    def held_out(self, camera: CodedCamera, read_noise: float, shot: float) -> dict[str, float]:
        """Mean squared error on each scene, estimated under the prior of the others, by the camera's tile of codes."""
        code, model = camera.taps().code, self.model
        period = (code.shape[1], code.shape[2])
        seen = windows(code, model.block, even_places(model, period, 2)).split(_PLACES)
        errors = {name: error.for_buckets(camera.buckets) for name, error in self.transfers.items()}
        return {
            name: float(torch.cat([error(part, read_noise, shot) for part in seen]).mean())
            for name, error in errors.items()
        }


def example_bytes(model: BlockModel, scenes: int) -> int:
    """Memory of the quadratic forms of so many example scenes, and of all together, bytes."""
    return 8 * (model.measurements * len(model.offsets)) ** 2 * (4 * scenes + 2)


def learn_examples(
    cubes: dict[str, Tensor],
    model: BlockModel,
    wavelengths: Sequence[float] | None,
    views: tuple[int, int] | None = None,
) -> Examples:
    """Examples from cubes (L, H, W) of relative irradiance.

    Args:
        cubes: by name.
        model: of the blocks.
        wavelengths: of the bands, metres; None for views.
        views: (V, U) where the channels are views, row by row.

    Raises:
        ShapeError: a scene smaller than the blocks, or of other bands.
        DataError: scenes without light.
    """
    dark = {name: float(cube.mean()) for name, cube in cubes.items() if cube.max() <= 0 or cube.mean() <= 0}
    if dark:
        text = f"no light, mean irradiance {max(dark.values()):.3g}"
        raise DataError(", ".join(dark), text, "scenes of a mean above 0", "leave them out, or check how they are read")
    (height, width), scenes = model.block[1:], {}
    for name, cube in cubes.items():
        if cube.shape[1] < height or cube.shape[2] < width:
            text = f"{cube.shape[1]}×{cube.shape[2]} pixels"
            raise ShapeError(name, text, f"at least {height}×{width}, the blocks of this camera")
        arguments: dict[str, Any] = {"wavelengths": wavelengths, "sources": [name], "views": views}
        scenes[name] = GaussianPrior.learn([cube], (height, width), **arguments)
    areas = {name: cube[0].numel() for name, cube in cubes.items()}
    return Examples(model, scenes, areas, {name: float(cube.max()) for name, cube in cubes.items()})
