"""The JSON file of a calibration: what it says, sealed by a digest of its own, and refused where it cannot be."""

from __future__ import annotations

import json
from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import Any

from tmca.data import content_digest
from tmca.errors import DataError
from tmca.lab.codes_date import parsed_date

FORMAT = "tmca calibration 1"
DIGEST = "content_sha256"
"""Of what the file says; calibrations of before have none."""
REGISTERED_AT = "registration_wavelength_m"
"""Setting of a dispersion: wavelength of the registration that it was measured against; null if that was unknown."""
_CAMERA = ("name", "sensor", "codes")
_STEP = {"residuals": dict, "sources": list, "settings": dict, "measured": str}
_NUMBERS = ("white_level", "reflectance", "aperture_leakage", REGISTERED_AT)
"""Settings that are calculated with."""


def sealed(about: Mapping[str, Any]) -> dict[str, Any]:
    """What a file is to say, with its digest."""
    return {**about, DIGEST: content_digest(about, DIGEST)}


def read_stated(file: Path, data: Path) -> dict[str, Any]:
    """What the JSON file of a calibration says.

    Args:
        file: of it.
        data: the NetCDF file beside it, named where there is no JSON.

    Raises:
        DataError: no JSON, another format, entries that are missing or of another kind, or changed since it was
            written.
    """
    try:
        about = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise DataError(data, f"no {file.name} beside it", "both files of a calibration", "copy both") from None
    except (OSError, ValueError) as error:
        raise DataError(file, f"no JSON ({error})", "that of a calibration", "take an unchanged copy") from error
    if not isinstance(about, dict) or about.get("format") != FORMAT:
        said = f"format {about.get('format')!r}" if isinstance(about, dict) else f"{str(about)[:20]!r}"
        raise DataError(file, said, repr(FORMAT), "write it with tmca calibrate")
    if DIGEST in about and about[DIGEST] != content_digest(about, DIGEST):
        remedy = "take an unchanged copy; a calibration is never edited, a step is measured again"
        raise DataError(file, "a file that was changed after it was written", f"that of its {DIGEST}", remedy)
    _check(about, file)
    return about


def _check(about: dict[str, Any], file: Path) -> None:
    """Raises DataError for the first entry that is not as `Calibration.save` writes it."""
    _need(about, {"camera": dict, "steps": dict, "data": dict, "created": str}, "", file)
    parsed_date(about["created"], f"{file}: created")
    camera = about["camera"]
    _need(camera, dict.fromkeys(_CAMERA, object), "camera.", file)
    if not isinstance(camera["name"], str) or not all(_is_size(camera[name]) for name in ("sensor", "codes")):
        _refuse(file, f"camera {camera}", "a name, and (rows, columns) of sensor and codes")
    for name, step in about["steps"].items():
        _check_step(step, f"steps.{name}", file)


def _check_step(step: Any, name: str, file: Path) -> None:
    if not isinstance(step, dict):
        _refuse(file, f"{name} {step!r}", "what a step wrote")
    _need(step, _STEP, f"{name}.", file)
    parsed_date(step["measured"], f"{file}: {name}.measured")
    if not all(isinstance(one, dict) and isinstance(one.get("path"), str) for one in step["sources"]):
        _refuse(file, f"{name}.sources without paths", "the files that it was measured from")
    numbers = {**step["residuals"], **{key: step["settings"].get(key) for key in _NUMBERS}}
    for key, value in numbers.items():
        if value is not None and not _is_number(value):
            _refuse(file, f"{key} {value!r} in {name}", "a number")


def _need(entries: dict[str, Any], kinds: Mapping[str, type], where: str, file: Path) -> None:
    for name, kind in kinds.items():
        if not isinstance(entries.get(name), kind) or name not in entries:
            found = f"{where}{name} {entries[name]!r}" if name in entries else f"no {where}{name}"
            _refuse(file, found, "what tmca calibrate wrote")


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)


def _is_size(value: object) -> bool:
    """None, or two whole numbers."""
    return value is None or (isinstance(value, list) and len(value) == 2 and all(type(n) is int for n in value))


def _refuse(file: Path, found: str, expected: str) -> Any:
    raise DataError(file, found, expected, "take an unchanged copy")
