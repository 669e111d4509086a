"""Classes of other packages: those named in entry points, which register themselves once imported, and their source."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection
from functools import cache
from hashlib import sha256
from importlib.metadata import EntryPoint, entry_points, packages_distributions, version
from pathlib import Path
from typing import Any
from warnings import warn

from tmca.errors import SettingError

Class = type[Any]
_REFUSED: list[dict[Class, str]] = []
"""Classes that were refused while entry points are loaded, and what is said of them; the innermost group last."""
_LEFT_OUT = "of another package, left out:"


class BrokenPlugin(UserWarning):
    """A camera, prior or decoder of another package that cannot be loaded, or is of no use."""


@cache
def load_plugins(group: str, registered: Callable[[], Collection[Class]], wanted: str) -> None:
    """Import, once, what other packages name in an entry-point group; what fails is warned of and left out.

    Args:
        group: such as ``tmca.decoders``.
        registered: the classes that there are.
        wanted: what an entry point has to name.
    """
    what, refused = group.removeprefix("tmca.").removesuffix("s"), dict[Class, str]()
    _REFUSED.append(refused)
    try:
        reasons = [_trouble(point, registered, refused, wanted) for point in entry_points(group=group)]
    finally:
        _REFUSED.pop()
    for said in (*(f"{what} {_LEFT_OUT} {reason}" for reason in reasons if reason), *refused.values()):
        warn(said, BrokenPlugin, stacklevel=2)


def _trouble(
    point: EntryPoint, registered: Callable[[], Collection[Class]], refused: Collection[Class], wanted: str
) -> str:
    """Why an entry point brings nothing; empty if it does, or if its class is among those that were refused."""
    said, before = f"{point.name} ({point.value})", len(registered())
    try:
        loaded = point.load()
    except (Exception, SystemExit) as error:
        return f"{said} cannot be loaded: {type(error).__name__}: {error}"
    known = [*registered(), *refused]
    if isinstance(loaded, type):
        brings = loaded in known
    else:  # a module, which somebody may have imported before
        own = getattr(loaded, "__name__", "")
        brings = len(registered()) > before or any(f"{one.__module__}.".startswith(f"{own}.") for one in known)
    return "" if brings else f"{said} registers nothing; name {wanted}"


def take(cls: Class, register: Callable[[Class], None], what: str) -> None:
    """Register a class, ``what`` ("decoder", …), as it is defined. One that is refused does not keep the others of its
    module out while entry points are loaded: it is warned of afterwards.

    Raises:
        SettingError: what the registry refuses, at any other time.
    """
    try:
        register(cls)
    except SettingError as error:
        if not _REFUSED:
            raise
        _REFUSED[-1][cls] = f"{what} {_LEFT_OUT} {error}"


def source_digest(place: Path) -> str:
    """Digest of a source file, or of all those of a folder."""
    digest = sha256()
    for file in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
        digest.update(file.relative_to(place).as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


@cache
def foreign_source(cls: Class) -> str:
    """What tells that a class of another package has changed: a digest of the package's source, and of that of other
    packages whose classes it extends; empty for a class of this package.

    Where there is no source it is the version of the distribution.
    """
    extended = [one for one in cls.__mro__ if any(_top(base) == "tmca" for base in one.__mro__)]
    names = dict.fromkeys(map(_top, extended or [cls]))
    return " ".join(_source(name) for name in names if name != "tmca")


def _top(cls: Class) -> str:
    """Name of the package, or of the module, that a class is in."""
    return cls.__module__.partition(".")[0]


def _source(name: str) -> str:
    """Digest of the source of a package or a module, else its version."""
    module = sys.modules.get(name)
    places = getattr(module, "__path__", None) or [getattr(module, "__file__", None)]
    there = [Path(place) for place in places if place and Path(place).exists()]
    if any(place.is_file() or next(place.rglob("*.py"), None) for place in there):
        return " ".join(map(source_digest, there))
    return " ".join(version(distribution) for distribution in packages_distributions().get(name, ()))
