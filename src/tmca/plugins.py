"""Classes of other packages: those named in entry points, which register themselves once imported, those of a file that
is named with them, and their source."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from hashlib import sha256
from importlib.metadata import EntryPoint, entry_points, packages_distributions, version
from importlib.util import cache_from_source, module_from_spec, spec_from_file_location
from inspect import isabstract
from pathlib import Path
from traceback import extract_tb, walk_tb
from types import ModuleType
from typing import Any
from warnings import warn

from tmca.errors import SettingError, TmcaError, did_you_mean, one_line

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


def names_a_file(text: str) -> bool:
    """Whether a text names a class of a file, ``FILE.py:Class``, and not one that is registered."""
    return text.rpartition(":")[0].endswith(".py")


def class_from_file(text: str, base: type, name: str) -> Class:
    """A class of a Python file. This runs the file: call it with what somebody typed, never with what was read.

    The file can import modules that lie beside it. It runs once, and again after it was edited.

    Args:
        text: ``FILE.py:Class``.
        base: what the class has to be a subclass of; ``object`` for any class.
        name: the option or the argument that the text was given to, for errors.

    Raises:
        SettingError: another form, no such file, a file that cannot be run, no such class in it, or one that is no
            subclass of ``base`` or lacks methods of it.
    """
    place, _, wanted = text.rpartition(":")
    if not (names_a_file(text) and wanted.isidentifier()):
        raise SettingError(name, repr(text), "FILE.py:Class")
    path = Path(place).expanduser()
    if not path.is_file():
        raise SettingError(name, f"{path}, which is no file", "a Python file", "see to its folder and its spelling")
    module = _run_file(path.resolve(), name)
    cls = getattr(module, wanted, None)
    if not (isinstance(cls, type) and issubclass(cls, base)):
        there = [one for one, value in vars(module).items() if _defined(value, module, base)]
        found = f"no class {wanted} in {path}" if cls is None else f"{text}, which is no {base.__name__}"
        expected = f"a subclass of {base.__name__}" if base is not object else "a class"
        expected += f": {', '.join(there)}" if there else ""
        raise SettingError(name, found, expected, did_you_mean(wanted, there))
    check_whole(cls, base, name, text)
    return cls


def check_whole(cls: Class, base: type, where: str, called: str) -> None:
    """Raises SettingError for a class that lacks methods of its base, which are named."""
    if isabstract(cls):
        lacks = ", ".join(sorted(getattr(cls, "__abstractmethods__", ())))
        raise SettingError(
            where, f"{called} without {lacks}", f"all that a {base.__name__} has", f"define {lacks} in it"
        )


def _defined(value: Any, module: ModuleType, base: type) -> bool:
    """Whether a value is a class that a module has defined, of the kind that is wanted."""
    return isinstance(value, type) and issubclass(value, base) and value.__module__ == module.__name__


_FROM_FILES: dict[str, tuple[str, ModuleType]] = {}
"""Modules of files that were run, by their name, with the digest of the sources that were run."""
_BESIDE: dict[str, list[Path]] = {}
"""Sources that such a module imported from its folder, by its name."""


def _run_file(path: Path, name: str) -> ModuleType:
    """The module of a file; what fails in it is a SettingError in one line that says where."""
    called = f"{path.stem}_{sha256(str(path).encode()).hexdigest()[:12]}"
    if called in _FROM_FILES and _FROM_FILES[called][0] == _digest_of_all([path, *_BESIDE[called]]):
        return _FROM_FILES[called][1]
    spec = spec_from_file_location(called, path)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    before, sys.modules[called] = sys.modules.get(called), module  # data classes look their module up
    Path(cache_from_source(str(path))).unlink(missing_ok=True)  # it may be of a source of the same size and second
    try:
        with _importing_beside(path) as beside:
            spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        sys.modules.pop(called)
        sys.modules.update({} if before is None else {called: before})
        said = f"{one_line(error)}{line_in(path, error)}"
        raise SettingError(name, f"{path}, which fails with {said}", "a file that runs", "mend it") from error
    _BESIDE[called] = beside
    _FROM_FILES[called] = _digest_of_all([path, *beside]), module
    return module


@contextmanager
def _importing_beside(path: Path) -> Iterator[list[Path]]:
    """Modules of the file's folder can be imported, after all others of their names; at the end their sources.

    Those that such files imported before are forgotten: another folder has its own of the same names.
    """
    others = {str(source) for sources in _BESIDE.values() for source in sources}
    for name in [name for name, module in sys.modules.items() if getattr(module, "__file__", None) in others]:
        del sys.modules[name]
    beside: list[Path] = []
    sys.path.append(str(path.parent))
    try:
        yield beside
    finally:
        sys.path.remove(str(path.parent))
        folder = str(path.parent)
        there = {top for top in {_top_of(name) for name in [*sys.modules]} if _lies_in(folder, top)}
        sources = [
            getattr(module, "__file__", None) for name, module in [*sys.modules.items()] if _top_of(name) in there
        ]
        beside += sorted({Path(source) for source in sources if isinstance(source, str)} - {path})


def _lies_in(folder: str, top: str) -> bool:
    """Whether a module or a package was found in a folder itself: what lies below, such as an environment, was not."""
    module = sys.modules.get(top)
    places = [*(getattr(module, "__path__", None) or ()), getattr(module, "__file__", None)]
    return top not in ("tmca", "__main__") and any(
        isinstance(place, str) and os.path.dirname(place) == folder for place in places
    )


def file_of(cls: Class) -> Path | None:
    """The file that a class was loaded from with ``FILE.py:Class``; None of any other class."""
    known = _FROM_FILES.get(cls.__module__)
    return None if known is None else Path(str(known[1].__file__))


@contextmanager
def failures_of(cls: Class, where: str, name: str, expected: str) -> Iterator[None]:
    """Within it, what a class of a file raises is one line that says where; what other classes raise stays.

    Args:
        cls: the class.
        where: the option or argument that it was given to.
        name: what the class is called.
        expected: what it should have brought.
    """
    try:
        yield
    except TmcaError:
        raise
    except Exception as error:
        path = file_of(cls)
        if path is None:
            raise
        found = f"{name} of {path}, which fails with {one_line(error)}{line_in(path, error)}"
        raise SettingError(where, found, expected, "mend it") from error


def foreign_failure(error: BaseException) -> SettingError | None:
    """What an error is where it comes through a package that entry points name, or through a file that was named: one
    line that says which line of it; None of all others."""
    points = [one for group in entry_points().groups if group.startswith("tmca.") for one in entry_points(group=group)]
    packages = {_top_of(point.module) for point in points} - {"tmca"}
    for frame, line in reversed([*walk_tb(error.__traceback__)]):
        module = str(frame.f_globals.get("__name__"))
        if module in _FROM_FILES or _top_of(module) in packages:
            found, remedy = f"{one_line(error)} (line {line})", "mend it; python -X dev -m tmca shows who called it"
            return SettingError(frame.f_code.co_filename, found, "code that runs", remedy)
    return None


def line_in(path: Path, error: BaseException) -> str:
    """The last line of a file that an error comes through, in brackets; empty where it is none of that file."""
    lines = [frame.lineno for frame in extract_tb(error.__traceback__) if Path(frame.filename) == path]
    return f" (line {lines[-1]})" if lines else ""


def _digest_of_all(files: Sequence[Path]) -> str:
    return " ".join(source_digest(file) for file in files if file.exists())


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
    extended = [one for one in cls.__mro__ if any(_top_of(base.__module__) == "tmca" for base in one.__mro__)]
    names = dict.fromkeys(_top_of(one.__module__) for one in extended or [cls])
    return " ".join(_source(name) for name in names if name != "tmca")


def _top_of(module: str) -> str:
    """Name of the package that a module is in, or its own."""
    return module.partition(".")[0]


def _source(name: str) -> str:
    """Digest of the source of a package or a module, else its version."""
    module = sys.modules.get(name)
    places = getattr(module, "__path__", None) or [getattr(module, "__file__", None)]
    there = [Path(place) for place in places if place and Path(place).exists()] + _BESIDE.get(name, [])
    if any(place.is_file() or next(place.rglob("*.py"), None) for place in there):
        return " ".join(map(source_digest, there))
    return " ".join(version(distribution) for distribution in packages_distributions().get(name, ()))
