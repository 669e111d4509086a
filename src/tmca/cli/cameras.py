"""The camera of a command: by its spec, or of weights that learned it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Group, Parameter

from tmca.errors import SettingError
from tmca.specs import LIMITS, CameraSpec, SensorSpec, Spec


def group(title: str, order: int, negative: str = "") -> Parameter:
    """Options that come from the fields of a spec; ``negative`` is put before the names of flags to switch them off."""
    return Parameter(name="*", group=Group(title, sort_key=order), negative_bool=negative)


CAMERA, READING, BENCH = group("Camera", 1), group("Reading the scene", 2), group("Bench", 4, "no-")
SENSOR = group("Sensor", 3)
_FAULTS = f"""Faults that the decoder does not know, NAME=VALUE,… or a YAML file of them: {", ".join(LIMITS)}
(docs/hardware.md); ROWS:COLUMNS where there are two."""
Faults = Annotated[str | None, Parameter(group=Group("Hardware", sort_key=5), help=_FAULTS)]
_WITH_WEIGHTS = ("seed", "slots", "weights", "codes")


def camera_for(spec: CameraSpec, sensor: SensorSpec, bench: Spec | None = None, **shape: Any) -> Any:
    """The camera that options describe; ``shape`` is what the scene gives: size, and bands or views.

    Raises:
        SettingError: no camera, or weights with something beside them that says the same.
        DataError: a file that cannot be used.
    """
    weights, option = spec.learned()
    if weights is None:
        from tmca.cameras import camera_of

        return camera_of(spec, sensor, bench, **shape)
    beside = {**spec.given(*_WITH_WEIGHTS), **({} if bench is None else bench.given())}
    for name, value in beside.items():
        found = f"--{'no-' if value is False else ''}{name.replace('_', '-')} beside weights"
        raise SettingError(option, found, "learned codes and optics, or chosen ones", "leave one of the two out")
    return _learned(weights, option, spec, sensor, shape)


def _learned(name: str, option: str, spec: CameraSpec, sensor: SensorSpec, shape: dict[str, Any]) -> Any:
    from tmca.decoders import Weights
    from tmca.decoders.nets.weights import same_bands
    from tmca.sensor import Sensor

    slots = getattr(spec, "slots", None) if spec.has("slots") else None
    weights = Weights.find(name, slots or 8)
    weights.check_kind(spec.kind)
    if slots not in (None, weights.slots):
        raise SettingError("slots", f"{slots}", f"{weights.slots}, as these weights have", "leave it out")
    bands = shape.get("bands")
    if bands is not None and not same_bands(weights.wavelengths, bands):
        found = f"{len(weights.wavelengths)} bands, {weights.wavelengths[0] * 1e9:.4g} nm and on"
        raise SettingError(option, found, f"the scene's {len(bands)}, {bands[0] * 1e9:.4g} nm and on")
    return weights.camera_for(shape["size"], sensor=Sensor(**sensor.model_dump()))


def code_files(spec: CameraSpec) -> list[Path]:
    """Files that the codes come from; weights that come with tmca are none, they may be of any camera."""
    named = [getattr(spec, name, None) for name in ("aperture", "shutter", "codes", "coloured", "weights")]
    given = [Path(name) for name in named if name is not None]
    return [path for path in given if path.suffix or path.is_dir()]
