"""What scenes are called, how it is noted that they were read, and what tells that their files have changed."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any
from warnings import warn

from tmca.data.files import write_text
from tmca.data.formats.opening import open_contents
from tmca.data.in_memory import SceneWarning as SceneWarning
from tmca.data.rendering import is_rendered
from tmca.data.rgbd import rgbd_sources
from tmca.errors import DataError, SettingError
from tmca.text_files import read_text

READING = "scene_reading"
"""Attribute of scenes, snapshots and estimates: how the scene was read, as JSON."""
SOURCE_BANDS = "source_bands"
"""Attribute of scenes, and of what is made of them, with some of the bands that there are: how many there are."""


def identity_of(source: str) -> str | None:
    """Checksum of a scene's file, of a folder's files, or of an RGB-D scene's, which a stem may name; of every scene of
    a split; None for a rendered scene, or one that is not there."""
    path = Path(source)
    if path.suffix == ".txt" and path.is_file():
        return " ".join(str(identity_of(str(scene))) for scene in read_split(path))
    if is_rendered(source):
        return None
    files = sorted(file for file in path.iterdir() if file.is_file()) if path.is_dir() else rgbd_sources(path)
    if path.is_dir() or files:
        parts = [f"{file.name} {checksum_of(file)}" for file in files]
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()
    return checksum_of(path) if path.is_file() else None


def short_names(scenes: Sequence[str]) -> dict[str, str]:
    """A short name for every scene, longer where two would be the same.

    Raises:
        SettingError: a scene that is named twice.
    """
    if len(set(scenes)) < len(scenes):
        twice = next(scene for scene in scenes if scenes.count(scene) > 1)
        raise SettingError("scenes", f"{twice}, which is named twice", "different scenes", "name it once")
    stems = [Path(scene).name if Path(scene).is_dir() else Path(scene).stem for scene in scenes]
    return {
        scene: stem if stems.count(stem) == 1 else str(Path(scene).with_suffix(""))
        for scene, stem in zip(scenes, stems, strict=True)
    }


def compare_source(source: str, truth: str) -> None:
    """Warns where a truth is another scene than the one that was read for the snapshot.

    Warns:
        SceneWarning: their names differ.
    """
    one, other = (Path(name).stem.removesuffix(":0") for name in (source, truth))  # coffee:0 is coffee
    if one != other:
        warn(f"truth: {truth} is beside a snapshot of {source}; is that the same scene?", SceneWarning, stacklevel=3)


def compare_scene(notes: Mapping[str, Any], truth: str) -> None:
    """Warns where a truth is known to be another scene than that in the notes of a snapshot: by its name, or by what
    its file says. Scenes of real captures have names of their own; a noted reading is compared by itself.

    Warns:
        SceneWarning: their names differ.
    """
    noted = str(notes.get("scene", ""))
    if (
        not noted
        or READING in notes
        or notes.get("real_capture")
        or {noted, Path(noted).stem} & {truth, Path(truth).stem}
    ):
        return
    said = _said_names(truth) if Path(truth).exists() else [truth]
    known = said or ([truth] if Path(noted).suffix else [])  # a file without a name may show a rendered scene
    if known and noted not in known:
        compare_source(noted, truth)


def _said_names(file: str) -> list[str]:
    """What a file and its arrays say that they show."""
    with open_contents(file) as contents:
        about = [contents.attrs, *(array.attrs for array in contents.arrays.values())]
        return [str(one[key]) for one in about for key in ("name", "scene") if key in one]


MANIFEST = "MANIFEST.sha256"
_LONGEST_NAME = 255
_SUM_FIRST = re.compile(r"([0-9a-fA-F]{64})\s+\*?(.+)")
_SUM_LAST = re.compile(r"(.+?)\s+([0-9a-fA-F]{64})")


def read_split(path: str | Path) -> list[Path]:
    """The files and folders of a split, each verified against its checksum, or that in the root's manifest.

    The root, to which its paths are relative, is the nearest folder above the split with a ``MANIFEST.sha256``, else
    the split's own folder. Entries without any checksum are only checked to exist, unless they are names of rendered
    scenes.

    Returns:
        ``root / entry`` in the split's order, also where it is a scene's name and not itself a file; a rendered scene's
        name as it is.

    Raises:
        DataError: naming the entry that is missing, altered or outside the root; or an unreadable split.
    """
    path = Path(path)
    entries = parse_sums(path)
    if not entries:
        raise DataError(path, "an empty split", "one relative path per line")
    base = _root_of(path)
    sums = parse_sums(base / MANIFEST) if (base / MANIFEST).is_file() else {}
    return [_verified(path, base, name, checksum, sums) for name, checksum in entries.items()]


def named_scenes(entries: Iterable[str]) -> tuple[str, ...]:
    """Scenes by their names, with the entries of split files (``.txt``) in their places; errors as of `read_split`."""
    return tuple(
        str(name) for entry in entries for name in (read_split(entry) if Path(entry).suffix == ".txt" else [entry])
    )


def parse_sums(path: str | Path) -> dict[str, str | None]:
    """Relative path → SHA-256 (None without one) of a split or a manifest, in order, ``./`` and trailing
    ``/`` removed.

    Raises:
        DataError: unreadable, a path twice, absolute, or leading out of the root.
    """
    path = Path(path)
    lines = read_text(path, "a text file with one path per line").splitlines()
    entries: dict[str, str | None] = {}
    for line in (line.strip() for line in lines):
        if not line or line.startswith("#"):
            continue
        name, checksum = _parse_line(line)
        if name in entries:
            raise DataError(path, f"{name} twice", "each path once")
        if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
            raise DataError(path, f"the path {name}", f"one relative to the folder {_root_of(path)}, inside it")
        if any(len(part.encode()) > _LONGEST_NAME for part in PurePosixPath(name).parts):
            raise DataError(path, f"the path {name[:60]}…", f"names of at most {_LONGEST_NAME} bytes")
        entries[name] = checksum
    return entries


def _parse_line(line: str) -> tuple[str, str | None]:
    if first := _SUM_FIRST.fullmatch(line):
        name, checksum = first[2], first[1].lower()
    elif last := _SUM_LAST.fullmatch(line):
        name, checksum = last[1], last[2].lower()
    else:
        name, checksum = line, None
    return PurePosixPath(name).as_posix(), checksum


def _root_of(path: Path) -> Path:
    parents = path.resolve().parents
    return next((folder for folder in parents if (folder / MANIFEST).is_file()), parents[0])


def _verified(split: Path, base: Path, name: str, checksum: str | None, sums: dict[str, str | None]) -> Path:
    """The entry's path, after its own checksum or those of the manifest's files that belong to it held."""
    entry = base / name
    if checksum is not None:
        _require(split, entry, checksum)
        return entry
    members = [listed for listed in sums if _belongs(listed, name)]
    for listed in members:
        _require(split, base / listed, sums[listed])
    if not members and not entry.exists():
        beside = entry.parent.iterdir() if entry.parent.is_dir() else ()
        if not any(_belongs(file.relative_to(base).as_posix(), name) for file in beside):
            if is_rendered(name.partition(":")[0]):  # of light fields with a seed behind it
                return Path(name)
            raise _missing(split, entry)
    return entry


def _belongs(listed: str, name: str) -> bool:
    """Whether a listed file is the entry, lies in it, or carries the scene's name as a word of its own."""
    file, scene = PurePosixPath(listed), PurePosixPath(name)
    in_it = file == scene or scene in file.parents
    return in_it or (file.parent == scene.parent and scene.name in re.split(r"[_.-]", file.name))


def _missing(split: Path, path: Path) -> DataError:
    remedy = "correct the path, or fetch the data again"
    return DataError(path, f"no such file or folder, named in {split}", "an existing one", remedy)


def _require(split: Path, path: Path, checksum: str | None) -> None:
    if not path.exists():
        raise _missing(split, path)
    if checksum is None:
        return
    actual = checksum_of(path)
    if actual != checksum:
        found = f"SHA-256 {actual[:12]}… (altered since {split.name} was written)"
        raise DataError(path, found, f"{checksum[:12]}…", "fetch the data again")


def checksum_of(path: str | Path) -> str:
    """SHA-256 of a file; of a folder that of the ``sha256sum`` lines of its files, sorted by relative path.

    Raises:
        DataError: it cannot be read.
    """
    path = Path(path)
    if path.is_dir():
        files = sorted(file for file in path.rglob("*") if file.is_file())
        lines = [f"{checksum_of(file)}  {file.relative_to(path).as_posix()}\n" for file in files]
        return hashlib.sha256("".join(sorted(lines, key=lambda line: line[66:])).encode()).hexdigest()
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise DataError(path, f"an unreadable file ({error.strerror or error})", "a readable one") from error


def write_split(
    paths: Iterable[str | Path], path: str | Path, root: str | Path | None = None, *, overwrite: bool = False
) -> Path:
    """Write a split with the checksum of every entry, in the format of ``sha256sum``.

    Args:
        paths: files and folders.
        path: the split to write.
        root: what the entries are written relative to; by default the split's folder.
        overwrite: replace an existing split.

    Raises:
        DataError: an entry is missing or outside the root, or there are none.
        OutputError: the split exists or cannot be written.
    """
    base = Path(root if root is not None else Path(path).parent).resolve()
    lines = []
    for entry in map(Path, paths):
        if not entry.exists():
            raise DataError(entry, "no such file or folder", "an existing one")
        if not entry.resolve().is_relative_to(base):
            raise DataError(entry, f"a path outside {base}", "entries inside the root", "pass root=")
        lines.append(f"{checksum_of(entry)}  {entry.resolve().relative_to(base).as_posix()}\n")
    if not lines:
        raise DataError(path, "no entries to list", "one file or more")
    return write_text("".join(lines), path, overwrite=overwrite)
