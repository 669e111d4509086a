"""Capture and decode side by side: the newest exposure is decoded, those that came meanwhile are counted as dropped."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from threading import Condition, Event, Thread
from typing import Any

import torch
from torch import Tensor

from tmca.decoders import Estimate, Prepared
from tmca.lab.live.exposures import Exposure, Exposures

_RECENT = 20
"""Exposures over which rates are taken."""
_PATIENCE = 2.0
"""Seconds for which the end of a capture is waited for."""
_POLL = 0.1
"""Seconds after which a capture that waits for its decoder looks whether another loop ended it."""


@dataclass(frozen=True)
class Shown:
    """An exposure and what is known of it.

    Args:
        number: of the exposure; those whose number is missing were dropped.
        values: (1, C, H, W') snapshot.
        estimate: of the scene.
        saturated: share of saturated pixels.
        residual: ``‖A x̂ - y‖ / ‖y‖``.
        dropped: exposures before this one.
        seconds: ``capture``, ``wait`` from then to the decoder, ``decode``, and ``residual``, to compute it.
        rate: estimates a second, of late.
    """

    number: int
    values: Tensor
    estimate: Estimate
    saturated: float
    residual: float
    dropped: int
    seconds: dict[str, float]
    rate: float


class _Capture:
    """A bench that runs beside, for one loop: its newest exposure, and how many came before that nobody took.

    A loop that took exposures of the bench before ends.
    """

    def __init__(self, exposures: Exposures) -> None:
        self.exposures, self.dropped = exposures, 0
        self._changed, self._stopped = Condition(), Event()
        self._newest: Exposure | None = None
        self._error: BaseException | None = None
        self._ended = False
        self._thread = Thread(target=self._run, name="tmca capture", daemon=True)

    def __enter__(self) -> _Capture:
        self.exposures.stopped.set()
        self.exposures.stopped = self._stopped
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stopped.set()
        with self._changed:
            self._changed.notify_all()
        self._thread.join(_PATIENCE)

    def newest(self) -> tuple[Exposure, int] | None:
        """The newest exposure and how many were dropped before; None at the end. Raises what ended the capture."""
        with self._changed:
            self._changed.wait_for(lambda: self._newest is not None or self._ended)
            taken, self._newest, dropped = self._newest, None, self.dropped
            self._changed.notify_all()
        if taken is None and self._error is not None:
            raise self._error
        return None if taken is None else (taken, dropped)

    def _run(self) -> None:
        try:
            with self.exposures.taking:
                while not self._stopped.is_set() and (taken := self.exposures.take()) is not None:
                    self._put(taken)
        except BaseException as error:  # whatever it is, who decodes has to hear of it
            self._error = error
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def _put(self, taken: Exposure) -> None:
        with self._changed:
            while self.exposures.recorded and self._newest is not None and not self._stopped.is_set():
                self._changed.wait(_POLL)
            self.dropped += self._newest is not None
            self._newest = taken
            self._changed.notify_all()


class Live:
    """``for shown in Live(exposures, prepared)``: estimates as fast as the slower of bench and decoder.

    Args:
        exposures: of a bench, entered.
        prepared: decoder, for the camera of the exposures; it decodes where the camera's codes are.

    A failing bench ends the loop with its error, after what was decoded was given out; so does an interrupt. Recorded
    frames are never dropped. A second loop begins anew, with the exposure that comes next.
    """

    def __init__(self, exposures: Exposures, prepared: Prepared) -> None:
        self.exposures, self.prepared = exposures, prepared
        self._capture = _Capture(exposures)
        self._ready: deque[float] = deque(maxlen=_RECENT)

    @property
    def dropped(self) -> int:
        """Exposures of the newest loop that came while another was decoded."""
        return self._capture.dropped

    def __iter__(self) -> Iterator[Shown]:
        self._capture = _Capture(self.exposures)
        self._ready.clear()
        with self._capture as capture:
            while (newest := capture.newest()) is not None:
                yield self._decoded(*newest)

    def _decoded(self, taken: Exposure, dropped: int) -> Shown:
        begun, camera = time.monotonic(), self.prepared.camera
        device = next((tensor.device for tensor in camera.buffers()), torch.device("cpu"))
        values = taken.values.to(device)
        estimate = self.prepared(values)
        ready = time.monotonic()
        self._ready.append(ready)
        span = self._ready[-1] - self._ready[0]
        rate = (len(self._ready) - 1) / span if span > 0 else 0.0
        residual = residual_of(camera, estimate, values)
        seconds = {"capture": taken.seconds, "wait": begun - taken.at, "decode": ready - begun}
        seconds["residual"] = time.monotonic() - ready
        return Shown(taken.number, taken.values, estimate, taken.saturated, residual, dropped, seconds, rate)


@torch.no_grad()
def residual_of(camera: Any, estimate: Estimate, values: Tensor) -> float:
    """``‖A x̂ - y‖ / ‖y‖`` of a snapshot (B, C, H, W'), 0 of a black one; of a scene in frames, that of their mean."""
    scene = estimate.values.mean(1) if estimate.values.ndim > 1 + len(camera.scene_shape) else estimate.values
    predicted = camera.A(scene) if estimate.depth is None else camera.A(scene, estimate.depth)
    light = float(values.norm())
    return float((predicted - values).norm()) / light if light else 0.0
