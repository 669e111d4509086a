"""Settings of a driver, as the signature of what makes it says: names, types, and which are needed."""

from __future__ import annotations

from collections.abc import Mapping
from inspect import Parameter, signature
from typing import Any, get_type_hints

from pydantic import ConfigDict, PydanticSchemaGenerationError, TypeAdapter, ValidationError

from tmca.arguments import in_words
from tmca.errors import SettingError, did_you_mean


def read_settings(factory: Any, given: Mapping[str, Any], device: str) -> dict[str, Any]:
    """Settings as a driver takes them: a text becomes a value of the type that the driver annotates.

    Raises:
        SettingError: one that the driver does not have, that it needs and lacks, or that is of another type.
    """
    parameters, types = _parameters(factory), _types(factory)
    if parameters is None:
        return dict(given)
    for name in given:
        if name not in parameters:
            found, known = "a setting that this device does not have", said_settings(factory, device)
            raise SettingError(f"--set {name}", found, _names(parameters), did_you_mean(name, parameters, known))
    for name, parameter in parameters.items():
        if parameter.default is parameter.empty and name not in given:
            expected = f"{name}, which this device needs"
            raise SettingError(
                f"--set {name}", "none", expected, f"pass --set {name}=…; {said_settings(factory, device)}"
            )
    return {name: _value(name, value, types.get(name, str), factory, device) for name, value in given.items()}


def said_settings(factory: Any, device: str) -> str:
    """The settings that there are, with types and defaults, in a few words."""
    parameters, types = _parameters(factory), _types(factory)
    if not parameters:
        return f"{device} says of no setting" if parameters is None else f"{device} has no settings"
    said = []
    for name, one in parameters.items():
        words = in_words(types.get(name, str)).replace("a name", "a text")
        said.append(f"{name} ({words}{'' if one.default is one.empty else f', {one.default!r} without'})")
    return f"{device} has {', '.join(said)}"


def _names(parameters: Mapping[str, Parameter]) -> str:
    return f"one of {', '.join(parameters)}" if parameters else "none"


def _parameters(factory: Any) -> dict[str, Parameter] | None:
    """Parameters that can be named; None of a factory that takes any, or does not say which."""
    try:
        parameters = signature(factory).parameters
    except (TypeError, ValueError):
        return None
    several = (Parameter.VAR_POSITIONAL, Parameter.VAR_KEYWORD)
    if any(one.kind is Parameter.VAR_KEYWORD for one in parameters.values()):
        return None
    return {name: one for name, one in parameters.items() if one.kind not in several}


def _types(factory: Any) -> dict[str, Any]:
    """Annotations of a factory; none of one whose annotations cannot be looked up."""
    try:
        return get_type_hints(vars(factory).get("__init__", factory) if isinstance(factory, type) else factory)
    except (NameError, TypeError, AttributeError):
        return {}


def _value(name: str, value: Any, kind: Any, factory: Any, device: str) -> Any:
    """A text as a value of a type; what is no text, and texts for types that know none, stay."""
    if not isinstance(value, str) or kind is str:
        return value
    try:
        return TypeAdapter[Any](kind, config=ConfigDict(arbitrary_types_allowed=True)).validate_strings(value)
    except PydanticSchemaGenerationError:
        return value
    except ValidationError:
        raise SettingError(f"--set {name}", repr(value), in_words(kind), said_settings(factory, device)) from None
