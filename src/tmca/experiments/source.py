"""The source that a table's numbers come from: its digest names the cells, so that other code makes other cells."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import tmca

_ROOT = Path(tmca.__file__).parent
_NO_NUMBERS = ("figures", "pictures", "corner", "demo", "report", "tables")


@cache
def source_digest(*modules: str) -> str:
    """Digest of modules and of all of this package that they import, directly or not, all but commands and pictures.

    A change of what they do not use leaves the digest, and so the finished cells, as they are.

    Args:
        modules: full names, such as ``__name__`` of the caller.
    """
    digest = hashlib.sha256()
    for name in sorted(set().union(*map(imported, modules))):
        digest.update(name.encode() + b"\0" + _file(name).read_bytes())
    return digest.hexdigest()[:20]


def imported(module: str) -> set[str]:
    """A module and the modules of this package that its numbers come from.

    What a package only hands on (``from tmca.cameras import SpectralCamera``) is followed to the module that defines
    it; the neighbours that the package hands on as well are none of the source.
    """
    found: set[str] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name not in found and not (name.endswith(_NO_NUMBERS) or name.startswith("tmca.plots")):
            found.add(name)
            waiting += [definer for source, part in _imports(name) if (definer := _definer(source, part))]
    return found


@cache
def _imports(module: str) -> tuple[tuple[str, str], ...]:
    """(module, name) of everything that a module of this package imports from it, inside functions too."""
    return tuple(_imports_of(ast.parse(_file(module).read_text(encoding="utf-8"))))


def _imports_of(tree: ast.AST) -> Iterator[tuple[str, str]]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            continue  # names of types do nothing
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "tmca":
            yield from ((node.module, alias.name) for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names if alias.name.startswith("tmca."))
        yield from _imports_of(node)


def _definer(module: str, name: str) -> str:
    """The module that a name imported from another one comes from; empty for the bare package itself."""
    if name and _exists(f"{module}.{name}"):
        return f"{module}.{name}"
    for source, part in _imports(module) if _file(module).name == "__init__.py" else ():
        if part == name:
            return _definer(source, part)
    return "" if module == "tmca" else module


def _exists(module: str) -> bool:
    return _file(module).exists()


def _file(module: str) -> Path:
    place = _ROOT.joinpath(*module.split(".")[1:])
    return place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
