"""The bench that ``tmca capture`` and ``tmca calibrate capture`` take frames with."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.cli.lab.export import named_export
from tmca.errors import SettingError

if TYPE_CHECKING:
    from tmca.cameras import Hardware


@dataclass(frozen=True)
class AskedBench:
    """A bench as it was asked for.

    Args:
        device: ``simulated``, or the name of a driver.
        settings: NAME=VALUE of a driver.
        bits, seed, stops_after, hardware: of the simulated one.
        scene: before it; none where it is lit by a lamp.
        timeout: seconds that a driver has for an answer.

    Raises:
        SettingError: options of the other kind of bench.
    """

    device: str
    settings: list[str]
    bits: int | None
    seed: int | None
    stops_after: int | None
    hardware: Hardware
    scene: str | None = None
    timeout: float | None = None

    def __post_init__(self) -> None:
        if self.device == "simulated":
            if self.timeout is not None:
                expected = "none: the simulated bench computes as long as it takes"
                raise SettingError("--timeout", f"{self.timeout:g}", expected)
            if self.settings:
                expected = "none: the simulated bench has options of its own"
                raise SettingError("--set", self.settings[0], expected)
            return
        simulated = {"scene": self.scene, "bits": self.bits, "seed": self.seed, "stops_after": self.stops_after}
        for name, value in (simulated | {"hardware": self.hardware.described() or None}).items():
            if value is not None:
                option = f"--{name.replace('_', '-')}"
                raise SettingError(option, f"{value}", f"none before {self.device}: it is of the simulated bench")

    def bench(self, taken: Any, whole: bool) -> Any:
        """The bench.

        Args:
            taken: snapshot of the camera.
            whole: whether its frames are whole exposures, or slots.
        """
        from tmca.lab.acquisition.drivers import find_device

        if self.device != "simulated":
            return find_device(self.device, **_driver_settings(self.settings))
        made: dict[str, Any] = {"bits": self._bits, "seed": self.seed or 0, "hardware": self.hardware}
        made |= {"stops_after": self.stops_after, "whole": whole}
        scene = [] if self.scene is None else _scene(self.scene, taken)
        return find_device("simulated", camera=taken.camera, scene=scene, **made)

    @property
    def _bits(self) -> int:
        return 16 if self.bits is None else self.bits

    def said(self) -> dict[str, Any]:
        """What frames depend on, as JSON values."""
        about: dict[str, Any] = {"driver": self.device, "settings": self.settings}
        if self.device == "simulated":
            about |= {"scene": self.scene, "bits": self._bits, "seed": self.seed or 0}
            about |= {"hardware": self.hardware.described()}
        return about


def _driver_settings(texts: list[str]) -> dict[str, str]:
    """Name → text after the first ``=``: what a driver makes of it is its own.

    Raises:
        SettingError: a text of another form, or a name twice.
    """
    settings: dict[str, str] = {}
    for text in texts:
        name, sign, value = text.partition("=")
        if not (sign and name.strip()) or name.strip() in settings:
            raise SettingError("--set", repr(text), "NAME=VALUE, every name once")
        settings[name.strip()] = value.strip()
    return settings


def known_camera(export: Path, like: Path | None) -> Any:
    """The snapshot whose camera is known."""
    from tmca.cameras import Snapshot
    from tmca.lab.display.manifest import SOURCE_AT

    if like is not None:
        return Snapshot.load(like)
    manifest = named_export(export)
    source = Path(manifest.get(SOURCE_AT, manifest["source"]))
    if not source.exists():
        found = f"an export of {source}, which is not found"
        raise SettingError("--like", found, "the snapshot file of its camera", "name it where it is now")
    if not (source.suffix in (".nc", ".h5") and source.is_file() and _is_snapshot(source)):
        found = f"an export of {source}, which says codes alone"
        raise SettingError("--like", found, "a snapshot file of its camera", "write one with `tmca simulate`")
    return Snapshot.load(source)


def _is_snapshot(source: Path) -> bool:
    from tmca.data import read_dataset

    return "snapshot" in read_dataset(source)


def _scene(name: str, taken: Any) -> list[Any]:
    """Tensors of a scene, as a camera takes them."""
    from tmca.applications import application_of

    application = application_of(taken.camera)
    return [part[:1] for part in application.tensors(application.truth(name, taken.camera, taken.notes))]
