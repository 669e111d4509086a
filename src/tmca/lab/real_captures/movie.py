"""A scene that changed during the exposure of a pixel shutter: frames from one capture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from tmca.cameras import Snapshot, SpectralCamera
from tmca.decoders.iterative.space_time import space_time_dct
from tmca.decoders.patch_based.kriging import Covariance
from tmca.errors import SettingError
from tmca.lab.real_captures.kriged import kriged_frames
from tmca.operators import SlotwiseDisperser

if TYPE_CHECKING:
    import xarray as xr

MOVIE_NUMBERS = {"space-time-dct": ("threshold", "iterations"), "kriging": ("lifetime", "changing")}
"""Numbers of `decode_movie` that each method takes."""
MOVIE_METHODS = tuple(MOVIE_NUMBERS)


@dataclass(frozen=True)
class Movie:
    """Frames of one capture.

    Args:
        frames: (F, L, H, W) relative irradiance.
        slots: slots of the shutter that a frame stands for.
        method: of `decode_movie`.
        std: (F, L, H, W) standard deviation of the frames, where the decoder knows it.
        covariance: of the scene, of the decoder that estimates it.
    """

    frames: Tensor
    slots: int
    method: str
    std: Tensor | None = None
    covariance: Covariance | None = None


class FrameOperator(SlotwiseDisperser):
    """The slot-wise operator of frames, whose ``A Aᵀ`` is diagonal for displacements by whole pixels."""

    def gram_solve(self, snapshot: Tensor, shift: float | Tensor, **iteration: object) -> Tensor:
        """``(A Aᵀ + shift·I)⁻¹ snapshot``; with shift 0, pixels without light give zero."""
        diagonal = self._energy() + shift
        return torch.where(diagonal > 0, snapshot / diagonal.clamp_min(torch.finfo(snapshot.dtype).tiny), 0)

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
        SettingError: another camera, frames that do not divide the slots, an aperture that changes, displacements by
            parts of pixels.
    """
    if not isinstance(camera, SpectralCamera):
        found = getattr(camera, "kind", type(camera).__name__)
        raise SettingError("snapshot", f"one of a {found} camera", "one of a spectral camera")
    aperture, shutter = camera.codes()
    slots = len(aperture)
    if frames < 1 or slots % frames:
        raise SettingError("--frames", str(frames), f"a divisor of the {slots} slots")
    if bool((aperture != aperture[:1]).any()):
        raise SettingError("snapshot", "an aperture that changes from slot to slot", "the same in all slots")
    if any(float(d) != round(d) for d in camera.dispersion.displacement):
        raise SettingError("dispersion", "parts of pixels", "displacements by whole pixels")
    merged = shutter.unflatten(0, (frames, slots // frames)).sum(1)
    weight = 1.0 if camera.exposure == "per-slot" else 1 / slots
    still = aperture[:1].expand(frames, -1, -1)
    return FrameOperator(still, merged * weight, camera.dispersion, camera.response, "per-slot", moving=True)


def decode_movie(
    snapshot: Snapshot[SpectralCamera],
    frames: int = 16,
    method: str = "space-time-dct",
    *,
    lifetime: float | None = None,
    changing: float | None = None,
    threshold: float | None = None,
    iterations: int = 40,
    progress: Callable[[float], None] | None = None,
) -> Movie:
    """Frames of a scene behind a pixel shutter.

    Args:
        snapshot: of a spectral camera whose aperture stays as it is.
        frames: how many.
        method: ``"space-time-dct"``, blocks of space and time that are sparse in their cosine transform, for any
            shutter, or ``"kriging"``, the best linear estimate from the samples around every place (for shutters that
            open a pixel within one frame, one band, nothing displaced).
        lifetime: slots over which the scene changes; without it as `foretelling_covariance` finds. Kriging.
        changing: share of the scene's variance that changes during the exposure; likewise.
        threshold: of coefficients at the end, relative irradiance; without it half the noise of a sample, and
            0.5 % of the brightest at least.
        iterations: over which the threshold falls to it.
        progress: told the share that is done of the iterations.

    Raises:
        SettingError: an unknown method, or a camera or a number that it cannot take.
    """
    operator = frame_operator(snapshot.camera, frames)
    slots = snapshot.camera.slots // frames
    if method == "kriging":
        mean, std, covariance = kriged_frames(snapshot, operator, lifetime, changing)
        return Movie(mean, slots, method, std, covariance)
    if method != "space-time-dct":
        raise SettingError("method", repr(method), f"one of {', '.join(MOVIE_METHODS)}")
    last = _last_threshold(snapshot, operator) if threshold is None else threshold
    found = space_time_dct(operator, snapshot.values, last=last, iterations=iterations, progress=progress)
    return Movie(found[0].clamp_min(0), slots, method)


def _last_threshold(snapshot: Snapshot[SpectralCamera], operator: FrameOperator) -> float:
    """Half the noise of a sample in scene units, and no less than 0.5 % of the brightest."""
    gain = float(operator._energy().max().sqrt())
    noise = float(snapshot.camera.noise.variance(snapshot.values).mean().sqrt())
    return max(0.5 * noise, 0.005 * float(snapshot.values.max()), 1e-9) / max(gain, 1e-12)


def frame_dataset(movie: Movie, snapshot: Snapshot[SpectralCamera]) -> xr.Dataset:
    """Frames with their coordinates: ``frames`` (frame, wavelength, y, x), ``frames_std`` where the decoder knows it,
    and the first slot of each."""
    import xarray as xr

    waves = np.array(snapshot.camera.wavelengths)
    attrs = {"units": "relative irradiance", "long_name": "scene during the slots of a frame"}
    dims = ("frame", "wavelength", "y", "x")
    values = {"frames": (dims, movie.frames.numpy(), attrs)}
    if movie.std is not None:
        values["frames_std"] = (dims, movie.std.numpy(), attrs | {"long_name": "standard deviation of the frames"})
    how = {} if movie.covariance is None else asdict(movie.covariance)
    return xr.Dataset(
        values,
        coords={
            "wavelength": ("wavelength", waves, {"units": "m"}),
            "first_slot": ("frame", np.arange(len(movie.frames)) * movie.slots),
        },
        attrs=dict(snapshot.notes)
        | {"decoder": movie.method, "slots_per_frame": movie.slots}
        | {f"scene_{key}": how[key] for key in how},
    )
