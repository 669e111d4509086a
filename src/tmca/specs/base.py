"""What every spec is, and the types of fields that are written as text: lists, sizes, wavelengths."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, field_validator

from tmca.attributes import expected_of
from tmca.errors import SettingError, TmcaError, did_you_mean

if TYPE_CHECKING:
    from pydantic import ValidationInfo

SEEDS = 2**30
"""Seeds lie below."""
BANDS = 4096
"""Most bands of a scene."""
S = TypeVar("S", bound="Spec")


class Spec(BaseModel):
    """Names, types, defaults, bounds and help of what something is described by; unknown names are refused."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        use_attribute_docstrings=True,
        allow_inf_nan=False,
        protected_namespaces=(),
        defer_build=True,
    )

    @field_validator("*", mode="before")
    @classmethod
    def _no_truth_for_a_number(cls, value: Any, info: ValidationInfo) -> Any:
        """YAML's ``yes`` and ``on`` are not 1."""
        field = cls.model_fields[str(info.field_name)]
        if isinstance(value, bool) and "bool" not in str(field.annotation):
            raise SettingError(str(info.field_name), str(value), "a value, not yes or no")
        return value

    def given(self, *left_out: str) -> dict[str, Any]:
        """Fields that were given, without some; in their order."""
        return {
            name: getattr(self, name) for name in type(self).model_fields if self.has(name) and name not in left_out
        }

    def only(self, *names: str) -> dict[str, Any]:
        """Those of some fields that were given."""
        return {name: value for name, value in self.given().items() if name in names}

    def has(self, name: str) -> bool:
        """Whether a field was given."""
        return name in self.model_fields_set and getattr(self, name) is not None


def spec_of(kind: type[S], values: Mapping[str, Any]) -> S:
    """A checked spec of names and values, the values of their types or texts of them.

    Raises:
        SettingError: the first field that is wrong.
    """
    try:
        return kind.model_validate(dict(values))
    except ValidationError as error:
        raise first_error(error, tuple(kind.model_fields)) from None


def first_error(error: ValidationError, names: tuple[str, ...] = ()) -> TmcaError:
    """The first thing that is wrong, what a validator raised or a field with pydantic's words."""
    first = error.errors()[0]
    raised = first.get("ctx", {}).get("error")
    if isinstance(raised, TmcaError):
        return raised
    where = next((str(part) for part in first["loc"] if isinstance(part, str)), "settings")
    if first["type"] == "extra_forbidden":
        return SettingError(where, "an unknown name", f"one of {', '.join(names)}", did_you_mean(where, names))
    return SettingError(where, str(first["input"]), expected_of(first), "leave it out for the default")


def _parts(value: Any) -> Any:
    """A text of numbers separated by commas as a list; one number as it is."""
    parts = value.split(",") if isinstance(value, str) else value
    return parts[0] if isinstance(parts, list) and len(parts) == 1 and isinstance(value, str) else parts


def _words(value: Any) -> Any:
    """Words separated by commas."""
    words = [value] if isinstance(value, str) else value
    texts = isinstance(words, list | tuple) and all(isinstance(word, str) for word in words)
    return [word.strip() for word in ",".join(words).split(",") if word.strip()] if texts else value


def _both(value: Any) -> Any:
    """One number or two, separated by commas, as two."""
    parts = _parts(value)
    return parts if isinstance(parts, list | tuple) or parts is None else [parts, parts]


def _sides(value: Any) -> Any:
    """``HEIGHTxWIDTH`` as two numbers."""
    parts = value.lower().replace("×", "x").split("x") if isinstance(value, str) else value
    if isinstance(parts, list) and not (len(parts) == 2 and all(str(part).strip().isdecimal() for part in parts)):
        raise ValueError("two whole numbers, such as 14x14")
    return parts


def _joined(value: Any) -> Any:
    """The texts that a command line hands over one by one, as one."""
    return ",".join(value) if isinstance(value, list | tuple) and all(isinstance(v, str) for v in value) else value


def metres_of_nm(text: Any) -> Any:
    """``400:700:31`` (first, last, number of bands) or ``400,410,…`` in nm → metres; other values as they are.

    Raises:
        SettingError: neither of the two.
    """
    text = _joined(text)
    if not isinstance(text, str):
        return text
    try:
        if ":" in text:
            first, last, count = text.split(":")
            if not 1 <= int(count) <= BANDS:
                raise SettingError("wavelengths", repr(text), f"a COUNT from 1 to {BANDS}")
            step = (float(last) - float(first)) / max(int(count) - 1, 1)
            return [(float(first) + step * band) * 1e-9 for band in range(int(count))]
        return [float(part) * 1e-9 for part in text.split(",")]
    except ValueError:
        raise SettingError("wavelengths", repr(text), "FIRST:LAST:COUNT or one wavelength per band, in nm") from None


def range_of_nm(text: Any) -> Any:
    """``400:1000`` in nm → (first, last) in metres; other values as they are.

    Raises:
        SettingError: no such range.
    """
    text = _joined(text)
    if not isinstance(text, str):
        return text
    try:
        first, last = (float(part) * 1e-9 for part in text.split(":"))
    except ValueError:
        raise SettingError("range", repr(text), "FIRST:LAST in nm, such as 400:1000") from None
    if not 0 < first < last < float("inf"):
        raise SettingError("range", repr(text), "FIRST below LAST, in nm, such as 400:1000")
    return first, last


def _text(value: Any) -> Any:
    return _parts(_joined(value))


Numbers = Annotated[float | tuple[float, ...], BeforeValidator(_text)]
"""One number or several: ``1`` or ``0,1.5,3``."""
_PAIR = Field(min_length=2, max_length=2)
Both = Annotated[tuple[float, ...], BeforeValidator(lambda value: _both(_joined(value))), _PAIR]
"""Two numbers, or one that stands for both: ``1`` or ``1,0.5``."""
_Distance = Annotated[float, Field(gt=0, allow_inf_nan=True)]
Distances = Annotated[tuple[_Distance, ...], BeforeValidator(_text), _PAIR]
"""Two distances in metres, the far one infinite perhaps: ``0.4,inf``."""
Words = Annotated[tuple[str, ...], BeforeValidator(_words)]
"""Words separated by commas."""
Wholes = Annotated[tuple[int, ...], BeforeValidator(_words)]
"""Whole numbers separated by commas."""
Whole = Annotated[int, Field(ge=1, le=10**9)]
"""1 or more."""
Slots = Annotated[int, Field(ge=1, le=1024)]
Buckets = Annotated[int, Field(ge=1, le=256)]
"""Time slots K within an exposure."""
Pixels = Annotated[int, Field(ge=1, le=32768)]
"""Along one side of a sensor, a tile or a window."""
Sides = Annotated[tuple[Pixels, ...], BeforeValidator(lambda value: _sides(_joined(value))), _PAIR]
"""Two whole numbers: ``64x80``."""
Metres = Annotated[tuple[float, ...], BeforeValidator(metres_of_nm)]
"""Wavelengths in metres, of texts in nm."""
Span = Annotated[tuple[float, ...], BeforeValidator(range_of_nm), _PAIR]
"""First and last wavelength in metres, of ``FIRST:LAST`` in nm."""
Seed = Annotated[int, Field(ge=0, lt=SEEDS)]
Share = Annotated[float, Field(ge=0, le=1)]
Length = Annotated[float, Field(gt=0)]
"""Metres."""
