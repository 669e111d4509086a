"""Snapshots of a bench that runs: dark frames once, then one exposure after the other."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from threading import TIMEOUT_MAX, Event, Lock
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tmca.cameras import Camera
from tmca.errors import check_range
from tmca.lab.acquisition.captures import DARK, frames_of
from tmca.lab.acquisition.drivers import Calls, Device, number_of
from tmca.lab.acquisition.frame_folder import FrameFolder
from tmca.lab.acquisition.session import (
    calls_of,
    check_camera,
    frame_of,
    notes_of_frames,
    opened_of,
    read_noise,
    units_of,
    with_noise,
)
from tmca.lab.calibration.apply import check_fits, correction, warn_of_missing
from tmca.lab.calibration.file import Calibration
from tmca.lab.display.export import Export
from tmca.lab.display.manifest import check_export, exposed_whole
from tmca.lab.frames import check_size


@dataclass(frozen=True)
class Exposure:
    """One exposure.

    Args:
        number: of the exposure, from 0.
        values: (1, C, H, W') snapshot units.
        saturated: share of the pixels that saturate.
        seconds: that it took to take.
        at: when it was there, ``time.monotonic``.
    """

    number: int
    values: Tensor
    saturated: float
    seconds: float
    at: float


class Exposures:
    """Exposures of an export on a bench, as often as they are asked for; a context, in which the bench answers.

    A frame is a whole exposure, or one a slot of a sensor whose shutter is not coded. The mean of the dark frames is
    taken from each. Where the camera knows no noise, it is measured in them.

    Args:
        export: folder of `tmca export`.
        device: the bench.
        camera: with the codes of the export.
        calibration: of the camera: exposures are then those of the calibrated one, on its planes, as `tmca reconstruct`
            corrects a capture of the same frames.
        timeout: seconds for every answer of a driver; see `tmca.lab.acquisition.capture`.
        rate: most exposures a second; None for as many as there are.

    Attributes:
        stopped: set, no exposure is taken any more, nor is the time of the next one waited for; every loop has its own.
        taking: held by the loop that takes.

    Raises:
        DataError: an export that was changed, codes of another camera, or a calibration of another one.
        SettingError: a rate that is none.
    """

    def __init__(
        self,
        export: str | Path,
        device: Device,
        camera: Camera,
        *,
        calibration: Calibration | None = None,
        timeout: float | None = None,
        rate: float | None = None,
    ) -> None:
        if rate is not None:
            check_range("rate", rate, above=0)
        self.manifest, self.export, self.device = check_export(export), Path(export), device
        check_camera(export, camera)
        self.camera, self.calibration, self.rate, self.number = camera, calibration, rate, 0
        self._size = tuple(camera.snapshot_shape)
        self._correct: Callable[[Tensor], Tensor] = lambda values: values
        if calibration is not None:
            check_fits(camera, calibration, self.manifest)
        self.whole = exposed_whole(self.manifest)
        self.steps = [frame for frame in frames_of(self.manifest) if frame.of != DARK]
        self.calls: Calls = calls_of(device, self.manifest, timeout)
        self._last = float("-inf")
        self.stopped, self.taking = Event(), Lock()

    @property
    def recorded(self) -> bool:
        """Whether the frames are files that were there before: none of them is to be dropped."""
        return isinstance(self.device, FrameFolder)

    def __enter__(self) -> Exposures:
        """Load the export and take the dark frames.

        Raises:
            DeviceError: the bench does not answer.
        """
        with ExitStack() as entered:
            entered.enter_context(self.calls)
            self._begin()
            entered.pop_all()
        return self

    def _begin(self) -> None:
        self.saturation = self.calls.of(lambda: number_of(self.device, "saturation"))
        self.gain = self.calls.of(lambda: units_of(self.device, self.camera, self.manifest, self.saturation))
        self.calls.of(lambda: self.device.load(Export(self.export, self.manifest)))
        names = [frame.name for frame in frames_of(self.manifest) if frame.of == DARK]
        if isinstance(self.device, FrameFolder):
            names = [name for name in self.device.files if name.startswith(DARK)]
        darks = [self._frame(name, None) for name in names]
        self._dark = torch.stack(darks).mean(0)
        self._opened = opened_of(self.export, self.camera)
        if not self.camera.noise.read and not self.camera.noise.shot:
            read = self.gain * read_noise(torch.stack(darks), torch.ones(len(self.steps)), self._opened, self.camera)
            self.camera = with_noise(self.camera, read, 1.0)
        if self.calibration is not None:
            notes = notes_of_frames(self.manifest, self.camera, self.gain)
            warn_of_missing(self.calibration, self.camera, notes)
            self.camera, self._correct = correction(self.camera, self.calibration, notes)

    def __exit__(self, *error: object) -> None:
        self.stopped.set()
        self.calls.__exit__(*error)

    def __iter__(self) -> Iterator[Tensor]:
        """Values (1, C, H, W') of one exposure after the other, as a prepared decoder's ``stream`` takes them; none is
        dropped. See ``Live`` for a bench that does not wait."""
        while (taken := self.take()) is not None:
            yield taken.values

    def take(self) -> Exposure | None:
        """The next exposure; None where it is stopped, and where recorded frames are at their end.

        Raises:
            DeviceError: no answer, or no frame.
            DataError: a frame of another size.
        """
        stopped = self.stopped
        self._wait(stopped)
        begun, number = time.monotonic(), self.number
        names = [step.name + (f"_r{number}" if number else "") for step in self.steps]
        ended = isinstance(self.device, FrameFolder) and any(name not in self.device.files for name in names)
        if ended or stopped.is_set():
            return None
        frames = torch.stack([self._frame(name, step.slot) for name, step in zip(names, self.steps, strict=True)])
        saturated = float((frames >= self.saturation).double().mean())
        light = (frames - self._dark) * self.gain * self._opened.to(frames)[:, None]
        values = light.sum(0) if self.camera.exposure == "per-slot" else light.mean(0)
        self.number, now = number + 1, time.monotonic()
        return Exposure(number, self._correct(values[None].float()), saturated, now - begun, now)

    def _wait(self, stopped: Event) -> None:
        """Until the next exposure may begin."""
        if self.rate is not None:
            due = self._last + 1 / self.rate
            stopped.wait(min(max(0.0, due - time.monotonic()), TIMEOUT_MAX))
        self._last = time.monotonic()

    def _frame(self, name: str, slot: int | None) -> Tensor:
        """(C, H, W') digital numbers."""
        values: NDArray[Any] = frame_of(self.calls, slot, self.whole and not name.startswith(DARK), name)
        values = values[None] if values.ndim == 2 else values
        check_size(Path(name), "a frame", values.shape, self._size)
        return torch.from_numpy(values.astype(np.float64))
