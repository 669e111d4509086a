"""Which files of a folder make up an RGB-D scene, and the calibrations beside them (Middlebury, Open3D, Metric3D)."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from math import isfinite, nan
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from tmca.attributes import Attributes, attributes_of, read_json
from tmca.errors import DataError
from tmca.text_files import read_text

MIDDLEBURY_2005, MIDDLEBURY_2014, SKIMAGE = "Middlebury 2005", "Middlebury 2014", "Middlebury 2014 of scikit-image"
NYUV2, OPEN3D = "NYU Depth v2", "Open3D"
_FIELDS = {
    "<scene>": r"(?P<stem>.+)",
    "<frame>": r"(?P<stem>[^._]+)",
    "<set>": r"(?P<set>.+_)?",
    "<picture>": r"(?:png|jpe?g|bmp)",
    "<GT>": r"(?:GT)?",
}
"""What may stand in the place of a field of a file name."""


@dataclass(frozen=True)
class FileLayout:
    """How a data set names picture and depth.

    Args:
        data_set: its name.
        picture, depth: file names with the fields ``<scene>`` or ``<frame>``, which tell scenes of a folder apart,
            ``<set>`` before them, ``<picture>`` for the suffix of a picture, ``<GT>`` for this or nothing.
    """

    data_set: str
    picture: str
    depth: str

    def match(self, part: str, name: str) -> re.Match[str] | None:
        """How a file name is that of the part, ``"picture"`` or ``"depth"``."""
        return _pattern(getattr(self, part)).fullmatch(name)

    def name_of(self, part: str) -> str:
        """How the part's file is called, for messages."""
        return str(getattr(self, part)).replace("<picture>", "png").replace("<GT>", "")


@cache
def _pattern(name: str) -> re.Pattern[str]:
    """The file names that a name with fields stands for."""
    pattern = re.escape(name)
    for field, expression in _FIELDS.items():
        pattern = pattern.replace(field, expression)
    return re.compile(pattern, re.IGNORECASE)


LAYOUTS = (
    FileLayout(MIDDLEBURY_2005, "<scene>_rgb.<picture>", "<scene>_disp.png"),
    FileLayout(MIDDLEBURY_2005, "view1.png", "disp1.png"),
    FileLayout(MIDDLEBURY_2014, "im0.png", "disp0<GT>.pfm"),
    FileLayout(SKIMAGE, "<scene>_left.<picture>", "<scene>_disp.npz"),
    FileLayout(NYUV2, "rgb_<frame>.<picture>", "sync_depth_<frame>.png"),
    FileLayout(OPEN3D, "<set>color_<frame>.<picture>", "<set>depth_<frame>.png"),
)


@dataclass(frozen=True)
class RgbdFiles:
    """The files of one scene.

    Args:
        layout: how they are named.
        folder: where they are.
        set, stem: the parts of their names that tell the scene, empty where the folder holds one.
        picture, depth: the two files, None for a missing one.
    """

    layout: FileLayout
    folder: Path
    set: str
    stem: str
    picture: Path | None
    depth: Path | None

    @property
    def path(self) -> Path:
        """How a user names the scene: its folder, or folder and stem."""
        return self.folder / self.stem if self.stem else self.folder

    @property
    def name(self) -> str:
        """The scene's name; a number has its folder's before it."""
        return self.path.name if not self.stem.isdigit() else f"{self.folder.name}_{self.stem}"

    @property
    def complete(self) -> bool:
        """Whether both files are there."""
        return self.picture is not None and self.depth is not None

    def both(self) -> tuple[Path, Path]:
        """Picture and depth.

        Raises:
            DataError: one of them is missing.
        """
        if self.picture is not None and self.depth is not None:
            return self.picture, self.depth
        there, gone = (self.depth, "picture") if self.picture is None else (self.picture, "depth map")
        pattern = self.layout.name_of("picture" if self.picture is None else "depth").replace("<set>", self.set)
        expected = pattern.replace("<scene>", self.stem).replace("<frame>", self.stem)
        raise DataError(there, f"no {gone} beside it", f"{expected} ({self.layout.data_set})", "add the file")


def scenes_in(folder: Path) -> list[RgbdFiles]:
    """The RGB-D scenes of a folder by name, also those with one file missing."""
    scenes: dict[tuple[str, str, int], dict[str, Path]] = {}
    for file in sorted(folder.iterdir()) if folder.is_dir() else ():
        role = _role(file.name)
        if role is not None:
            scenes.setdefault(role[0], {}).setdefault(role[1], file)
    return [
        RgbdFiles(LAYOUTS[number], folder, group, stem, files.get("picture"), files.get("depth"))
        for (stem, group, number), files in sorted(scenes.items())
    ]


def _role(name: str) -> tuple[tuple[str, str, int], str] | None:
    """(Stem, set, layout) and part of a file name, by the first layout that fits."""
    for number, layout in enumerate(LAYOUTS):
        for part in ("picture", "depth"):
            if match := layout.match(part, name):
                words = match.groupdict()
                return (words.get("stem") or "", words.get("set") or "", number), part
    return None


def find_rgbd(path: str | Path) -> RgbdFiles | None:
    """The scene that a folder, one of its files, or folder and stem name; None where there is none.

    Raises:
        DataError: it could be several.
    """
    path = Path(path)
    if path.is_dir():
        scenes = scenes_in(path)
    elif path.exists():
        if _role(path.name) is None:
            return None
        return next((s for s in scenes_in(path.parent) if path in (s.picture, s.depth)), None)
    else:
        scenes = [s for s in scenes_in(path.parent) if path.name in (s.stem, s.set + s.stem)]
    scenes = [s for s in scenes if s.complete] or scenes
    if len(scenes) > 1:
        names = ", ".join(str(s.folder / (s.set + s.stem)) for s in scenes[:4]) + (" …" if len(scenes) > 4 else "")
        raise DataError(path, f"{len(scenes)} RGB-D scenes", "one", f"name one of {names}")
    return scenes[0] if scenes else None


MIDDLEBURY_2005_FOCAL_PX, MIDDLEBURY_2005_BASELINE_M, MIDDLEBURY_2005_HEIGHT = 3740.0, 0.160, 1110
"""Focal length at the full height, and baseline, of the sets of 2005 and 2006 as their authors state them."""
NYUV2_FOCAL_PX = 518.85790117
"""Kinect of NYU Depth v2 (Silberman et al. 2012), along x."""
MOTORCYCLE = (994.978, 0.193001, 31.086, 741)
"""Focal length px, baseline m, Δcx px and width of scikit-image's copy (a quarter of Middlebury 2014's)."""


_LEAST, _MOST = 1e-6, 1e6
"""Pixels of a focal length, millimetres of a baseline and units per metre are within."""
_Positive = Annotated[float, Field(ge=_LEAST, le=_MOST)]


class _Camera(Attributes):
    """Open3D's camera file."""

    intrinsic_matrix: list[float] = Field(min_length=9, max_length=9)


class _Annotations(Attributes):
    """Metric3D's annotation file."""

    files: list[dict[str, Any]] = Field(default_factory=list)


class _Shot(Attributes):
    """What an annotation says of a picture."""

    cam_in: list[_Positive] = Field(min_length=1)
    depth_scale: _Positive


@dataclass(frozen=True)
class Stereo:
    """What turns a disparity into metres, ``Z = focal_px · baseline_m / (d + offset_px)``; None where not known."""

    focal_px: float | None = None
    baseline_m: float | None = None
    offset_px: float | None = None

    @property
    def metric(self) -> bool:
        """Whether nothing is missing."""
        return None not in (self.focal_px, self.baseline_m, self.offset_px)


def middlebury_2014(path: Path) -> Stereo:
    """The ``calib.txt`` of a Middlebury 2014 folder: ``cam0=[f 0 cx; …]``, ``baseline=`` in mm, ``doffs=`` in px.

    Raises:
        DataError: unreadable, or one of the three is missing or no number.
    """
    text = read_text(path, "a calib.txt of Middlebury 2014")
    entries = dict(re.findall(r"^\s*(\w+)\s*=\s*(.+?)\s*$", text, re.MULTILINE))
    wanted = {"cam0": r"\[\s*([-+.\deE]+)", "baseline": r"([-+.\deE]+)", "doffs": r"([-+.\deE]+)"}
    numbers = {key: _first_number(pattern, entries.get(key, "")) for key, pattern in wanted.items()}
    gone = [key for key, number in numbers.items() if number is None]
    if gone:
        raise DataError(path, f"no number for {', '.join(gone)}", "cam0=[f 0 cx; …], baseline= (mm) and doffs= (px)")
    focal, baseline, offset = (float(number or 0) for number in numbers.values())
    if not (_LEAST <= focal <= _MOST and _LEAST <= baseline <= _MOST):
        raise DataError(path, f"focal length {focal:g} px and baseline {baseline:g} mm", "positive ones")
    return Stereo(focal, baseline / 1000, offset)


def middlebury_2005(path: Path | None, height: int) -> Stereo:
    """Calibration of a pair of 2005 or 2006 of this height; the offset only from its ``dmin.txt`` (px)."""
    focal = MIDDLEBURY_2005_FOCAL_PX * height / MIDDLEBURY_2005_HEIGHT
    if path is None:
        return Stereo(focal, MIDDLEBURY_2005_BASELINE_M)
    number = _first_number(r"^\s*([-+.\deE]+)\s*$", read_text(path, "a dmin.txt of one number, px"))
    if number is None:
        raise DataError(path, "no number", "the smallest disparity in pixels")
    return Stereo(focal, MIDDLEBURY_2005_BASELINE_M, number)


def motorcycle(width: int) -> Stereo:
    """Of scikit-image's motorcycle at this width."""
    focal, baseline, offset, full = MOTORCYCLE
    return Stereo(focal * width / full, baseline, offset * width / full)


def open3d_focal(path: Path) -> float:
    """Focal length in px along x of an Open3D camera file (``intrinsic_matrix``, column by column).

    Raises:
        DataError: unreadable, or no such matrix.
    """
    focal = read_json(path, _Camera).intrinsic_matrix[0]
    if not _LEAST <= focal <= _MOST:
        raise DataError(path, f"intrinsic_matrix [{focal:g}, …]", "nine numbers with the focal length (px) first")
    return float(focal)


def annotated(path: Path, picture: str) -> tuple[float, float] | None:
    """(Focal length in px, stored units per metre) that a Metric3D annotation file has for a picture; None without.

    Raises:
        DataError: unreadable, or its entry has not both.
    """
    entry = next((e for e in read_json(path, _Annotations).files if Path(str(e.get("rgb"))).name == picture), None)
    if entry is None:
        return None
    shot = attributes_of(_Shot, entry, path, f"entry of {picture}:")
    return shot.cam_in[0], shot.depth_scale


def _first_number(pattern: str, text: str) -> float | None:
    """The number of a pattern; None without one, or one that is not finite."""
    match = re.search(pattern, text, re.MULTILINE)
    try:
        number = float(match[1]) if match else nan
    except ValueError:
        return None
    return number if isfinite(number) else None
