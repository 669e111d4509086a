"""A bench, as this package sees it: it loads an export, shows a slot, captures a frame; drivers are entry points."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import EntryPoint, entry_points
from math import inf, isfinite
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import TIMEOUT_MAX, Thread
from typing import Any, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from tmca.errors import DeviceError, SettingError, TmcaError, one_line
from tmca.lab.acquisition.driver_settings import read_settings, said_settings
from tmca.lab.cameras.base import Light
from tmca.lab.display.export import Export
from tmca.plugins import class_from_file, file_of, line_in, names_a_file


@runtime_checkable
class Lamp(Protocol):
    """A `Device` that sets the light itself; without, a person does, one light at a time."""

    def illuminate(self, light: Light) -> None:
        """Set the light, and the exposure time of the frames to come.

        Raises:
            DeviceError: it cannot.
        """


GROUP = "tmca.devices"
OWN = {
    "simulated": EntryPoint("simulated", "tmca.lab.acquisition.simulated:SimulatedBench", GROUP),
    "folder": EntryPoint("folder", "tmca.lab.acquisition.frame_folder:FrameFolder", GROUP),
}
"""The package's own drivers."""


@runtime_checkable
class Device(Protocol):
    """A bench: what shows codes, and the camera behind it.

    A package plugs one in by the entry point ``NAME = "module:factory"`` of the group ``tmca.devices``; without one it
    is named ``FILE.py:Class``. The factory takes the settings of ``tmca capture`` as keyword arguments: values of the
    types that it annotates, texts where it annotates none.

    A bench that knows its scale has ``snapshot_units_per_dn``, the snapshot units of a digital number above the dark;
    without, saturation is a white scene in one frame.
    """

    saturation: float
    """Digital number from which on a pixel is saturated."""

    def load(self, export: Export) -> None:
        """Take the patterns of an export into the devices' memory.

        Raises:
            DeviceError: they do not fit.
        """

    def show(self, slot: int | None) -> None:
        """Show the patterns of a slot until something else is shown; None shuts all, for dark frames.

        Raises:
            DeviceError: no answer.
        """

    def capture(self, whole: bool = False) -> NDArray[np.integer]:
        """(H, W) digital numbers of a frame, (C, H, W) of a sensor with channels: of what is shown, or of a whole
        exposure in which the shutter is coded.

        Raises:
            DeviceError: no answer.
        """


@runtime_checkable
class Named(Protocol):
    """A `Device` that is told which frame comes next."""

    def name_frame(self, name: str) -> None:
        """The frame that is captured next, by the name of its file."""


@runtime_checkable
class Recorded(Protocol):
    """A `Device` whose frames are files that were there before."""

    def files_of_frames(self, names: Sequence[str]) -> Mapping[str, Path]:
        """Name of a frame → its file, of those that are named and of further dark ones.

        Raises:
            DataError: no file for one of them, or files that are none of them.
        """


def device_drivers() -> dict[str, EntryPoint]:
    """Benches that can be named: the package's own, whose names nobody else's can take, and those of other packages."""
    return OWN | {point.name: point for point in entry_points(group=GROUP)} | OWN


def find_device(name: str, /, **settings: Any) -> Device:
    """A bench by its name.

    Args:
        name: one of ``OWN``, that of an entry point of the group ``tmca.devices``, or ``FILE.py:Class``, which runs the
            file.
        settings: of its factory; texts become what its annotations say.

    Raises:
        SettingError: an unknown name, a file without that class, a setting that the factory lacks, does not have or
            cannot use, or a factory that makes no bench.
        DeviceError: a driver that cannot be loaded, or whose factory fails.
    """
    factory = _factory(name)
    if name in OWN:
        read_settings(factory, settings, name)
        own: Device = factory(**settings)
        return own
    given = read_settings(factory, settings, name)
    try:
        with answering(name):
            device = factory(**given)
    except DeviceError as error:
        if settings and isinstance(error.__cause__, ValueError | TypeError):
            where, remedy = _blamed(settings, str(error.__cause__)), said_settings(factory, name)
            raise SettingError(where, error.found, "what the driver can use", remedy) from error
        raise
    if not isinstance(device, Device):
        raise SettingError("--device", f"{name}: {type(device).__name__}", "load, show, capture and saturation")
    return device


def _factory(name: str) -> Any:
    """What makes a bench; see ``find_device``."""
    if names_a_file(name):
        return class_from_file(name, object, "--device")
    drivers = device_drivers()
    if name not in drivers:
        remedy = "install the package of its driver, or name its file: FILE.py:Class"
        raise SettingError("--device", repr(name), f"one of {', '.join(drivers)}", remedy)
    with answering(name):
        return drivers[name].load()


def _blamed(settings: Mapping[str, Any], said: str) -> str:
    """The setting whose value an error shows; all of them where it shows none, or several."""
    shown = [name for name, value in settings.items() if repr(value) in said]
    return f"--set {shown[0]}" if len(shown) == 1 else " ".join(f"--set {name}={settings[name]}" for name in settings)


def number_of(device: Device, name: str, default: float | None = None) -> float:
    """A number that a driver has as an attribute; DeviceError for none, or one that is not finite and above 0."""
    with answering(device):
        number = float(getattr(device, name) if default is None else getattr(device, name, default))
    if not 0 < number < inf:
        where = f"device {type(device).__name__}"
        raise DeviceError(where, f"{name} {number:g}", "a finite number above 0", "mend its driver")
    return number


@contextmanager
def answering(device: object) -> Iterator[None]:
    """Whatever fails in a driver, or in that of a name, is a DeviceError in one line; the cause stays beneath."""
    try:
        yield
    except TmcaError:
        raise
    except (Exception, SystemExit) as error:
        name = device if isinstance(device, str) else type(device).__name__
        remedy = "mend the driver or the device, then run the same command again"
        raise DeviceError(f"device {name}", _failure(device, error), "an answer", remedy) from error


def _failure(device: object, error: BaseException) -> str:
    """What failed, in one line; in a driver of a file, which one, and where in it."""
    said, file, name = one_line(error), file_of(type(device)), type(device).__name__
    if isinstance(device, str) and names_a_file(device):
        place, _, name = device.rpartition(":")
        file = Path(place).expanduser().resolve()
    line = "" if file is None else line_in(file, error)
    return f"{file}:{name}, which fails with {said}{line}" if line else said


_LEAST, _EXPOSURES = 30.0, 3.0
"""Seconds, and exposures, that a call is waited for; the larger of the two."""
T = TypeVar("T")


def time_limit(manifest: dict[str, Any], asked: float | None) -> float | None:
    """Seconds that a call of a driver is waited for, None for as long as it takes: those that are asked for, 0 for no
    limit; without, 30 s or three exposures, whichever is longer. SettingError for a time below 0, or none at all."""
    if asked is None:
        return max(_LEAST, _EXPOSURES * float(manifest["exposure_s"]))
    if not (isfinite(asked) and asked >= 0):
        raise SettingError("--timeout", f"{asked:g} s", "seconds above 0, or 0 for as long as it takes")
    return asked or None


class Calls:
    """Calls of a driver, each answered within a limit; a context, in which they share one thread.

    One thread, for there are drivers that answer none but the one that loaded them; a daemon, for nothing but the end
    of the process ends a driver that hangs.

    A limit of None, not seconds, calls where it stands, and waits as long as it takes.
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
            value, error = answer.get(timeout=min(limit, TIMEOUT_MAX))
        except Empty:
            remedy = "see to the device, and run the same command again, or with a longer --timeout"
            said = f"no answer in {limit:g} s"
            raise DeviceError(f"device {type(self.device).__name__}", said, "one", remedy) from None
        if error is not None:
            raise error
        result: T = value
        return result

    def _answer(self) -> None:
        while (asked := self._asked.get()) is not None:
            call, answer = asked
            try:
                answer.put((call(), None))
            except BaseException as error:  # KeyboardInterrupt and SystemExit too: whoever waits has to hear of it
                answer.put((None, error))
