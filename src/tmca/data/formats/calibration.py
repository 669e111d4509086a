"""Calibrations beside RGB-D files: Middlebury's calib.txt and dmin.txt, Open3D's and Metric3D's camera files."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tmca.errors import DataError

MIDDLEBURY_2005_FOCAL_PX, MIDDLEBURY_2005_BASELINE_M, MIDDLEBURY_2005_HEIGHT = 3740.0, 0.160, 1110
"""Focal length at the full height, and baseline, of the sets of 2005 and 2006 as their authors state them."""
NYUV2_FOCAL_PX = 518.85790117
"""Kinect of NYU Depth v2 (Silberman et al. 2012), along x."""
MOTORCYCLE = (994.978, 0.193001, 31.086, 741)
"""Focal length px, baseline m, Δcx px and width of scikit-image's copy (a quarter of Middlebury 2014's)."""


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
    text = _text(path, "a calib.txt of Middlebury 2014")
    entries = dict(re.findall(r"^\s*(\w+)\s*=\s*(.+?)\s*$", text, re.MULTILINE))
    wanted = {"cam0": r"\[\s*([-+.\deE]+)", "baseline": r"([-+.\deE]+)", "doffs": r"([-+.\deE]+)"}
    found = {key: _first_number(pattern, entries.get(key, "")) for key, pattern in wanted.items()}
    gone = [key for key, number in found.items() if number is None]
    if gone:
        raise DataError(path, f"no number for {', '.join(gone)}", "cam0=[f 0 cx; …], baseline= (mm) and doffs= (px)")
    focal, baseline, offset = (float(number or 0) for number in found.values())
    if focal <= 0 or baseline <= 0:
        raise DataError(path, f"focal length {focal:g} px and baseline {baseline:g} mm", "positive ones")
    return Stereo(focal, baseline / 1000, offset)


def middlebury_2005(path: Path | None, height: int) -> Stereo:
    """Calibration of a pair of 2005 or 2006 of this height; the offset only from its ``dmin.txt`` (px)."""
    focal = MIDDLEBURY_2005_FOCAL_PX * height / MIDDLEBURY_2005_HEIGHT
    if path is None:
        return Stereo(focal, MIDDLEBURY_2005_BASELINE_M)
    number = _first_number(r"^\s*([-+.\deE]+)\s*$", _text(path, "one number, px"))
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
    matrix = _json(path).get("intrinsic_matrix")
    if not isinstance(matrix, list) or len(matrix) != 9 or not isinstance(matrix[0], int | float) or matrix[0] <= 0:
        raise DataError(path, f"intrinsic_matrix {str(matrix)[:40]}", "nine numbers with the focal length (px) first")
    return float(matrix[0])


def annotated(path: Path, picture: str) -> tuple[float, float] | None:
    """(Focal length in px, stored units per metre) that a Metric3D annotation file has for a picture; None without.

    Raises:
        DataError: unreadable, or its entry has not both.
    """
    files = _json(path).get("files", [])
    entry = next((e for e in files if isinstance(e, dict) and Path(str(e.get("rgb", ""))).name == picture), None)
    if entry is None:
        return None
    try:
        focal, units = float(entry["cam_in"][0]), float(entry["depth_scale"])
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise DataError(path, f"no cam_in and depth_scale for {picture}", "both, as Metric3D writes them") from error
    if focal <= 0 or units <= 0:
        raise DataError(path, f"cam_in {focal:g} and depth_scale {units:g} for {picture}", "positive ones")
    return focal, units


def _first_number(pattern: str, text: str) -> float | None:
    match = re.search(pattern, text, re.MULTILINE)
    try:
        return float(match[1]) if match else None
    except ValueError:
        return None


def _json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(_text(path, "JSON"))
    except json.JSONDecodeError as error:
        raise DataError(path, f"no JSON ({error})", "a camera file") from error
    if not isinstance(content, dict):
        raise DataError(path, f"a {type(content).__name__}", "a camera file: names and values")
    return content


def _text(path: Path, expected: str) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(path, f"an unreadable file ({error})", expected) from error
