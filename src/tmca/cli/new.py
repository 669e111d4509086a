"""``tmca new``: a camera, a decoder, a format or a driver of one's own to start from, with its test."""

from __future__ import annotations

import re
from contextlib import ExitStack
from importlib.resources import files
from importlib.util import find_spec
from keyword import iskeyword
from pathlib import Path
from shlex import quote
from string import Template
from sys import stdlib_module_names
from typing import Literal, NamedTuple

from tmca.cli.options.output import Overwrite
from tmca.errors import SettingError

Part = Literal["camera", "decoder", "format", "driver"]
_GROUPS = {"camera": "tmca.cameras", "decoder": "tmca.decoders", "format": "tmca.formats", "driver": "tmca.devices"}
"""Entry points that make a part known."""


class PartNames(NamedTuple):
    """What a part is called: on the command line, as a module, as a class, and in tables."""

    name: str
    module: str
    Class: str
    label: str


def new(part: Part, name: str, /, *, out: Path = Path(), overwrite: Overwrite = False) -> None:
    """Write a file of a camera, a decoder, a format or a driver that works, for you to change, and its test.

    Args:
        part: camera, decoder, format (of files with scenes) or driver.
        name: what the command line will call it, such as my-camera; of a format its suffix.
        out: folder to write into, made where there is none; the current one without.
    """
    from tmca.data import atomic_path, check_target

    named = names_of(name)
    _check_free(part, named)
    texts = rendered(part, named)
    targets = {out / file: text for file, text in texts.items()}
    if not out.exists():
        out.mkdir(parents=True)
    for target in targets:
        check_target(target, overwrite)
    with ExitStack() as opened:  # neither, unless both can be written
        for target, text in targets.items():
            opened.enter_context(atomic_path(target, overwrite=overwrite)).write_text(text, encoding="utf-8")
    print(_next_steps(part, named, out))


def names_of(text: str) -> PartNames:
    """What a part of a name is called.

    Raises:
        SettingError: no name of words, or one that Python or a package that is installed has.
    """
    name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", text).lower().replace("_", "-")
    if not re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", name):
        raise SettingError("NAME", repr(text), "letters and digits, such as my-camera")
    module, words = name.replace("-", "_"), name.split("-")
    if iskeyword(module) or _is_installed(module):
        raise SettingError("NAME", f"{text}, a name that Python or a package has", "a name of its own")
    return PartNames(name, module, "".join(word.capitalize() for word in words), " ".join(words))


def _is_installed(module: str) -> bool:
    """Whether Python or a package has a module of a name; one that lies in a folder of one's own is none."""
    if module in {*stdlib_module_names, "tmca"}:
        return True
    spec = find_spec(module)
    return spec is not None and "site-packages" in str(spec.origin)


def rendered(part: Part, named: PartNames) -> dict[str, str]:
    """Name of a file → its text: of the part, and of its test.

    Raises:
        SettingError: a name that the class of the part would hide.
    """
    names, folder = named._asdict(), files("tmca.cli") / "templates"
    sources = {
        f"{prefix}{named.module}.py": (folder / f"{prefix}{part}.py.in").read_text("utf-8") for prefix in ("", "test_")
    }
    if any(re.search(rf"(?<![$\w]){named.Class}\b", source) for source in sources.values()):
        raise SettingError("NAME", f"{named.name}, whose class {named.Class} is used already", "another name")
    return {file: Template(source).substitute(names) for file, source in sources.items()}


def _check_free(part: Part, named: PartNames) -> None:
    """Raises SettingError for a name that a camera, a decoder or a driver has, or for a suffix that is read."""
    from tmca.cameras import CAMERAS, load_cameras
    from tmca.data.formats.stored import OPENERS
    from tmca.decoders import decoders
    from tmca.lab.acquisition.drivers import device_drivers

    load_cameras()
    suffixes = [suffix.removeprefix(".") for suffix in OPENERS]
    known = {"camera": CAMERAS, "decoder": decoders(), "format": suffixes, "driver": device_drivers()}[part]
    if named.name in known:
        raise SettingError("NAME", f"{named.name}, a {part} that there is", f"none of {', '.join(known)}")


def _next_steps(part: Part, named: PartNames, out: Path) -> str:
    """What was written, how it is tested, tried and made known."""
    file, test = out / f"{named.module}.py", out / f"test_{named.module}.py"
    package = f"{out.name}." if out.name.isidentifier() else ""
    place = f"{package}{named.module}" + (f":{named.Class}" if part in ("decoder", "driver") else "")
    lines = [f"{file}: a {part} that works; change it", f"{test}: test it with: python -m pytest {quote(str(test))}"]
    if find_spec("pytest") is None:
        lines.append("pytest is not installed yet: pip install pytest")
    return "\n".join([
        *lines, f"try it with: {_trial(part, named, out)}",
        "every command knows it once your package is installed, with this in its pyproject.toml:",
        f'  [project.entry-points."{_GROUPS[part]}"]', f'  {named.name} = "{place}"',
    ])  # fmt: skip


def _trial(part: Part, named: PartNames, out: Path) -> str:
    """The command that tries a part."""
    by_file = quote(f"{out / f'{named.module}.py'}:{named.Class}")
    if part == "decoder":
        return f"tmca reconstruct SNAPSHOT.nc --decoder {by_file}"
    if part == "driver":
        return f"tmca capture EXPORT --device {by_file}"
    code = f'import tmca, {named.module}; print(tmca.read("FILE.{named.name}"))'
    if part == "camera":
        code = f'import tmca, {named.module} as my; tmca.simulate("coffee", my.{named.Class}()).save("s.nc")'
    there = "" if out == Path() else f"cd {quote(str(out))} && "
    return f"{there}python -c '{code}'"
