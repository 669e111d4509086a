"""The bench that ``tmca capture`` and ``tmca calibrate capture`` take frames with."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Group, Parameter

from tmca.cli.cameras import Faults
from tmca.cli.lab.export import named_export
from tmca.cli.options.numbers import MaybeWhole
from tmca.errors import SettingError
from tmca.specs import Hardware

SIMULATED = Parameter(group=Group("Simulated bench", sort_key=1))


@Parameter(name="*")
@dataclass(frozen=True)
class BenchOptions:
    """A bench as it is asked for."""

    device: str = "simulated"
    "simulated, the name of a driver (entry points tmca.devices), or its FILE.py:Class."
    like: Path | None = None
    """Snapshot file whose camera this is; that of the export where it was made from a snapshot. Where codes repeat, its
    size may be another."""
    settings: Annotated[list[str] | None, Parameter(name="--set")] = None
    "NAME=VALUE settings of a driver, texts unless it says of which type they are."
    timeout: float | None = None
    """Seconds that a driver has for each answer, 0 for no limit; 30 s or three exposures without, whichever is
    longer."""
    bits: Annotated[MaybeWhole, SIMULATED] = None
    "Of the simulated bench's digital numbers, 16 without."
    seed: Annotated[MaybeWhole, SIMULATED] = None
    "Of its noise and faults, 0 without."
    stops_after: Annotated[MaybeWhole, SIMULATED] = None
    "Frames after which it does not answer any more."
    hardware: Faults = None

    @property
    def simulated(self) -> bool:
        """Whether it is computed."""
        return self.device == "simulated"

    @property
    def faults(self) -> Hardware:
        """Of the simulated bench."""
        return Hardware.read(self.hardware)

    @property
    def _bits(self) -> int:
        return 16 if self.bits is None else self.bits

    def check(self, scene: str | None = None, drift: str | None = None) -> None:
        """Raises SettingError for options of the other kind of bench; ``scene`` stands, or drifts, before it."""
        if self.simulated:
            for option, value in (("--timeout", self.timeout), ("--set", self.settings)):
                if value is not None:
                    raise SettingError(option, str(value), "none: the simulated bench has options of its own")
            return
        own = ("bits", "seed", "stops_after", "hardware")
        given = {"scene": scene, "drift": drift, **{name: getattr(self, name) for name in own}}
        for name, value in given.items():
            if value is not None:
                option = f"--{name.replace('_', '-')}"
                raise SettingError(option, f"{value}", f"none before {self.device}: it is of the simulated bench")

    def check_scene(self, scene: str | None) -> None:
        """Raises SettingError where the simulated bench has nothing before it."""
        if self.simulated and scene is None:
            expected, remedy = "a scene before the simulated bench", "name a file or a rendered scene"
            raise SettingError("--scene", "none", expected, remedy)

    def bench(self, taken: Any, whole: bool, scene: str | None = None, drift: tuple[float, float] = (0.0, 0.0)) -> Any:
        """The bench.

        Args:
            taken: snapshot of the camera.
            whole: whether its frames are whole exposures, or slots.
            scene: before the simulated one; none where it is lit by a lamp.
            drift: rows and columns of it from exposure to exposure.
        """
        from tmca.lab.acquisition.drivers import find_device

        if not self.simulated:
            return find_device(self.device, **_driver_settings(self.settings or []))
        made: dict[str, Any] = {"bits": self._bits, "seed": self.seed or 0, "hardware": self.faults}
        made |= {"stops_after": self.stops_after, "whole": whole, "drift": drift}
        before = [] if scene is None else _scene(scene, taken)
        return find_device("simulated", camera=taken.camera, scene=before, **made)

    def said(self, scene: str | None = None) -> dict[str, Any]:
        """What frames depend on, as JSON values."""
        about: dict[str, Any] = {"driver": self.device, "settings": self.settings or []}
        if self.simulated:
            about |= {"scene": scene, "bits": self._bits, "seed": self.seed or 0}
            about |= {"hardware": self.faults.described()}
        return about

    def known(self, export: Path) -> Any:
        """The snapshot whose camera is known, at the size of the export.

        Raises:
            SettingError: none is named, and the export was made from codes alone, or from a file that is gone.
        """
        from tmca.cameras import Snapshot
        from tmca.lab.exported_camera import camera_shown, exported_snapshot

        manifest = named_export(export)
        taken = exported_snapshot(manifest, "--like") if self.like is None else Snapshot.load(self.like)
        return camera_shown(taken, manifest)


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


def _scene(name: str, taken: Any) -> list[Any]:
    """Tensors of a scene, as a camera takes them."""
    from tmca.applications import application_of

    application = application_of(taken.camera)
    return [part[:1] for part in application.tensors(application.truth(name, taken.camera, taken.notes))]
