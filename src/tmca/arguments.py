"""Arguments as their annotations say: what a public call takes is declared once, in its signature.

So are the parts of which cameras are made anew, and the settings of decoders, fields of a data class.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from functools import partial, wraps
from inspect import Parameter, Signature, getdoc, signature
from pathlib import Path
from types import NoneType, SimpleNamespace, UnionType
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar, Union, get_args, get_origin, get_type_hints

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, Strict, TypeAdapter, ValidationError

from tmca.errors import SettingError, ShapeError, check_choice, did_you_mean

T = TypeVar("T")
_LONGEST, _REASON = 60, 200
_SIMPLE = {
    "str": "a name", "bool": "True or False", "int": "a whole number", "float": "a number", "Path": "a path",
    "Sequence": "a list", "Mapping": "names with values",
}  # fmt: skip
"""Python's types in words."""


def plain(value: Any) -> Any:
    """Python's numbers, or lists of them, of what numpy, torch and xarray hold; other values as they are."""
    return value.__array__().tolist() if hasattr(value, "__array__") and not isinstance(value, type) else value


def _one(value: Any) -> Any:
    """A text as a list of one."""
    return [value] if isinstance(value, str) else value


_Plain = BeforeValidator(plain)
Int = Annotated[int, Strict(), _Plain, "a whole number"]
Float = Annotated[float, Strict(), _Plain, "a number"]
Count = Annotated[int, Strict(), Field(ge=1), _Plain, "a whole number, 1 or more"]
Share = Annotated[float, Strict(), Field(ge=0, le=1), _Plain, "a number, 0 to 1"]
Seed = Annotated[int, Strict(), Field(ge=0, lt=2**30), _Plain, "a whole number, 0 or more and below 2^30"]
Ints = Annotated[Sequence[Int], _Plain, AfterValidator(tuple), "whole numbers"]
Floats = Annotated[Sequence[Float], _Plain, AfterValidator(tuple), "a list of numbers"]
Pair = Annotated[tuple[Float, Float], _Plain, "two numbers"]
IntPair = Annotated[tuple[Int, Int], _Plain, "two whole numbers"]
Size = Annotated[tuple[Count, Count], _Plain, "two whole numbers, 1 or more each"]
Kind = Annotated[str, "the kind of a camera, such as its .kind"]
Names = Annotated[Sequence[str], BeforeValidator(_one), AfterValidator(tuple), "a name or a list of names"]
"""Types of arguments: numbers are those of numpy and torch too, but no texts and no True; the text is for errors."""


def checked(called: T) -> T:
    """A function, or a class with a constructor, that takes its arguments as their annotations say.

    Arguments without an annotation are not looked at. What is converted is said by the types of this module; classes
    have to be what they are. Annotations are resolved at the first call: they may name what is defined below.

    Raises, when called:
        SettingError: the first argument that is none of its type, or an unknown one; ``where`` is its name.
    """
    if isinstance(called, type):
        called.__init__ = checked(called.__init__)  # type: ignore[misc]
        return called
    function: Any = called
    takes, types = signature(function), dict[str, tuple[TypeAdapter[Any], str]]()

    @wraps(function)
    def checking(*given: Any, **named: Any) -> Any:
        try:
            bound = takes.bind(*given, **named)
        except TypeError:
            _refuse_unknown(takes, named)
            return function(*given, **named)  # raises as Python does: one is missing, or too many
        if not types:
            types.update(_types(function, takes))
        for name, value in bound.arguments.items():
            if name in types:
                bound.arguments[name] = _taken(takes.parameters[name], value, types[name])
        return function(*bound.args, **bound.kwargs)

    return checking  # type: ignore[return-value]


def _refuse_unknown(takes: Signature, named: Mapping[str, Any]) -> None:
    known = [name for name in takes.parameters if name != "self"]
    for name in named:
        if name not in known:
            raise SettingError(name, "an unknown name", f"one of {', '.join(known)}", "leave it out")


def _types(function: Any, takes: Signature) -> dict[str, tuple[TypeAdapter[Any], str]]:
    """What arguments are checked by, and what they should be in words."""
    several = (Parameter.VAR_POSITIONAL, Parameter.VAR_KEYWORD)
    single = {name for name, parameter in takes.parameters.items() if parameter.kind not in several}
    annotated = {name: hint for name, hint in function.__annotations__.items() if name in single}
    names = vars(sys.modules[function.__module__])
    hints = get_type_hints(SimpleNamespace(__annotations__=annotated), names, include_extras=True)
    config = ConfigDict(arbitrary_types_allowed=True)
    return {name: (TypeAdapter(_instances(hint), config=config), in_words(hint)) for name, hint in hints.items()}


def _instances(hint: Any) -> Any:
    """A type whose data classes have to be given as such: pydantic would make them of mappings."""
    if get_origin(hint) in (Union, UnionType):
        return Union[tuple(map(_instances, get_args(hint)))]  # noqa: UP007
    if isinstance(hint, type) and is_dataclass(hint):
        return Annotated[Any, AfterValidator(partial(_instance, hint))]
    return hint


def _instance(kind: type, value: Any) -> Any:
    if not isinstance(value, kind):
        raise ValueError(kind.__name__)
    return value


def _taken(parameter: Parameter, value: Any, wanted: tuple[TypeAdapter[Any], str]) -> Any:
    if value is parameter.default:
        return value
    try:
        return wanted[0].validate_python(value)
    except ValidationError:
        remedy = "" if parameter.default is Parameter.empty else "leave it out for the default"
        raise SettingError(parameter.name, described(value), wanted[1], remedy) from None


def in_words(hint: Any) -> str:
    """A type in a few words."""
    if get_origin(hint) is Annotated:
        return next((words for words in hint.__metadata__ if isinstance(words, str)), in_words(hint.__origin__))
    if get_origin(hint) in (Union, UnionType):
        return ", or ".join(in_words(part) for part in get_args(hint) if part is not NoneType)
    if isinstance(hint, TypeVar):
        return in_words(hint.__bound__)
    if get_origin(hint) is Literal:
        return ", or ".join(map(repr, get_args(hint)))
    name = str(getattr(hint, "__name__", hint))
    return _SIMPLE.get(name) or _a(name)


def _a(name: str) -> str:
    return f"{'an' if name[0] in 'AEIOU' else 'a'} {name}"


def described(value: Any) -> str:
    """A value in a few words, for errors."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if not isinstance(value, str | int | float | list | tuple | dict | None):
        return _a(type(value).__name__)
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def path_of(where: str, value: Any) -> Path:
    """The path that an argument names; SettingError for what is none."""
    if not isinstance(value, str | Path) or "\0" in str(value):
        raise SettingError(where, described(value), "a path")
    return Path(value)


def reason(error: BaseException) -> str:
    """What an error of a library says, cut where it goes on."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= _REASON else f"{text[:_REASON]}…"


class FromArguments:
    """A camera that knows the arguments of its constructor, and makes others of them: of presets, and of other parts.

    ``_given`` are those that it was made of.
    """

    kind: ClassVar[str]
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {}  # arguments of the constructor
    drawn: ClassVar[Mapping[str, tuple[str, ...]]] = {}  # arguments that only families of some parts have
    unbound: frozenset[str]  # arguments that a scene gives where they are left out
    _given: dict[str, Any]

    def __new__(cls, *arguments: Any, **named: Any) -> Self:
        camera = super().__new__(cls)
        camera._given = {**dict(zip(cls._arguments(), arguments, strict=False)), **named}
        return camera

    @classmethod
    def from_preset(cls, name: str, **changes: Any) -> Self:
        """A named camera of ``presets``; ``changes`` replace its arguments."""
        return cls(**{**cls.preset(name), **changes})

    @classmethod
    def preset(cls, name: str) -> dict[str, Any]:
        """Arguments of a named camera of ``presets``."""
        check_choice("preset", name, cls.presets)
        return dict(cls.presets[name])

    def replace(self, **parts: Any) -> Self:
        """The camera with other parts: arguments of its constructor, modules among them. The first stays as it is.

        What the parts do not describe anew (codes, sensor, response) is shared.

        Raises:
            SettingError, ShapeError: no part of it, one that does not fit the others, or one that would change nothing:
                the seed of codes that came from a file.
        """
        self._check_parts(parts)
        try:
            return self._with(parts)
        except (SettingError, ShapeError) as error:
            if error.where in parts or error.where not in self._arguments():
                raise
            raise type(error)(error.where, error.found, error.expected, f"replace {error.where} too") from error

    def _check_parts(self, parts: Mapping[str, Any]) -> None:
        described = self._described(parts)
        for name in parts:
            if name not in self._arguments():
                raise SettingError(name, "a part", f"one of {', '.join(self._arguments())}, for a {self.kind} camera")
            families = self.drawn.get(name, ())
            if families and not any(isinstance(described.get(part, ""), str) for part in families):
                found = f"{parts[name]} for {' and '.join(families)} that are given, not drawn"
                raise SettingError(name, found, "a named family", f"replace {' or '.join(families)} too")

    def _described(self, parts: Mapping[str, Any]) -> dict[str, Any]:
        """What a camera with other parts is made of."""
        return {**self._given, **parts}

    def _outdated(self, parts: Mapping[str, Any]) -> set[str]:
        """Arguments that mean nothing beside other parts."""
        return set()

    def _with(self, parts: Mapping[str, Any]) -> Self:
        shared = {name: part for name, part in self._shared(set(parts)).items() if name not in parts}
        given = {name: part for name, part in self._given.items() if name not in self._outdated(parts)}
        camera = type(self)(**{**given, **shared, **parts})
        described = {name: part for name, part in self._given.items() if name in shared}
        camera._given = {**{n: part for n, part in camera._given.items() if n not in shared}, **described}
        return camera

    def bound_to(self, **parts: Any) -> Self:
        """The camera with what its constructor left out (``unbound``: size, bands, views) taken from ``parts``."""
        missing = {name: value for name, value in parts.items() if name in self.unbound}
        return self._with(missing) if missing else self

    @classmethod
    def _arguments(cls) -> tuple[str, ...]:
        """Names of the arguments of the constructor."""
        return tuple(signature(cls.__init__).parameters)[1:]

    def _shared(self, parts: set[str]) -> dict[str, Any]:
        """Arguments that a camera with other parts takes over as they are now, not as they were given."""
        return {}


@dataclass(frozen=True)
class Setting:
    """A setting of a decoder, as commands and documents show it."""

    name: str
    type: str
    default: Any
    help: str


def settings_of(decoder: type[Any]) -> list[Setting]:
    """The fields of a decoder that its constructor takes, with what its docstring's ``Args`` say of them."""
    texts, taken = _helps(getdoc(decoder) or ""), [f for f in fields(decoder) if f.init]
    defaults = {f.name: f.default if f.default_factory is MISSING else f.default_factory() for f in taken}
    return [
        Setting(f.name, getattr(f.type, "__name__", str(f.type)), defaults[f.name], texts.get(f.name, ""))
        for f in taken
    ]


def setting_names(decoder: type[Any]) -> set[str]:
    """Names of the settings of a decoder."""
    return {setting.name for setting in settings_of(decoder)}


def _helps(text: str) -> dict[str, str]:
    """Name → help of the section ``Args:`` of a docstring."""
    section = re.search(r"^Args:\n((?:    .*\n?|\n)+)", text, re.MULTILINE)
    entries = re.findall(r"^    (\w+): ((?:.*\n?)(?:^        .*\n?)*)", section[1] if section else "", re.MULTILINE)
    return {name: " ".join(words.split()) for name, words in entries}


def checked_settings(decoder: type[Any], given: Mapping[str, Any], *, texts: bool = False) -> dict[str, Any]:
    """Settings of a decoder, each a value of its type.

    Args:
        decoder: a subclass of ``Decoder``.
        given: values by name; ``{"tv_weight": "0.01"}`` where they are ``texts``.
        texts: whether the values are read from words.

    Raises:
        SettingError: a setting that the decoder does not have, or a value of another type.
    """
    settings, types = {setting.name: setting for setting in settings_of(decoder)}, get_type_hints(decoder)
    checked: dict[str, Any] = {}
    for name, value in given.items():
        if name not in settings:
            found = f"a setting of {decoder.name}" if value is None else f"{value} for {decoder.name}"
            remedy = "put @dataclass above its class" if name in vars(decoder) else "leave it out"
            expected = f"one of {', '.join(settings)}" if settings else "no settings"
            raise SettingError(name, found, expected, did_you_mean(name, settings, remedy))
        adapter = TypeAdapter[Any](types[name], config=ConfigDict(arbitrary_types_allowed=True))
        try:
            checked[name] = adapter.validate_strings(value) if texts else adapter.validate_python(value)
        except ValidationError:
            raise SettingError(name, repr(value), in_words(types[name])) from None
        if not texts and isinstance(value, str) and isinstance(checked[name], int | float):
            raise SettingError(name, repr(value), in_words(types[name]), "give a number, not a text")
    return checked


class WithSettings:
    """A decoder, whose settings are checked before its ``__post_init__`` looks at them."""

    def __new__(cls, *given: Any, **named: Any) -> Self:
        names = tuple(signature(cls.__init__).parameters)[1:]
        _changed(cls, {**dict(zip(names, given, strict=False)), **named})
        return super().__new__(cls)

    def _checked(self) -> Self:
        """The decoder, every setting that is not its default being a value of its type; SettingError otherwise."""
        given = {setting.name: getattr(self, setting.name) for setting in settings_of(type(self))}
        changed = _changed(type(self), given)
        converted = {name: value for name, value in changed.items() if type(value) is not type(given[name])}
        return replace(self, **converted) if converted else self  # type: ignore[type-var]


def _changed(decoder: type[Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Settings that are not their defaults, each a value of its type."""
    defaults = {setting.name: setting.default for setting in settings_of(decoder)}
    changed = {name: value for name, value in given.items() if name in defaults and value is not defaults[name]}
    return checked_settings(decoder, changed) if changed else {}
