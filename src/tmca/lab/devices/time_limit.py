"""Drivers that hang: their calls run in a thread of their own, and are waited for only so long."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from queue import Empty, SimpleQueue
from threading import TIMEOUT_MAX, Thread
from typing import Any, TypeVar

from tmca.errors import DeviceError, SettingError
from tmca.lab.devices.protocol import Device, answering

_LEAST, _EXPOSURES = 30.0, 3.0
"""Seconds, and exposures, that a call is waited for; the larger of the two."""
T = TypeVar("T")


def time_limit(manifest: dict[str, Any], asked: float | None) -> float | None:
    """Seconds that a call of a driver is waited for; None for as long as it takes.

    Args:
        manifest: of the export that is captured.
        asked: seconds; 0 for no limit; without, 30 s or three exposures, whichever is longer.

    Raises:
        SettingError: a time below 0, or none at all.
    """
    if asked is None:
        return max(_LEAST, _EXPOSURES * float(manifest["exposure_s"]))
    if not (isfinite(asked) and asked >= 0):
        raise SettingError("--timeout", f"{asked:g} s", "seconds above 0, or 0 for as long as it takes")
    return asked or None


class Calls:
    """Calls of a driver, each answered within a limit; a context, in which they share one thread.

    One thread, for there are drivers that answer none but the one that loaded them; a daemon, for nothing but the end
    of the process ends a driver that hangs.

    Args:
        device: the driver.
        limit: seconds; None calls where it stands, and waits as long as it takes.
    """

    def __init__(self, device: Device, limit: float | None) -> None:
        self.device, self.limit = device, limit
        self._asked: SimpleQueue[tuple[Callable[[], Any], SimpleQueue[Any]] | None] = SimpleQueue()

    def __enter__(self) -> Calls:
        if self.limit is not None:
            Thread(target=self._answer, name="tmca device", daemon=True).start()
        return self

    def __exit__(self, *error: object) -> None:
        self._asked.put(None)

    def of(self, call: Callable[[], T]) -> T:
        """What a call returns.

        Raises:
            DeviceError: whatever fails in it, or no answer within the limit.
        """
        with answering(self.device):
            return call() if self.limit is None else self._waited(call, self.limit)

    def _waited(self, call: Callable[[], T], limit: float) -> T:
        answer: SimpleQueue[Any] = SimpleQueue()
        self._asked.put((call, answer))
        try:
            found, error = answer.get(timeout=min(limit, TIMEOUT_MAX))
        except Empty:
            remedy = "see to the device, and run the same command again, or with a longer --timeout"
            said = f"no answer in {limit:g} s"
            raise DeviceError(f"device {type(self.device).__name__}", said, "one", remedy) from None
        if error is not None:
            raise error
        result: T = found
        return result

    def _answer(self) -> None:
        while (asked := self._asked.get()) is not None:
            call, answer = asked
            try:
                answer.put((call(), None))
            except BaseException as error:  # KeyboardInterrupt and SystemExit too: whoever waits has to hear of it
                answer.put((None, error))
