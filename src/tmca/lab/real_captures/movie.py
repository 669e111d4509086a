"""A scene that changed during the exposure of a pixel shutter: frames from one capture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from tmca.cameras import Snapshot, SpectralCamera
from tmca.decoders.iterative.space_time import space_time_tv
from tmca.errors import SettingError
from tmca.operators import SlotwiseDisperser

if TYPE_CHECKING:
    import xarray as xr

MOVIE_METHODS = ("space-time-tv", "smoothed")


@dataclass(frozen=True)
class Movie:
    """Frames of one capture.

    Args:
        frames: (F, L, H, W) relative irradiance.
        slots: slots of the shutter that a frame stands for.
        iterations: of the decoder.
        converged: whether it came to an end by itself.
    """

    frames: Tensor
    slots: int
    iterations: int = 0
    converged: bool = True


class FrameOperator(SlotwiseDisperser):
    """The slot-wise operator of frames, whose ``A Aᵀ`` is diagonal for displacements by whole pixels."""

    def gram_solve(self, y: Tensor, shift: float) -> Tensor:
        """``(A Aᵀ + shift·I)⁻¹ y``; with shift 0, pixels without light give zero."""
        diagonal = self._energy() + shift
        return torch.where(diagonal > 0, y / diagonal.clamp_min(torch.finfo(y.dtype).tiny), 0)

    def _energy(self) -> Tensor:
        """(1, 1, H, W') squared weights that meet in every sensor pixel."""
        offsets = self._layout[1]
        total = self.shutter.new_zeros(1, 1, *self.shutter.shape[1:])
        for offset, scale in zip(offsets, self.scale, strict=True):
            light = (self.aperture * scale).square()
            seen = self.shutter[:, :, offset : offset + light.shape[2]].square()
            total[0, 0, :, offset : offset + light.shape[2]] += (light * seen).sum(0)
        return total


def frame_operator(camera: SpectralCamera, frames: int) -> FrameOperator:
    """The slot-wise operator of a scene that changes ``frames`` times, neighbouring slots sharing a frame.

    Slots of one frame see the same scene, so that the sum of their shutters is the frame's, exactly so where the
    aperture does not change.

    Raises:
        SettingError: frames that do not divide the slots, an aperture that changes, displacements by parts of pixels.
    """
    aperture, shutter = camera.codes()
    slots = len(aperture)
    if frames < 1 or slots % frames:
        raise SettingError("frames", str(frames), f"a divisor of the {slots} slots")
    if bool((aperture != aperture[:1]).any()):
        raise SettingError("aperture", "one that changes from slot to slot", "the same in all slots")
    if any(float(d) != round(d) for d in camera.dispersion.displacement):
        raise SettingError("dispersion", "parts of pixels", "displacements by whole pixels")
    merged = shutter.unflatten(0, (frames, slots // frames)).sum(1)
    weight = 1.0 if camera.exposure == "per-slot" else 1 / slots
    still = aperture[:1].expand(frames, -1, -1)
    return FrameOperator(still, merged * weight, camera.dispersion, camera.response, "per-slot", moving=True)


def decode_movie(
    snapshot: Snapshot[SpectralCamera],
    frames: int = 16,
    method: str = "space-time-tv",
    *,
    weight: float = 0.02,
    time: float = 2.0,
    reach: float = 2.0,
    max_iterations: int = 200,
) -> Movie:
    """Frames of a scene behind a pixel shutter.

    Args:
        snapshot: of a spectral camera whose aperture stays as it is.
        frames: how many.
        method: ``"space-time-tv"``, or ``"smoothed"``: the Gaussian mean of the samples around every place
            (for shutters that open every pixel once, nothing displaced).
        weight: of the total variation.
        time: of differences between frames, relative to those between pixels; for ``smoothed``, pixels that lie as
            far apart as neighbouring frames do.
        reach: standard deviation of the Gaussian of ``smoothed``, pixels.
        max_iterations: of total variation.

    Raises:
        SettingError: an unknown method, or a camera that it cannot take.
    """
    operator = frame_operator(snapshot.camera, frames)
    slots = snapshot.camera.slots // frames
    if method == "smoothed":
        return Movie(_smoothed(snapshot, operator, time, reach), slots)
    if method != "space-time-tv":
        raise SettingError("method", repr(method), f"one of {', '.join(MOVIE_METHODS)}")
    start = _smoothed(snapshot, operator, time, reach) if _sampled(operator, snapshot.camera) else None
    found = space_time_tv(
        operator, snapshot.values, weight, time=time, max_iterations=max_iterations,
        initial=None if start is None else start[None],
    )  # fmt: skip
    return Movie(found.estimate[0].clamp_min(0), slots, found.iterations, found.converged)


def _sampled(operator: FrameOperator, camera: SpectralCamera) -> bool:
    """Whether every sensor pixel sees one frame of one band at most, undisplaced."""
    return camera.bands == 1 and camera.dispersion.spread == 0 and bool(((operator.shutter > 0).sum(0) <= 1).all())


def _smoothed(snapshot: Snapshot[SpectralCamera], operator: FrameOperator, time: float, reach: float) -> Tensor:
    """(F, 1, H, W) Gaussian mean of the samples around every place (normalised convolution, Knutsson & Westin 1993)."""
    from scipy.ndimage import gaussian_filter

    if not _sampled(operator, snapshot.camera):
        raise SettingError("method", "'smoothed'", "a shutter that opens every pixel once, one band")
    gain = (operator.shutter * operator.aperture * operator.scale)[:, None].numpy()[:, 0]
    width = (reach / time, reach, reach)
    weights = gaussian_filter(gain**2, width, truncate=6.0)
    sums = gaussian_filter(gain * snapshot.values[0].numpy(), width, truncate=6.0)
    return torch.from_numpy(sums / np.maximum(weights, np.finfo(np.float32).tiny))[:, None]


def frame_dataset(movie: Movie, snapshot: Snapshot[SpectralCamera]) -> xr.Dataset:
    """Frames with their coordinates: ``frames`` (frame, wavelength, y, x) and the first slot of each."""
    import xarray as xr

    waves = np.array(snapshot.camera.wavelengths)
    attrs = {"units": "relative irradiance", "long_name": "scene during the slots of a frame"}
    return xr.Dataset(
        {"frames": (("frame", "wavelength", "y", "x"), movie.frames.numpy(), attrs)},
        coords={
            "wavelength": ("wavelength", waves, {"units": "m"}),
            "first_slot": ("frame", np.arange(len(movie.frames)) * movie.slots),
        },
        attrs={key: value for key, value in snapshot.notes.items()} | {"slots_per_frame": movie.slots},
    )
