"""What is known of a prototype: its files, its geometry, its levels. A small YAML file, checked when it is read."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator

from tmca.attributes import unknown_name
from tmca.errors import DataError, SettingError
from tmca.lab.registering import MaskImage
from tmca.yaml_files import read_yaml

_FOLDER = Path(__file__).parent / "prototypes"
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Nanometres = Annotated[float, Field(gt=100, lt=100_000, allow_inf_nan=False)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class _Prototype(_Strict):
    """What every prototype says.

    Args:
        device: what took the captures.
        black, white: levels of no light and of a white scene behind its codes, in the capture's numbers.
        saturation: value from which on a pixel of the capture says nothing; None where it is not known.
        turned: degrees by which pictures are turned to stand upright.
        scenes: what captures show, by the stem of their file or by their name.
        points: places of a scene (row, column) whose spectra are worth a look, by the same names.
    """

    device: str
    black: float = 0.0
    white: Positive = 1.0
    saturation: Positive | None = None
    turned: Literal[0, 90, 180, 270] = 0
    scenes: dict[str, str] = {}
    points: dict[str, dict[str, tuple[int, int]]] = {}

    @model_validator(mode="after")
    def _light(self) -> _Prototype:
        if self.white <= self.black:
            raise ValueError(f"white {self.white:g}, black {self.black:g}: white above black")
        if self.saturation is not None and self.saturation <= self.black:
            raise ValueError(f"saturation {self.saturation:g}, black {self.black:g}: saturation above black")
        return self


class SingleDisperser(_Prototype):
    """A mask, a disperser along x, a sensor.

    Args:
        capture_key, mask_key: variables of their files; None where they hold one alone.
        wavelengths_nm: of the bands.
        pixels_per_band: displacement from band to band, pixels towards larger x; negative for the other direction.
        response: ``"flat"``, ``"bandwidth"`` (in proportion to the bands' widths), or a value per band.
        digital_numbers: of the converter, per 1 of the capture; None where the capture holds them.
        full_well: electrons at full scale, for shot noise; None for none.
        registration: of the mask's file with the capture.
    """

    kind: Literal["single-disperser"]
    capture_key: str | None = None
    mask_key: str | None = None
    wavelengths_nm: tuple[Nanometres, ...] = Field(min_length=2)
    pixels_per_band: float
    response: Literal["flat", "bandwidth"] | tuple[Positive, ...] = "flat"
    digital_numbers: Positive | None = None
    full_well: Positive | None = None
    registration: MaskImage = MaskImage()

    @model_validator(mode="after")
    def _bands(self) -> SingleDisperser:
        if list(self.wavelengths_nm) != sorted(set(self.wavelengths_nm)):
            raise ValueError("wavelengths_nm that rise")
        if not isinstance(self.response, str) and len(self.response) != len(self.wavelengths_nm):
            raise ValueError(f"a response of {len(self.response)} values for {len(self.wavelengths_nm)} bands")
        return self

    def response_of_bands(self) -> np.ndarray:
        """(L,) response, 1 on average."""
        nm = np.array(self.wavelengths_nm)
        named = {"flat": np.ones_like(nm), "bandwidth": np.gradient(nm)}
        values = named[self.response] if isinstance(self.response, str) else np.array(self.response)
        return values / values.mean()


class CodedPair(_Strict):
    """Variables of one capture behind a pixel shutter.

    Args:
        capture_key: of the capture (H, W).
        shutter_key: of its shutter (H, W, K).
        shutter_shift: rows and columns by which the shutter's patterns are displaced on the sensor.
        first_slot: with which the exposure began; the slots before it come after the last one.
    """

    capture_key: str
    shutter_key: str
    shutter_shift: tuple[int, int] = (0, 0)
    first_slot: int = Field(default=0, ge=0)


class PixelShutter(_Prototype):
    """A sensor whose pixels open in slots of their own; nothing is displaced.

    Args:
        captures: by name, the variables of the capture (H, W) and of its shutter (H, W, K).
        wavelength_nm: of the one band.
    """

    kind: Literal["pixel-shutter"]
    captures: dict[str, CodedPair] = Field(min_length=1)
    wavelength_nm: Nanometres = 550.0


Prototype = Annotated[SingleDisperser | PixelShutter, Field(discriminator="kind")]
_ADAPTER: TypeAdapter[SingleDisperser | PixelShutter] = TypeAdapter(Prototype)


def prototype_names() -> list[str]:
    """Prototypes that come with the package."""
    return sorted(file.stem for file in _FOLDER.glob("*.yaml"))


def load_prototype(name: str | Path) -> SingleDisperser | PixelShutter:
    """A prototype of the package by name, or one's own from a YAML file.

    Raises:
        SettingError: no such prototype or file.
        DataError: a description with something missing, unknown or impossible; the first of them is named.
    """
    if str(name) in prototype_names():
        file = _FOLDER / f"{name}.yaml"
    elif not (file := Path(name)).is_file():
        raise SettingError("--prototype", repr(str(name)), f"{', '.join(prototype_names())}, or a YAML file")
    described = read_yaml(file, "the description of a prototype")
    try:
        return _ADAPTER.validate_python(described)
    except ValidationError as error:
        kind = PixelShutter if described.get("kind") == "pixel-shutter" else SingleDisperser
        if unknown := unknown_name(error, kind):
            raise DataError(f"{name}, {unknown[0].partition('.')[2]}", *unknown[1:]) from None
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"]) or "the description"
        found = f"{place}: {first['msg'].removeprefix('Value error, ')}"
        raise DataError(name, found, "the description of a prototype", "docs/real-captures.md has one") from None
