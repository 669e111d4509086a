"""What a camera is made of: named presets, and other cameras of the same parts."""

from __future__ import annotations

from collections.abc import Mapping
from inspect import signature
from typing import Any, ClassVar, Self

from tmca.errors import SettingError, ShapeError, check_choice


class CameraParts:
    """A camera that knows the arguments of its constructor, and makes others of them."""

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
