"""Codes of a study by their names: presets, searched ones, those of files and of weights."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tmca.cameras import CAMERAS
from tmca.codes import BURST
from tmca.codes.files import codes_of_file
from tmca.data import read_dataset
from tmca.decoders.nets.shipped import CAMERA_NAMES, DEFAULT
from tmca.errors import DataError, SettingError, did_you_mean
from tmca.evaluation.camera import Settings

DESIGNED = "designed"
"""Codes that are searched for the sensor."""
_USUAL = {
    "spectral": ("cassi", "one-hot", "two-bucket"),
    "light-field": ("clfp", "one-hot", "two-bucket"),
    "spectral-depth": ("quick-diffractive", "quick"),
}
"""Codes that are compared where none are named."""
_OF_SCENE = ("size", "bands", "views")
_DESIGN: dict[str, Settings] = {
    "spectral-depth": {
        "camera": {"slots": 4, "shutter": "one-hot", "mask": "zernike", "filters": "gaussian"}, "search": {},
    },
    "": {"camera": {"slots": 4}, "search": {"kind": "free", "slots": 4}},
}  # fmt: skip


def codes_of_names(kind: str, named: Sequence[str]) -> dict[str, Settings]:
    """Codes of a study by their names; the usual ones without any.

    Args:
        kind: of camera.
        named: presets, ``designed``, files of codes or snapshots, weights or runs of `tmca train`, ``default``; all
            but presets and ``designed`` may have a name of yours, ``NAME=FILE``.

    Raises:
        SettingError: codes that there are not, or one name twice.
        DataError: a snapshot of another kind of camera, or a folder that is no run.
    """
    presets = CAMERAS[kind].presets
    chosen = list(named) or [name for name in _USUAL.get(kind, tuple(presets)) if name in presets]
    if not chosen:
        return {"usual": {}}
    for name in chosen:
        if chosen.count(name) > 1:
            raise SettingError("codes", f"{name} twice", "each of them once", "leave one out")
    made = {name: _code(kind, _named(name)[1]) for name in chosen}
    return {_shown_name(own, made[name]): made[name] for name, own in _code_names(chosen).items()}


def _named(text: str) -> tuple[str, str]:
    """Name and file of ``NAME=FILE``; no name of anything else."""
    name, _, file = (part.strip() for part in text.partition("="))
    own = name and file and (_is_path(file) or file in CAMERA_NAMES) and not Path(text).exists()
    return (name, file) if own else ("", text)


def _is_path(text: str) -> bool:
    return bool(Path(text).suffix) or Path(text).is_dir()


def _shown_name(name: str, code: Settings) -> str:
    """The name of codes in tables, which says of a file that it is a burst."""
    stored = codes_of_file(code["file"]) if "file" in code and BURST not in name else None
    return f"{name} (burst)" if stored and stored.burst else name


def _short(name: str) -> str:
    """A folder's name, or that of a file without its suffix."""
    path = Path(name)
    return path.resolve().name if path.is_dir() else path.stem if path.suffix else name


def _code_names(chosen: Sequence[str]) -> dict[str, str]:
    """What was asked for → its name in the study: a file's is given, ``NAME=FILE``, or that without its suffix, behind
    its folder's where two clash."""
    short = {name: _named(name)[0] or _short(name) for name in chosen}
    several = list(short.values())
    for name, stem in short.items():
        if several.count(stem) > 1 and _is_path(name) and not _named(name)[0]:
            short[name] = f"{Path(name).resolve().parent.name}/{stem}"
    for name, own in short.items():
        if list(short.values()).count(own) > 1:
            raise SettingError("codes", f"{own} twice, once as {name}", "codes of different names", "rename a file")
    return short


def _code(kind: str, name: str) -> Settings:
    """One entry of ``codes``."""
    presets = CAMERAS[kind].presets
    if name in presets:
        own = {"preset": name} if kind == "spectral-depth" else presets[name]
        return {"camera": {key: value for key, value in own.items() if key not in _OF_SCENE}}
    if name == DESIGNED:
        return _DESIGN.get(kind, _DESIGN[""])
    if name in CAMERA_NAMES or Path(name).suffix == ".safetensors" or (Path(name) / "weights.safetensors").is_file():
        return {"weights": name}
    if Path(name).is_dir():
        remedy = "name the run, or a file in it such as codes.nc"
        raise DataError(
            name, "a folder without weights.safetensors", "a run of `tmca train`, or a file of codes", remedy
        )
    if not _is_path(name):
        known = [*presets, DESIGNED, DEFAULT]
        expected = f"{', '.join(known)}, a file of codes, a snapshot, or a run of `tmca train`"
        raise SettingError("codes", repr(name), expected, did_you_mean(name, known))
    _check_kind(kind, name)
    return {"file": name}


def _check_kind(kind: str, file: str) -> None:
    """Raises DataError where a snapshot is of another kind of camera."""
    stored = read_dataset(file, ())
    if "snapshot" in stored and stored.attrs.get("camera", kind) != kind:
        raise DataError(file, f"a {stored.attrs['camera']} snapshot", f"codes of a {kind} camera")
