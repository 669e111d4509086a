"""What a frame has to be before it is kept: of the right size, lit, not saturated, and an exposure of its own."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tmca.cameras import Camera
from tmca.errors import DataError
from tmca.lab.devices.captures import DARK, Step, read_tif
from tmca.lab.frames import Distinct

_SATURATED, _DARK = 0.5, 3.0
"""Share of saturated pixels, and mean above the dark frame in its standard deviations, that are refused."""
_LOW = 1 / 8
"""Of saturation, up to which numbers may be those of fewer bits."""


class LowNumbers(UserWarning):
    """No number comes near saturation."""


class FrameChecks:
    """Checks of the frames of a capture.

    Args:
        folder: of the capture.
        camera: as it is known, if it is.
        saturation: digital number.
        noisy: whether a sensor took them, whose noise never repeats; a simulated bench may have none.
    """

    def __init__(self, folder: Path, camera: Camera | None, saturation: float, noisy: bool) -> None:
        self.folder, self.camera, self.saturation, self.noisy = folder, camera, saturation, noisy
        self.distinct, self.largest = Distinct(), 0

    def known(self, names: Iterable[str]) -> None:
        """Frames that are kept already.

        Raises:
            DataError: two of them are the same.
        """
        for name in names if self.noisy else ():
            self._seen(read_tif(self.folder / f"{name}.tif"), name)

    def check(self, frame: NDArray[np.integer], step: Step) -> None:
        """Raises DataError for a frame, (H, W) or (C, H, W), that is not to be kept."""
        where = self.folder / step.name
        _check_size(frame, step, self.folder, self.camera)
        check_saturated(frame, self.saturation, where)
        if step.of != DARK:
            _check_light(frame, where, self.folder)
        if not self.noisy:
            return
        if step.of != DARK and frame.min() == frame.max():
            said = f"the number {frame.min()} in every pixel"
            raise DataError(where, said, "an exposure, which has noise", "see to the driver: it gave no frame")
        self._seen(frame, step.name)

    def _seen(self, frame: NDArray[np.integer], name: str) -> None:
        self.distinct.add(name, frame.astype(np.uint16), self.saturation, self.folder)
        self.largest = max(self.largest, int(frame.max()))

    def remark(self) -> None:
        """Warn where numbers are so low that they may have fewer bits than saturation says."""
        if self.noisy and 0 < self.largest <= self.saturation * _LOW:
            bits = 2 ** int(self.largest).bit_length() - 1
            said = f"no number above {self.largest} where {self.saturation:g} is saturation"
            remedy = f"if the sensor has fewer bits, its driver has to say so (--set saturation={bits} of folder)"
            warnings.warn(f"{self.folder}: {said}; {remedy}, else expose longer", LowNumbers, stacklevel=2)


def _check_size(frame: NDArray[np.integer], step: Step, folder: Path, camera: Camera | None) -> None:
    wanted = tuple(frame.shape) if step.name == DARK else tuple(read_tif(folder / f"{DARK}.tif").shape)
    if camera is not None:
        shape = camera.snapshot_shape
        wanted = shape if shape[0] > 1 or tuple(frame.shape) == shape else shape[1:]
    if tuple(frame.shape) == wanted:
        return
    found, known = ("×".join(map(str, size)) for size in (frame.shape, wanted))
    remedy = "set the sensor's region to that"
    if frame.ndim != len(wanted):
        remedy = (
            f"one of {'raw grey numbers' if len(wanted) == 2 else f'{wanted[0]} channels'}, not of {frame.ndim} axes"
        )
    raise DataError(folder / step.name, f"a frame of {found}", f"{known} pixels", remedy)


def _check_light(frame: NDArray[np.integer], where: Path, folder: Path) -> None:
    dark = read_tif(folder / f"{DARK}.tif").astype(np.float64)
    above = float(frame.mean() - dark.mean())
    if above <= _DARK * float(dark.std()) / np.sqrt(frame.size):
        found = f"a frame {above:.3g} digital numbers above the dark one"
        raise DataError(where, found, "light", "check lamp, shutter and lens cap")


def check_saturated(frame: NDArray[np.integer], saturation: float, where: Path) -> None:
    """Raises DataError where more than half of a frame's pixels are saturated."""
    share = float((frame >= saturation).mean())
    if share > _SATURATED:
        remedy = "open the aperture of the lens less, or expose shorter"
        raise DataError(where, f"{share:.0%} saturated pixels", f"{_SATURATED:.0%} at most", remedy)
