"""Devices that show codes: what they are, and the light that their grey levels give."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from tmca.attributes import expected_of, unknown_name
from tmca.errors import DataError, SettingError
from tmca.text_files import read_text
from tmca.yaml_files import read_yaml

_PRESETS = Path(__file__).parent / "presets"
PRESETS = tuple(sorted(file.stem for file in _PRESETS.glob("*.yaml")))
"""Devices that come with the package."""
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
PLANES = {
    "dmd": "aperture",
    "lcos": "aperture",
    "deformable-mirror": "heights",
    "coded-exposure": "shutter",
    "emulated-shutter": "shutter",
}
"""The plane of codes that a kind of device shows."""


class DeviceDescription(BaseModel):
    """A device.

    Args:
        name: what manifests say.
        kind: of device.
        size: (rows, columns) of its pixels; that of the codes for a sensor.
        pitch_um: of its pixels, micrometres.
        bits: of its frames; a binary device shows 0 and the largest number of them.
        lattice: ``diamond``: odd rows are displaced by half a pitch, rows are half a pitch apart.
        mounting_angle_deg: by which it is turned on the table; patterns are turned back.
        flip: axes along which it shows patterns mirrored.
        macro_pixel: device pixels along the side of a code pixel.
        gamma: of an 8-bit frame: light = (grey / 255)^gamma.
        lut: CSV of grey and light, or of grey and ``phase_rad``, which takes the place of the gamma.
        pattern_rate_hz: most patterns in a second.
        memory_patterns: most patterns it holds.
        pupil_mm: diameter of a mirror's pupil.
        noll: Noll indices of the terms that a mirror shows.
        buckets: of a sensor's pixel; with one, light of closed slots is drained.
        drain: whether pixels with several buckets have a drain too.
        tile: (rows, columns) of the codes that a sensor holds, which repeat over it; any codes without.
        stroke_um: largest surface of one term over the pupil, micrometres either way.
        total_stroke_um: largest difference between two places of its surface, all terms together, micrometres.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    kind: Literal["dmd", "lcos", "deformable-mirror", "coded-exposure", "emulated-shutter"]
    size: tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)]] | None = None
    pitch_um: Positive | None = None
    bits: int = Field(default=1, ge=1, le=16)
    lattice: Literal["square", "diamond"] = "square"
    mounting_angle_deg: float = Field(default=0.0, allow_inf_nan=False)
    flip: tuple[Literal["rows", "columns"], ...] = ()
    macro_pixel: Positive = 1.0
    gamma: Positive = 1.0
    lut: str | None = None
    pattern_rate_hz: Positive | None = None
    memory_patterns: int | None = Field(default=None, ge=1)
    buckets: int = Field(default=1, ge=1, le=256)
    drain: bool = False
    tile: tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)]] | None = None
    pupil_mm: Positive | None = None
    noll: tuple[Annotated[int, Field(ge=1)], ...] = ()
    stroke_um: Positive | None = None
    total_stroke_um: Positive | None = None

    @model_validator(mode="after")
    def _complete(self) -> DeviceDescription:
        if self.kind in ("dmd", "lcos") and self.size is None:
            raise ValueError(f"size: (rows, columns), which a {self.kind} has")
        if self.kind == "deformable-mirror" and not (self.noll and self.stroke_um):
            raise ValueError(
                f"{'stroke_um' if self.noll else 'noll'}: noll and stroke_um, which a deformable mirror has"
            )
        if self.kind == "lcos" and self.bits != 8:
            raise ValueError("bits: 8, frames of an LCoS are grey pictures")
        if self.buckets > 1 and self.kind != "coded-exposure":
            raise ValueError(f"buckets: 1, a {self.kind} has no more")
        if len(self.places) > 2**self.bits:
            bits = (len(self.places) - 1).bit_length()
            raise ValueError(f"bits: {bits} or more, for the {len(self.places)} places where a slot's light goes")
        return self

    @property
    def top(self) -> int:
        """Largest number in its frames."""
        return int(2**self.bits - 1)

    @property
    def places(self) -> tuple[int | None, ...]:
        """Bucket, None for the drain, that every number in a sensor's frames sends the light of a slot to."""
        drained = (None,) if self.drain or self.buckets == 1 else ()
        return (*drained, *reversed(range(self.buckets)))

    @property
    def plane(self) -> str:
        """The plane of codes that it shows: aperture, heights or shutter."""
        return PLANES[self.kind]


def device_named(name: str, **changes: Any) -> DeviceDescription:
    """A device of the package, or of a YAML file.

    Args:
        name: one of ``PRESETS``, or a file.
        changes: values that replace the description's; None leaves it.

    Raises:
        SettingError: an unknown name, or an impossible value.
        DataError: a file that is none of a device.
    """
    file = _PRESETS / f"{name}.yaml" if name in PRESETS else Path(name)
    if name not in PRESETS and file.suffix not in (".yaml", ".yml"):
        raise SettingError("--device", repr(name), f"one of {', '.join(PRESETS)}, or a YAML file that describes one")
    described = read_yaml(file, "a YAML file that describes a device, see docs/devices.md")
    described = {"name": file.stem, **described, **{key: value for key, value in changes.items() if value is not None}}
    if described.get("lut"):
        described["lut"] = str(file.parent / described["lut"])
    try:
        device = DeviceDescription.model_validate(described)
    except ValidationError as error:
        if unknown := unknown_name(error, DeviceDescription):
            raise SettingError(f"{file}: {unknown[0]}", *unknown[1:]) from None
        place, found, expected = _first_wrong(error, described)
        raise SettingError(_where(place, file, changes), found, expected) from None
    if device.lut is not None and device.kind != "lcos":
        raise SettingError(
            _where(("lut",), file, changes), f"one of a {device.kind}", "none: an lcos alone has a response"
        )
    return device


def _first_wrong(error: ValidationError, described: Mapping[str, Any]) -> tuple[Sequence[int | str], str, str]:
    """Place, what was found and what is expected of the first wrong value, or of one that does not fit the others."""
    first = error.errors()[0]
    place, expected = first["loc"], expected_of(first)
    if not place:
        name, _, expected = expected.partition(": ")
        return (name,), str(described.get(name, "nothing"))[:80], expected
    return place, "nothing" if first["type"] == "missing" else str(first.get("input"))[:80], expected


def _where(place: Sequence[int | str], file: Path, changes: Mapping[str, Any]) -> str:
    """The option that set a value, or its place in a file."""
    name = str(place[0]) if place else "device"
    if changes.get(name) is not None:
        return f"--{name.removesuffix('_deg').replace('_', '-')}"
    return f"{file}: {'.'.join(map(str, place)) or name}"


LEVELS = 256


def response(device: DeviceDescription) -> NDArray[np.float64]:
    """(256,) share of the light at every grey level, from 0 to 1.

    A table of ``grey,light`` rises; of ``grey,phase_rad`` it is the retardance φ of a liquid crystal between crossed
    polarisers, which pass sin²(φ/2) and may pass their maximum before grey 255.

    Raises:
        DataError: a table that is none, that does not rise, or whose phase does not change.
    """
    if device.lut is None:
        return np.asarray((np.arange(LEVELS) / (LEVELS - 1)) ** device.gamma)
    return _table(Path(device.lut))


def grey_of(light: NDArray[np.float32], device: DeviceDescription) -> NDArray[np.uint8]:
    """Grey levels that give shares of the light, the nearest ones.

    Raises:
        SettingError: shares outside 0 to 1.
    """
    if light.min() < 0 or light.max() > 1:
        raise SettingError("aperture", f"{light.min():g} to {light.max():g}", "shares of the light, 0 to 1")
    shares = response(device)
    levels = np.argsort(shares, kind="stable")
    rising = shares[levels]
    above = np.searchsorted(rising, light).clip(1, LEVELS - 1)
    nearer = light - rising[above - 1] < rising[above] - light
    return np.asarray(levels[above - nearer], dtype=np.uint8)


def light_of(grey: NDArray[np.uint8], device: DeviceDescription) -> NDArray[np.float32]:
    """Share of the light that grey levels give."""
    return response(device)[grey].astype(np.float32)


def step_of(device: DeviceDescription) -> float:
    """Largest step of light between neighbouring levels of it."""
    return float(np.diff(np.sort(response(device))).max())


def _table(file: Path) -> NDArray[np.float64]:
    phase, (grey, values) = _columns(file)
    rises = phase or bool((np.diff(values) > 0).all())
    if not rises or (np.diff(grey) <= 0).any() or grey[0] > 0 or grey[-1] < LEVELS - 1:
        raise DataError(file, "a response that does not rise from grey 0 to 255", "one that does", "measure it again")
    light = np.interp(np.arange(LEVELS), grey, values)
    light = np.sin(light / 2) ** 2 if phase else light
    if not np.ptp(light) > 0:
        raise DataError(file, "the same light at every grey level", "a response that changes", "measure it again")
    return np.asarray((light - light.min()) / np.ptp(light))


def _columns(file: Path) -> tuple[bool, NDArray[np.float64]]:
    """Whether a table tells the phase, and its two columns (2, n) by rising grey level."""
    wanted = "lines GREY,LIGHT below the heading grey,light or none, or GREY,PHASE below the heading grey,phase_rad"
    text = read_text(file, f"a text file, {wanted}", "see docs/devices.md")
    try:
        heading, *rows = [line.split("#")[0].strip() for line in text.splitlines() if line.split("#")[0].strip()]
        names = [name.strip().lower() for name in heading.split(",")]
        if names not in (["grey", "light"], ["grey", "phase_rad"]):
            rows.insert(0, heading)
        table = np.array([[float(part) for part in row.split(",")] for row in rows])
    except ValueError as error:
        raise DataError(file, f"no table of numbers ({error})", wanted, "see docs/devices.md") from None
    if table.ndim != 2 or table.shape[1] != 2 or not np.isfinite(table).all():
        raise DataError(file, f"numbers of shape {table.shape}", wanted, "two numbers in every line")
    return names[-1] == "phase_rad", table[np.argsort(table[:, 0])].T
