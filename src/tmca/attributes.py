"""What files say of themselves, as data: JSON and attributes that passed a model, of their types and finite."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, JsonValue, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails, to_json

from tmca.arguments import described
from tmca.errors import DataError, TmcaError, did_you_mean
from tmca.text_files import read_text

A = TypeVar("A", bound="Attributes")
_NAME = 80
"""Characters of the name of an entry in a message."""
REMEDY = "take an unchanged copy, or correct it"
EXPECTED = {
    "missing": "it",
    "greater_than": "a number above {gt}",
    "greater_than_equal": "{ge} or more",
    "less_than": "a number below {lt}",
    "less_than_equal": "at most {le}",
    "too_long": "at most {max_length} values",
    "too_short": "at least {min_length} values",
    "int": "a whole number",
    "float": "a number",
    "string_type": "a text",
    "bool_type": "true or false",
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": "names with values",
    "model_type": "names with values",
    "json_invalid": "JSON",
    "json_type": "JSON",
    "finite_number": "a finite number",
    "dataclass_type": "names with values",
    "extra_forbidden": "no such name",
    "unexpected_keyword_argument": "no such name",
}
"""Type of a validation error, or its first part → what is expected."""


def finite(value: Any) -> Any:
    """JSON as it is.

    Raises:
        ValueError: there is a number in it that is not finite.
    """
    if isinstance(value, float) and not isfinite(value):
        raise ValueError("finite numbers")
    for part in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        finite(part)
    return value


FiniteJson = Annotated[JsonValue, AfterValidator(finite)]
"""Any JSON without NaN and infinity."""
NamedJson = dict[str, FiniteJson]
"""Names with such values."""


def _beside(name: str) -> str:
    if name in (".", "..") or "/" in name or "\\" in name or "\0" in name:
        raise ValueError("the name of a file beside it: copy it there")
    return name


def _inside(path: str) -> str:
    parts = path.split("/")
    if not all(parts) or {".", ".."} & set(parts) or "\\" in path or ":" in path or "\0" in path:
        raise ValueError("a path inside its folder")
    return path


Beside = Annotated[str, AfterValidator(_beside)]
"""Name of another file in the same folder, and no way to another one."""
Inside = Annotated[str, AfterValidator(_inside)]
"""Path of another file in the same folder or in those within it."""
STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
"""Of a data class that files state whole: its types, finite, and no other names."""


class Attributes(BaseModel):
    """Names and types of what a file says of itself, strict and finite; other names are left alone.

    A text that holds JSON is a field of type ``pydantic.Json[...]``.
    """

    model_config = ConfigDict(
        extra="ignore", frozen=True, strict=True, allow_inf_nan=False, protected_namespaces=(), populate_by_name=True
    )


class OpenAttributes(Attributes, extra="allow"):
    """Attributes beside which others are kept as they are, finite too."""

    __pydantic_extra__: NamedJson


def attributes_of(kind: type[A], attrs: Mapping[Any, Any], where: object, what: str = "attribute") -> A:
    """Attributes of a file as its model.

    Args:
        kind: the model.
        attrs: as xarray or h5py give them, or parsed JSON.
        where: the file, for the message.
        what: what its names are called there.

    Raises:
        DataError: the first one that is missing or is not as its model says.
    """
    names = {field.alias or name for name, field in kind.model_fields.items()}
    stated = {name: value for name, value in attrs.items() if name in names}
    try:
        return kind.model_validate_json(to_json(stated, fallback=_plain, inf_nan_mode="constants"))
    except (ValidationError, ValueError) as error:
        raise _data_error(error, where, what) from None


def _plain(value: Any) -> Any:
    """Python's values of numpy's, and a text of what JSON does not know."""
    return value.tolist() if hasattr(value, "tolist") else repr(value)


def json_of(text: str | bytes, where: object, kind: Any = FiniteJson) -> Any:
    """What JSON says.

    Args:
        text: the JSON.
        where: the file, for the message.
        kind: its type: a model, or any type that pydantic knows.

    Raises:
        DataError: no JSON, a number that is not finite, or other than the type.
    """
    try:
        return TypeAdapter(kind).validate_json(text)
    except ValidationError as error:
        raise _data_error(error, where, "entry") from None


def read_json(
    path: str | Path, kind: Any = FiniteJson, expected: str = "a JSON file", missing: str = "check the path"
) -> Any:
    """What a JSON file says.

    Args:
        path: the file.
        kind: its type: a model, or any type that pydantic knows.
        expected: what it should hold, for the message.
        missing: what to do where there is none.

    Raises:
        DataError: no such file, above 64 MB, no JSON, a number that is not finite, or other than the type.
    """
    return json_of(read_text(path, expected, missing=missing), path, kind)


def _data_error(error: ValueError, where: object, what: str) -> DataError:
    """The first thing that is wrong."""
    if not isinstance(error, ValidationError):
        return DataError(where, f"an {what} that is no text ({error})", "texts and numbers", REMEDY)
    first = error.errors(include_url=False)[0]
    name = ".".join(str(part) for part in first["loc"])[:_NAME]
    if first["type"] == "missing":
        return DataError(where, f"no {what} {name}", "it", REMEDY)
    raised = first.get("ctx", {}).get("error")
    if isinstance(raised, TmcaError):
        return DataError(where, f"{what} {name}: {raised.where} {raised.found}", raised.expected, REMEDY)
    found = f"{what} {name} = {described(first['input'])}" if name else _syntax(first)
    return DataError(where, found, expected_of(first), REMEDY)


def unknown_name(error: ValidationError, kind: type[BaseModel]) -> tuple[str, str, str, str] | None:
    """Of a name that there is not: its dotted place, what was found, the names that there are, and the nearest of them.

    None where nothing of that kind is wrong. It comes before all else, as it may be one that is missing, misspelt.

    Args:
        error: of a description that somebody wrote.
        kind: its model.
    """
    places = [one["loc"] for one in error.errors() if one["type"] == "extra_forbidden"]
    if not places:
        return None
    *outer, name = map(str, places[0])
    inner: type[BaseModel] | None = kind
    for part in outer:
        if inner is not None and part in inner.model_fields:  # else a key or the number of an entry
            inner = _model_in(inner.model_fields[part].annotation)
    known = [] if inner is None else list(inner.model_fields)
    expected = f"one of {', '.join(known)}" if known else "one that there is"
    return ".".join((*outer, name)), "an unknown name", expected, did_you_mean(name, known)


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """The model that a field holds, alone or in a list, a dictionary or beside None; None without any."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((model for one in get_args(annotation) if (model := _model_in(one))), None)


def _syntax(error: ErrorDetails) -> str:
    if error["type"] != "json_invalid":
        return described(error["input"])
    return f"no readable JSON ({error['msg'].removeprefix('Invalid JSON: ')})"


def expected_of(error: ErrorDetails) -> str:
    """What a validation error asks for, in the words of the package's other messages."""
    words = EXPECTED.get(error["type"]) or EXPECTED.get(error["type"].partition("_")[0])
    if words:
        return words.format(**error.get("ctx", {}))
    said = error["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
    return said.partition(", unable")[0]
