"""Captures of real prototypes as snapshots: their levels and noise, and their saturated pixels."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tmca.cameras import Snapshot, SpectralCamera
from tmca.codes import Codes
from tmca.data import checksum_of, read_array
from tmca.errors import DataError, SettingError, TmcaError, check_choice, check_range
from tmca.lab.frames import check_size
from tmca.lab.notes import SATURATED
from tmca.lab.prototype import CodedPair, PixelShutter, SingleDisperser
from tmca.lab.quality import warn_of_saturation
from tmca.lab.registering import overlapping, registered
from tmca.sensor import Sensor

Array = NDArray[np.float64]
_DARKEST = 0.2


def dark_noise(capture: NDArray[np.floating]) -> float:
    """Standard deviation of the noise where a capture (H, W) is darkest, in the capture's numbers.

    Differences of neighbours along x over the darkest fifth of all pixels, by their median absolute value (1.4826 of it
    is the standard deviation of a normal distribution); slow light cancels, the noise does so by √2.
    """
    from scipy.ndimage import uniform_filter

    values = np.asarray(capture, dtype=np.float64)
    level = uniform_filter(values, 9)
    dark = (level <= np.quantile(level, _DARKEST))[:, 1:]
    steps = np.abs(np.diff(values, axis=1))[dark]
    return float(1.4826 * np.median(steps) / np.sqrt(2))


def _noise_of(values: Array, given: float | None, where: Path) -> float:
    """The noise that is given, or that of the capture (H, W'), in its numbers."""
    if given is not None:
        check_range("--noise", given, 0)
    if np.ptp(values) == 0:
        raise DataError(where, f"the value {values.flat[0]:g} in every pixel", "a picture")
    noise = dark_noise(values) if given is None else given
    if given is None and not noise:
        raise DataError(where, "no noise in the darkest fifth of its pixels", "some", "tell it with --noise")
    return noise


PIXELS, WITHHELD = "saturated_pixels", "saturated_withheld"
"""Notes of an imported capture: how many pixels are saturated, and whether they were withheld (0 or 1)."""
_MOST = 0.5
"""Share of the pixels that may be saturated."""


def without_pixels(snapshot: Snapshot[SpectralCamera], gone: Tensor) -> Snapshot[SpectralCamera]:
    """A snapshot in which some pixels say nothing: their shutter is closed and their value 0.

    Args:
        snapshot: of any spectral camera.
        gone: (H, W') True where a pixel of the sensor is withheld.
    """
    aperture, shutter = snapshot.camera.codes()
    shown = (~gone).to(shutter)
    blind = snapshot.camera.replace(codes=Codes(aperture, shutter * shown))
    return Snapshot(snapshot.values * shown, blind, snapshot.notes)


def _marked(
    taken: Snapshot[SpectralCamera], values: Array, saturation: float | None, withhold: bool
) -> Snapshot[SpectralCamera]:
    """A snapshot whose notes tell of the saturated pixels of its capture (H, W'), the value from which on they say
    nothing being known or None; without those pixels, if they are to be withheld."""
    source, gone = taken.notes["source"], values >= (values.max() if saturation is None else saturation)
    share = float(gone.mean())
    if withhold and saturation is not None and gone.all():
        raise DataError(source, f"nothing below the saturation of {saturation:g}", "some pixels")
    if share > _MOST:
        raise DataError(source, f"{share:.0%} of the pixels saturated", f"{_MOST:.0%} at most", "expose for less time")
    if saturation is None:
        if withhold:
            remedy = "add it to the description"
            raise SettingError("--withhold-saturated", "no saturation in the prototype", "its value", remedy)
        return taken
    taken.notes |= {PIXELS: int(gone.sum()), SATURATED: share, WITHHELD: int(withhold)}
    if withhold:
        return without_pixels(taken, torch.from_numpy(gone))
    warn_of_saturation(source, share, "withhold them (--withhold-saturated)", stacklevel=4)
    return taken


def import_capture(
    capture: str | Path,
    prototype: SingleDisperser | PixelShutter,
    mask: str | Path | None = None,
    *,
    name: str | None = None,
    noise: float | None = None,
    withhold_saturated: bool = False,
) -> Snapshot[SpectralCamera]:
    """A real capture with the camera that took it; warns of saturated pixels that are kept.

    Args:
        capture: file of the capture.
        prototype: what is known of the device.
        mask: file of the mask of a single disperser.
        name: which capture of a pixel shutter's file.
        noise: standard deviation in the capture's numbers; estimated from its darkest part without it.
        withhold_saturated: close the shutter of pixels at or above the prototype's saturation, and set them to 0.

    Returns:
        A snapshot whose values are in the package's units: 1 is one band of a white scene through open codes.

    Raises:
        DataError: a file that does not hold what the prototype says, or of another size; a saturated capture.
        SettingError: a mask or a name that is missing, or given where none is used; an impossible noise; pixels to be
            withheld where no saturation is known.
    """
    if isinstance(prototype, SingleDisperser):
        if mask is None or name is not None:
            found, wanted = ("none", "the file of the mask") if mask is None else (repr(name), "none")
            raise SettingError("--mask" if mask is None else "--name", found, wanted)
        taken, values = _dispersed(Path(capture), prototype, Path(mask), noise)
    else:
        if mask is not None:
            raise SettingError("--mask", str(mask), "none: the shutter lies in the capture's file", "leave it out")
        taken, values = _shuttered(Path(capture), prototype, name, noise)
    return _marked(taken, values, prototype.saturation, withhold_saturated)


def _dispersed(
    capture: Path, prototype: SingleDisperser, mask: Path, noise: float | None
) -> tuple[Snapshot[SpectralCamera], Array]:
    """The snapshot, and the capture in its own numbers."""
    values = read_plane(capture, prototype.capture_key)
    image, response = _transmittances(mask, prototype.mask_key), prototype.response_of_bands()
    code = registered(image, prototype.registration)
    spread = _noise_of(values, noise, capture)
    unit = code.mean() * response.sum() / (prototype.white - prototype.black)
    sensor = Sensor(read_noise=spread * unit, full_well=prototype.full_well, saturates=False)
    try:
        camera = SpectralCamera(
            bands=[nm * 1e-9 for nm in prototype.wavelengths_nm], size=code.shape, slots=1,
            aperture=torch.from_numpy(code.astype(np.float32))[None], shutter="open",
            dispersion=prototype.pixels_per_band, response=torch.from_numpy(response.astype(np.float32)), sensor=sensor,
        )  # fmt: skip
    except TmcaError as error:
        raise DataError(mask, f"a mask that makes no camera ({error})", "one of this prototype") from error
    remedy = "give the mask of this capture: its width and its bands' displacement are the capture's"
    check_size(capture, "a capture", values.shape, camera.snapshot_shape[1:], remedy)
    about = _notes(prototype, capture, spread, unit) | {
        "mask": str(mask), "mask_sha256": checksum_of(mask), "registration": prototype.registration.model_dump_json(),
        "response": str(prototype.response), "scene": prototype.scenes.get(capture.stem, capture.stem),
    }  # fmt: skip
    return Snapshot(_tensor((values - prototype.black) * unit), camera, about), values


def _transmittances(mask: Path, key: str | None) -> Array:
    """(h, w) of a mask's file, between 0 and 1."""
    image = read_plane(mask, key)
    if image.min() < 0 or image.max() > 1:
        raise DataError(mask, f"a mask of {image.min():g} to {image.max():g}", "transmittances between 0 and 1")
    return image


def _shuttered(
    capture: Path, prototype: PixelShutter, name: str | None, noise: float | None
) -> tuple[Snapshot[SpectralCamera], Array]:
    """The snapshot, and the part of the capture that its shutter covers in its own numbers."""
    check_choice("--name", name, prototype.captures)
    name = str(name)
    pair = prototype.captures[name]
    values, patterns = _overlap(capture, pair)
    shutter = torch.from_numpy(np.moveaxis(patterns, -1, 0).astype(np.float32).copy())
    spread = _noise_of(values, noise, capture)
    unit = 1 / (prototype.white - prototype.black)
    camera = SpectralCamera(
        bands=[prototype.wavelength_nm * 1e-9], size=values.shape, slots=len(shutter), exposure="per-slot",
        aperture=torch.ones(len(shutter), *values.shape), shutter=shutter, dispersion=0.0,
        sensor=Sensor(read_noise=spread * unit),
    )  # fmt: skip
    about = _notes(prototype, capture, spread, unit) | {
        "capture": name, "scene": prototype.scenes.get(name, name),
        "shutter_shift": list(pair.shutter_shift), "first_slot": pair.first_slot,
    }  # fmt: skip
    return Snapshot(_tensor((values - prototype.black) * unit), camera, about), values


def _overlap(capture: Path, pair: CodedPair) -> tuple[Array, NDArray[Any]]:
    """The pixels (H, W) of a capture that its shutter covers, and the shutter's patterns (H, W, K) there in order."""
    values, patterns = read_plane(capture, pair.capture_key), read_array(capture, pair.shutter_key)
    if patterns.ndim != 3 or patterns.shape[:2] != values.shape:
        found = f"{pair.shutter_key} of shape {patterns.shape}"
        raise DataError(capture, found, f"({values.shape[0]}, {values.shape[1]}, slots)")
    far = any(abs(s) >= n for s, n in zip(pair.shutter_shift, values.shape, strict=True))
    if far or pair.first_slot >= patterns.shape[-1]:
        found = f"first slot {pair.first_slot}, shift {pair.shutter_shift}"
        raise DataError(capture, found, f"a place within its shutter of shape {patterns.shape}", "mend the description")
    return overlapping(values, np.roll(patterns, -pair.first_slot, axis=-1), pair.shutter_shift)


def read_plane(file: Path, key: str | None) -> Array:
    """A picture (rows, columns) of real numbers.

    Raises:
        DataError: something else.
    """
    plane = np.squeeze(read_array(file, key))
    if plane.dtype.kind not in "uifb":
        raise DataError(file, f"{key or 'an array'} of type {plane.dtype}", "real numbers", "save its values alone")
    values = plane.astype(np.float64)
    if values.ndim != 2 or not np.isfinite(values).all():
        raise DataError(file, f"{key or 'an array'} of shape {values.shape}", "a finite picture (rows, columns)")
    return values


def _notes(prototype: SingleDisperser | PixelShutter, capture: Path, spread: float, unit: float) -> dict[str, Any]:
    """What the file keeps of where it comes from and of how its numbers were made."""
    return {
        "real_capture": 1, "prototype": prototype.kind, "device": prototype.device, "source": str(capture),
        "source_sha256": checksum_of(capture), "black_level": prototype.black, "white_level": prototype.white,
        "gain": unit, "noise_in_capture": spread, "turned": prototype.turned,
    }  # fmt: skip


def _tensor(values: Array) -> torch.Tensor:
    return torch.from_numpy(values.astype(np.float32))[None, None]
