"""Frames behind a pixel shutter by kriging: every pixel is a sample of the scene while its shutter was open."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tmca.cameras import Snapshot, SpectralCamera
from tmca.decoders.patch_based.kriging import Covariance, Kriged, Samples, foretelling_covariance, krige
from tmca.errors import SettingError
from tmca.operators import SlotwiseDisperser

_POOLED = 5.0  # pixels, standard deviation of the Gaussian over which errors are pooled
_STILL = 1e-12  # variance of samples that are all alike
_EVERYWHERE = 1e-6  # weight of the mean error, which counts where no sample is near


def kriged_frames(
    snapshot: Snapshot[SpectralCamera],
    operator: SlotwiseDisperser,
    lifetime: float | None = None,
    changing: float | None = None,
) -> tuple[Tensor, Tensor, Covariance]:
    """Frames, their standard deviation, and the covariance of the scene, lengths in pixels and slots.

    Args:
        snapshot: of one band, nothing displaced, every pixel open within one frame.
        operator: of its frames.
        lifetime, changing: of the covariance, where they are given; else those that foretell the samples best.

    Returns:
        (F, 1, H, W) estimate, (F, 1, H, W) standard deviation, whose part of the scene is scaled to how well samples
        around a place are foretold, and whose part of noise is the sensor's, and the covariance.

    Raises:
        SettingError: another camera, or impossible numbers.
    """
    samples, slots = shutter_samples(snapshot, operator), snapshot.camera.slots
    frames, *size = operator.shutter.shape
    noise, spread = _noise_of_samples(snapshot, operator), samples.values.var().clamp_min(_STILL)
    covariance = foretelling_covariance(
        samples, slots, lifetime=lifetime, changing=changing, least_noise=float(noise.mean() / spread)
    )
    places = torch.cartesian_prod(*(torch.arange(n, dtype=torch.float64) for n in size))
    middles = (torch.arange(frames, dtype=torch.float64) + 0.5) * slots / frames - 0.5
    found = krige(samples, places, middles, covariance)
    gain = found.noise_gain.reshape(frames, *size)
    scene = found.variance.reshape(frames, *size) - covariance.noise * gain
    variance = scene * _scale(found, size) + noise * gain
    mean = found.mean.reshape(frames, 1, *size).float()
    return mean.clamp_min(0), variance.clamp_min(0).sqrt().float()[:, None], covariance


def sampled(camera: SpectralCamera, operator: SlotwiseDisperser) -> bool:
    """Whether every sensor pixel sees one frame of one band at most, undisplaced."""
    return camera.bands == 1 and camera.dispersion.spread == 0 and bool(((operator.shutter > 0).sum(0) <= 1).all())


def shutter_samples(snapshot: Snapshot[SpectralCamera], operator: SlotwiseDisperser) -> Samples:
    """A sample per pixel that is open: its place, the mean of its slots, its value over the light that it gets.

    Raises:
        SettingError: several bands, displaced ones, or pixels that are open in more than one frame.
    """
    camera = snapshot.camera
    if not sampled(camera, operator):
        raise SettingError("method", "'kriging'", "a shutter that opens every pixel within one frame, one band")
    shutter, gain = camera.codes()[1].double(), _gain(operator)
    seen = gain > 0
    slots = torch.arange(len(shutter), dtype=torch.float64)[:, None, None]
    times = (shutter * slots).sum(0)[seen] / shutter.sum(0)[seen]
    points = torch.cat([seen.nonzero().double(), times[:, None]], 1)
    return Samples(points, snapshot.values[0, 0].double()[seen] / gain[seen])


def _gain(operator: SlotwiseDisperser) -> Tensor:
    """(H, W) what every sensor pixel gets of a scene of 1."""
    return (operator.shutter * operator.aperture * operator.scale).double().sum(0)


def _noise_of_samples(snapshot: Snapshot[SpectralCamera], operator: SlotwiseDisperser) -> Tensor:
    """(H, W) variance of the sensor's noise in the scene's units; the mean where a pixel is never open."""
    light = _gain(operator)
    variance = snapshot.camera.noise.variance(snapshot.values)[0, 0].double() / light.square()
    return variance.where(light > 0, variance[light > 0].mean())


def _scale(found: Kriged, size: Sequence[int]) -> Tensor:
    """(H, W) variance of the scene: squared residuals over what was foretold, pooled around every place."""
    from scipy.ndimage import gaussian_filter

    known = found.residual.isfinite()

    def pooled(values: Tensor) -> NDArray[np.float64]:
        filled = values.where(known, 0).reshape(size).numpy()
        return gaussian_filter(filled, _POOLED) + _EVERYWHERE * filled.mean()

    return torch.from_numpy(pooled(found.residual**2) / pooled(found.foretold))
