"""The camera of a command: by its spec, or of weights that learned it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter

from tmca.errors import SettingError
from tmca.specs import LIMITS, CameraSpec, SensorSpec, Spec

if TYPE_CHECKING:
    from tmca.decoders import Weights


def group(title: str, order: int, negative: str = "") -> Parameter:
    """Options that come from the fields of a spec; ``negative`` is put before the names of flags to switch them off."""
    return Parameter(name="*", group=Group(title, sort_key=order), negative_bool=negative)


CAMERA, READING, BENCH = group("Camera", 1), group("Reading the scene", 2), group("Bench", 4, "no-")
SENSOR = group("Sensor", 3)
_FAULTS = f"""Faults that the decoder does not know, NAME=VALUE,… or a YAML file of them: {", ".join(LIMITS)}
(docs/hardware.md); ROWS:COLUMNS where there are two."""
Faults = Annotated[str | None, Parameter(group=Group("Hardware", sort_key=5), help=_FAULTS)]
_WITH_WEIGHTS = ("seed", "slots")


class CameraChoice:
    """The camera that options describe: built once, when its scene has given it a size, and bands or views.

    Raises:
        SettingError: weights with something beside them that says the same, or of another kind.
        DataError: weights that cannot be read.
    """

    def __init__(self, spec: CameraSpec, sensor: SensorSpec, bench: Spec | None = None) -> None:
        self.spec, self.sensor, self.bench = spec, sensor, bench
        self.name, self.option = spec.learned()
        self.weights = None if self.name is None else self._learned(self.name)

    def depth_reading(self) -> dict[str, Any]:
        """What a spectral-depth camera sees, as `tmca.data.load_spectral_depth` takes it: bands, depth range.

        Raises:
            SettingError, DataError: as ``build``.
        """
        from tmca.applications.spectral_depth import reading_range
        from tmca.cameras import seen_by

        return reading_range(seen_by(self.spec, self.bench) if self.weights is None else self.weights)

    def build(self, **shape: Any) -> Any:
        """The camera; ``shape`` is what the scene gives: size, and bands or views.

        Raises:
            SettingError, ShapeError: no camera, or weights for other bands.
            DataError: a file that cannot be used.
        """
        if self.weights is None:
            from tmca.cameras import camera_of

            return camera_of(self.spec, self.sensor, self.bench, **shape)
        from tmca.sensor import Sensor

        sensor = Sensor(**self.sensor.model_dump())
        return self.weights.camera_for(shape["size"], bands=shape.get("bands"), sensor=sensor)

    def _learned(self, name: str) -> Weights:
        from tmca.decoders import Weights

        spec = self.spec
        beside = {**spec.given(*_WITH_WEIGHTS, self.option), **({} if self.bench is None else self.bench.given())}
        for other, value in beside.items():
            found = f"--{'no-' if value is False else ''}{other.replace('_', '-')} beside weights"
            remedy = "leave one of the two out"
            raise SettingError(self.option, found, "learned codes and optics, or chosen ones", remedy)
        slots = getattr(spec, "slots", None) if spec.has("slots") else None
        weights = Weights.find(name, slots or 8, spec.kind)
        weights.check_kind(spec.kind)
        weights.check_codes()
        if slots not in (None, weights.slots):
            raise SettingError("slots", f"{slots}", f"{weights.slots}, as these weights have", "leave it out")
        return weights


def code_files(spec: CameraSpec) -> list[Path]:
    """Files that the codes come from; weights that come with tmca are none, they may be of any camera."""
    named = [getattr(spec, name, None) for name in ("aperture", "shutter", "codes", "coloured", "weights")]
    given = [Path(name) for name in named if name is not None]
    return [path for path in given if path.suffix or path.is_dir()]


def scenes_of(scenes: Sequence[str], split: Path | None = None) -> list[str]:
    """Scenes that are named, and those of a split file."""
    from tmca.data import read_split

    return [*scenes, *(map(str, read_split(split)) if split else ())]
