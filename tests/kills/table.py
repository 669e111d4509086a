"""The commands, each small, with what they read; and what they left, without the times in it."""

from __future__ import annotations

import csv
import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
import yaml
from PIL import Image
from safetensors.torch import load_file

from tests.evaluation.test_study import MINE
from tests.kills.server import Asked, Server
from tmca.lab.live import recorded

_SMALL = ["--crop", "24x28", "--slots", "2", "--bands", "3"]
_TRAINING = {
    "camera": {"size": [24, 32], "slots": 2, "period": 8, "learn": "both"},
    "decoder": {"kind": "unrolled", "stages": 1, "widths": [4], "blocks": 1, "start": "dagger"},
    "data": {"patch": 16, "batch": 2, "bands": 3}, "validate_every": 2, "checkpoint_every": 2,
}  # fmt: skip
_TRAIN = ["train", "spectral", "--config", "run.yaml", "--train", "b.nc", "--accelerator", "cpu", "--steps"]
_DEVICES = ["--device", "dli4120", "--device", "emulated-shutter"]
_DBD = ["-M", "9", "-P", "5", "-J", "2", "--targets", "2", "--paths", "1"]
_REPEATS = ["--device", "folder", "--set", "path=repeats", "--like", "sim.nc"]
_LEARNED = ["--weights", "run", "--bands", "3", "--crop", "24x32", "--no-figures", "--out"]
MADE = [
    ["render", "coffee", "--size", "32x40", "--out", "b.nc"],
    ["render", "rocket", "--size", "24x32", "--out", "captures/a_truth.nc"],
    ["render", "coffee", "--size", "24x32", "--out", "captures/b_truth.nc"],
    ["simulate", "spectral", "b.nc", *_SMALL, "--no-figures", "--out", "sim.nc"],
    ["export", "sim.nc", *_DEVICES, "--no-figures", "--out", "ex"],
    [*_TRAIN, "2", "--out", "run"],
    ["simulate", "spectral", "captures/a_truth.nc", *_LEARNED, "captures/a.nc"],
    ["simulate", "spectral", "captures/b_truth.nc", *_LEARNED, "captures/b.nc"],
    ["calibrate", "render", "bench", "--size", "40x45", "--slots", "2", "--seed", "3"],
    ["capture", "ex", "--scene", "b.nc", "--repeat", "6", "--out", "repeats"],
    ["scan", "render", "table", "--size", "64x96", "--picture", "chelsea"],
    ["dbd", "simulate", *_DBD, "--out", "overlaid.nc"],
]
"""Run once, for the commands below to read."""
COMMANDS = {
    "simulate": ["simulate", "spectral", "b.nc", *_SMALL, "--out", "taken.nc", "--overwrite"],
    "reconstruct": ["reconstruct", "sim.nc", "--decoder", "dagger", "--out", "estimate.nc", "--overwrite"],
    "cold cache": ["reconstruct", "sim.nc", "--no-figures", "--out", "estimate.nc", "--overwrite"],
    "train": [*_TRAIN, "6", "--out", "trained"],
    "tune": ["train", "--from", "run", "--captures", "captures", "--steps", "2", "--accelerator", "cpu",
             "--out", "tuned"],
    "sweep": ["sweep", "spectral", "b.nc", "--crop", "24x24", "--bands", "4", "--decoder", "dagger", "--vary",
              "noise=0,0.1", "--out", "swept", "--work", "work", "--overwrite"],
    "study": ["study", "mine.yaml", "--out", "results", "--work", "work", "--overwrite"],
    "prior learn": ["prior", "learn", "b.nc", "--bands", "3", "--out", "prior.nc", "--overwrite"],
    "export": ["export", "sim.nc", *_DEVICES, "--out", "exported", "--overwrite"],
    "capture": ["capture", "ex", "--scene", "b.nc", "--out", "frames", "--overwrite"],
    "live": ["live", "ex", *_REPEATS, "-d", "dagger", "--no-page", "--record", "r.zarr", "--record-estimates",
             "--overwrite"],
    "calibrate": ["calibrate", "dark", "bench/dark", "--out", "cal"],
    "calibrate capture": ["calibrate", "capture", "dark", "ex", "--out", "taken"],
    "scan": ["scan", "depth", "table/captures", "--plan", "table/fringes", "--calibration", "table/calibration.json",
             "--out", "depth.nc", "--figure", "depth.png", "--overwrite"],
    "dbd simulate": ["dbd", "simulate", *_DBD, "--out", "samples.nc", "--overwrite"],
    "dbd solve": ["dbd", "solve", "overlaid.nc", "--out", "solved.nc", "--overwrite"],
    "dbd study": ["dbd", "study", "--vary", "L=1,2", "--set", "M=7", "--set", "P=3", "--set", "Q=1", "--set",
                  "basis=gaussian", "--draws", "2", "--out", "studied", "--work", "work", "--overwrite"],
    "view": ["view", "sim.nc", "--static", "page.html", "--overwrite"],
    "design": ["design", "judge", "sim.nc", "--json"],
    "new": ["new", "camera", "weighted", "--overwrite"],
    "decoder export": ["decoder", "export", "run", "--out", "decoder", "--formats", "torch", "--overwrite"],
}  # fmt: skip
HELD = {"train", "tune", "sweep", "study", "capture", "live", "calibrate capture", "dbd study"}
"""Those that hold their folder while they work: a second one is told at once."""
_DATE = re.compile(r"\d{4}-\d\d-\d\dT[\d:]{6,8}(\+\d\d:\d\d)?([-_]\d+)?")
_PLACED = re.compile(r"(?<=-)[0-9a-f]{16}(?=\.npy$)")
"""Of a cached scene, by its absolute path."""
_TIMES = re.compile(
    r"seconds|time|taken$|written|measured|created|sha256|commit|command|cpu|date|builds_on|tmca|export$|digest|source_at|_s$"
)


def inputs(server: Server, folder: Path) -> Path:
    """A folder of what the commands read."""
    (folder / "captures").mkdir(parents=True)
    (folder / "run.yaml").write_text(yaml.safe_dump(_TRAINING))
    (folder / "mine.yaml").write_text(yaml.safe_dump(MINE | {"scenes": {"test": ["b.nc"]}}, allow_unicode=True))
    for words in MADE:
        (end,) = server.run(Asked(words, str(folder)))
        assert end.code == 0, end.said
    shutil.rmtree(folder / "cache", ignore_errors=True)
    return folder


def workplace(read: Path, folder: Path) -> Path:
    """A new folder with links to what is read."""
    folder.mkdir(parents=True)
    for file in read.iterdir():
        (folder / file.name).symlink_to(file)
    return folder


def contents(folder: Path) -> dict[str, Any]:
    """Everything that a command left, opened by its reader, by names without dates; hidden files apart."""
    left: dict[str, Any] = {}
    for top in sorted(file for file in folder.iterdir() if not file.is_symlink()):
        if top.suffix == ".zarr":
            left[top.name] = _frames(top)
            continue
        for file in [top] if top.is_file() else sorted(top.rglob("*")):
            name = file.relative_to(folder)
            if file.is_file() and not any(part.startswith(".") for part in name.parts):
                left[_PLACED.sub("PLACE", _DATE.sub("DATE", name.as_posix()))] = _opened(file)
    return left


def _frames(recording: Path) -> list[bytes]:
    """The snapshots of a recording, which xarray opens as well."""
    with xr.open_zarr(recording) as camera, xr.open_zarr(recording, group="frames") as frames:
        camera.load()
        frames.load()
    return [frame.values.numpy().tobytes() for frame in recorded(recording)]


def _opened(file: Path) -> Any:
    """What a file holds, without times."""
    if file.suffix == ".json":
        return _plain(json.loads(file.read_text()))
    if file.suffix in (".nc", ".h5"):
        with xr.open_datatree(file, engine="h5netcdf") as tree:
            return {
                (group.path, str(name)): np.asarray(value).tobytes()
                for group in tree.subtree
                for name, value in group.variables.items()
                if not _TIMES.search(str(name))
            }
    if file.suffix == ".safetensors":
        return {name: value.numpy().tobytes() for name, value in load_file(file).items()}
    if file.suffix == ".npy":
        return np.load(file).tobytes()
    if file.suffix == ".csv":
        names, *rows = csv.reader(file.read_text().splitlines())
        return [[value for name, value in zip(names, row, strict=True) if not _TIMES.search(name)] for row in rows]
    if file.suffix == ".md":
        return len(file.read_text().splitlines())  # times are among its figures, which the JSON beside it has as well
    if file.suffix in (".pt2", ".onnx"):
        return file.stat().st_size // 1000
    return file.read_bytes() if file.suffix != ".png" or "overview" in file.name else _picture(file)


def _picture(file: Path) -> Any:
    with Image.open(file) as picture:
        picture.load()
        return picture.size


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _plain(one) for name, one in value.items() if not _TIMES.search(name)}
    return [_plain(one) for one in value] if isinstance(value, list) else value


def left_over(folder: Path) -> list[str]:
    """Hidden files and folders that a command left; an empty one in the cache stays until something is cached again."""
    tops = [file for file in folder.iterdir() if not file.is_symlink()]
    files = [file for top in tops for file in ([top] if top.suffix == ".zarr" else [top, *top.rglob("*")])]
    hidden = [file for file in files if file.name.startswith(".")]
    return [file.name for file in hidden if folder / "cache" not in file.parents or _bytes(file)]


def _bytes(place: Path) -> int:
    return sum(file.stat().st_size for file in (place, *place.rglob("*")) if file.is_file())
