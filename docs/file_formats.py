"""The page of file formats: a section for every kind of file, with tables made from small files."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from file_kinds import ATTRIBUTES, KINDS, Kind, Meanings
from tiny_files import write_decoder, write_study, write_tiny_files

INTRODUCTION = """# Files

This page says what is in every file that tmca writes, and how you open it with other software.
All tables are made from real files when this page is built.

Every variable says its meaning in the attribute `long_name`, and its unit in `units`: xarray and HDFView show them.
`tmca inspect FILE` prints what is in a file, and `tmca view FILE` shows it.
[Scenes](../data.md) says which other formats tmca reads.
Sizes in the tables are those of small examples.

- A NetCDF file (`.nc`) is an HDF5 file. `tmca.data.write_dataset` also writes `.h5`, which is the same, and `.zarr`.
- An attribute that NetCDF cannot hold, such as names with values, is text in JSON.
- Files are written whole or not at all. Nothing that is read can run code, exported decoders apart.
- Axes are in the order of NumPy. `slot` is 0 to K − 1; `y` and `x` are rows and columns; with several buckets a pixel,
  `bucket` comes first.
- Files of version 0.1 are read, with their names.
"""
"""Until the table of all kinds."""
OTHERS = (
    (
        "`recording.zarr`",
        "frames of `tmca live --record`: the variables of a snapshot, and a group `frames`",
        "[Devices](../devices.md)",
    ),
    (
        "`.ply`",
        "points of a scene with depth, of `tmca point-cloud`: for MeshLab, CloudCompare, Blender",
        "[Spectral-depth camera](../spectral-depth.md)",
    ),
    (
        "folder of `tmca train`",
        "weights, settings, checkpoints and log of a training run",
        "[Training](../training.md)",
    ),
    ("files of `tmca scan`", "depth and reflectance that a bench measured", "[Ground truth](../ground-truth.md)"),
    ("`.png`, `.pdf`, `.html`, `.gif`", "pictures and pages: for any viewer or browser", "—"),
)
"""Files, what they are, and the page that describes them."""
_JSON = re.compile(r"null$|[\[{\"]|\d+(\.\d+)?$")


def files_page() -> str:
    """The page, in Markdown."""
    with TemporaryDirectory() as folder:
        place = Path(folder)
        for write in (write_tiny_files, write_study, write_decoder):
            write(place)
        sections = [_section(kind, place) for kind in KINDS]
    names = [f"| [{kind.title}](#{_anchor(kind.title)}) | `{kind.write[0]}` |" for kind in KINDS]
    overview = "\n".join(["| kind | written by, for example |", "|---|---|", *names])
    others = "## Other files\n\n" + _table(("file", "what it is", "page"), OTHERS)
    return "\n\n".join([INTRODUCTION.strip(), overview, *sections, others]) + "\n"


def _anchor(title: str) -> str:
    return title.lower().replace(" ", "-")


def _section(kind: Kind, folder: Path) -> str:
    rows = [("written by", *kind.write), ("read by", *kind.read)]
    calls = _table(("", "command", "Python"), [(who, _code(one), _code(other)) for who, one, other in rows])
    tables = [_shown(folder / file, title, kind.meanings) for file, title in kind.files.items()]
    return "\n\n".join([f"## {kind.title}", kind.about, calls, f"Without tmca: {kind.opened}", *tables])


def _shown(file: Path, title: str, meanings: Meanings) -> str:
    """What one file holds, under its title."""
    if file.suffix == ".nc":
        return _labelled(file, title, {**ATTRIBUTES, **meanings})
    named = _entries(file)
    columns = "column" if file.suffix == ".csv" else "entry"
    rows = [(_name(name), _type(value), meanings[name]) for name, value in named if name in _asked(named, meanings)]
    return f"### {title}\n\n" + _table((columns, "type", "meaning"), rows)


def _asked(named: list[tuple[str, Any]], meanings: Meanings) -> set[str]:
    """Names that are shown: those at the top, and what is within where any of it has a meaning."""
    return {name for name, _ in named if name in meanings or not any(mark in name for mark in ".[")}


def _entries(file: Path) -> list[tuple[str, Any]]:
    """Names and values of a JSON file, a table, or the header of a file of weights."""
    if file.suffix == ".csv":
        with file.open(newline="") as lines:
            first = next(csv.DictReader(lines))
        return [(name, _number(text)) for name, text in first.items()]
    if file.suffix == ".safetensors":
        from safetensors import safe_open

        with safe_open(file, "np") as stored:
            head = dict(sorted(stored.metadata().items()))
        inside = [(f"tmca.{name}", value) for name, value in json.loads(head["tmca"]).items()]
        return [*head.items(), *inside]
    return list(dict(_within(json.loads(file.read_text()), "")).items())


def _within(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Names of everything in JSON: ``a.b`` within names, ``a[].b`` of lists, ``a.*.b`` where names are of files."""
    if isinstance(value, dict):
        files = bool(value) and all(isinstance(one, dict) for one in value.values()) and name == "frames"
        for key, inside in value.items():
            path = f"{name}.*" if files else f"{name}.{key}" if name else key
            if not files:
                yield path, inside
            yield from _within(inside, path)
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        yield from _within(value[0], f"{name}[]")


def _number(text: str) -> Any:
    try:
        return float(text)
    except ValueError:
        return text


def _labelled(file: Path, title: str, meanings: Meanings) -> str:
    """Tables of the variables and attributes of a NetCDF file, group by group."""
    import xarray as xr

    parts = [f"### {title}"] if title else []
    with xr.open_datatree(file, engine="h5netcdf") as tree:
        for node in tree.subtree:
            inside = node.to_dataset(inherit=False)
            within = "" if node.path == "/" else f"{node.path[1:]}: "
            parts += [f"### {node.path[1:]}"] if within else []
            if inside.variables:
                parts.append(_table(("variable", "axes", "type", "units", "meaning"), _variables(inside)))
            rows = [(_name(name), _type(value), meanings[name]) for name, value in _new(inside.attrs, node.path)]
            parts += [_table(("attribute", "type", "meaning"), rows)] if rows else []
    return "\n\n".join(parts)


def _new(attrs: Mapping[Any, Any], group: str) -> list[tuple[str, Any]]:
    """Attributes of a group; those that every step has are shown with the first one alone."""
    often = {"residuals", "sources", "settings", "measured"} if group not in ("/", "/dark") else set()
    return [(str(name), value) for name, value in attrs.items() if name not in often]


def _variables(dataset: Any) -> Iterator[tuple[str, ...]]:
    """Rows of a table: data first, then what labels its axes."""
    for name in [*dataset.data_vars, *dataset.coords]:
        values = dataset[name]
        axes = ", ".join(f"{dim} {size}" for dim, size in values.sizes.items()) or "—"
        kind = "text" if values.dtype.kind in "UOS" else str(values.dtype)
        yield _name(name), axes, kind, values.attrs.get("units", "—"), values.attrs["long_name"]


def _type(value: Any) -> str:
    if isinstance(value, str):
        return "JSON" if _JSON.match(value) else "text"
    if isinstance(value, dict):
        return "names with values"
    if value is None or isinstance(value, bool):
        return "text or null" if value is None else "true or false"
    return "list" if hasattr(value, "__len__") else "number"


def _code(text: object) -> str:
    return f"`{text}`" if text else "—"


def _name(text: object) -> str:
    """Code that no line breaks, see site.css."""
    return f"`{text}`{{.entry}}"


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [head, tuple("---" for _ in head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
