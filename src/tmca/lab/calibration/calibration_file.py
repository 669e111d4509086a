"""One dated calibration: a NetCDF file of what was measured, and beside it a JSON file that says from what.

Files are never changed: every step writes a new pair, which holds the steps before it too.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.data import check_target, checksum_of, read_dataset, write_dataset, write_json
from tmca.errors import DataError
from tmca.lab.calibration.parts import KINDS, from_variables, kind_of, to_variables
from tmca.lab.calibration.stated import FORMAT, read_stated, sealed
from tmca.lab.codes_date import date_of_frames, parsed_date

if TYPE_CHECKING:
    import xarray as xr

_SENSOR_ALONE = ("dark", "flat", "linearity")
_STAMP = re.compile(r"_\d{4}-\d{2}-\d{2}T\d{6}(-\d+)?$")


@dataclass(frozen=True)
class Calibration:
    """What was measured of one camera.

    Args:
        parts: name (``dark``, ``flat``, ``registration``, … , ``wavefront0``) → what was measured.
        about: what the JSON file says: ``camera``, ``created``, ``steps`` with residuals and sources, ``builds_on``.
        path: of the NetCDF file; None before it is saved.
    """

    parts: Mapping[str, Any]
    about: Mapping[str, Any]
    path: Path | None = None

    @classmethod
    def empty(cls, name: str = "") -> Calibration:
        """Of a camera of this name, before anything is measured."""
        return cls({}, {"camera": {"name": name, "sensor": None, "codes": None}, "steps": {}})

    def part(self, name: str) -> Any:
        """The part of this name, None if it was not measured."""
        return self.parts.get(name)

    @property
    def where(self) -> str:
        """Its file, for messages."""
        return "calibration" if self.path is None else str(self.path)

    @property
    def created(self) -> datetime | None:
        """When it was written; None before."""
        stated = self.about.get("created")
        return None if stated is None else parsed_date(stated, self.where)

    @property
    def codes_seen(self) -> datetime | None:
        """When the oldest step was measured that shows codes or masks; when it was written where there is none."""
        own = {kind: about for kind, about in self.about["steps"].items() if kind_of(kind) not in _SENSOR_ALONE}
        dates = [parsed_date(about["measured"], self.where) for about in own.values() if "measured" in about]
        return min(dates, default=self.created)

    def with_part(
        self,
        name: str,
        part: Any,
        residuals: Mapping[str, float],
        sources: Sequence[str | Path] = (),
        *,
        sensor: tuple[int, int] | None = None,
        codes: tuple[int, int] | None = None,
        settings: Mapping[str, Any] | None = None,
    ) -> Calibration:
        """This and one more step, or one measured again.

        It is dated by the oldest of its frames, where the list of a capture lies beside them; else by now.

        Args:
            name: of the part.
            part: what was measured.
            residuals: what the step says of its own errors.
            sources: files and folders it was measured from.
            sensor, codes: (rows, columns) of sensor and mask.
            settings: of the step.

        Raises:
            DataError: a sensor or mask of another size than in the steps before: another camera; or a list of captures
                that is none.
        """
        camera = dict(self.about["camera"])
        for what, size in (("sensor", sensor), ("codes", codes)):
            if size is not None and camera.get(what) not in (None, list(size)):
                found, known = ("×".join(map(str, n)) for n in (size, camera[what]))
                remedy = "calibrate another camera in a calibration of its own"
                raise DataError(self.where, f"{what} of {found} pixels in {name}", f"{known} as before", remedy)
            camera[what] = camera.get(what) if size is None else list(size)
        now = _now()
        step = {
            "residuals": dict(residuals),
            "sources": [{"path": str(source), "sha256": checksum_of(source)} for source in sources],
            "settings": dict(settings or {}),
            "measured": min(now, date_of_frames(sources) or now).isoformat(),
        }
        about = {**self.about, "camera": camera, "steps": {**self.about["steps"], name: step}}
        return Calibration({**self.parts, name: part}, about, self.path)

    def only(self, *names: str) -> Calibration:
        """With these parts alone."""
        return Calibration({k: v for k, v in self.parts.items() if k in names}, self.about, self.path)

    def without(self, *names: str) -> Calibration:
        """With all other parts."""
        return Calibration({k: v for k, v in self.parts.items() if k not in names}, self.about, self.path)

    def save(self, prefix: str | Path) -> Calibration:
        """Write ``PREFIX_YYYY-MM-DDThhmmss.nc`` (UTC) and ``.json``; a name that is taken gets a number.

        Raises:
            OutputError: it cannot be written.
        """
        from tmca import __version__

        now = _now()
        path = _free(Path(prefix), now)
        write_dataset(self._dataset(), path)
        about = {
            "format": FORMAT,
            "created": now.isoformat(),
            "tmca_version": __version__,
            "camera": self.about["camera"],
            "builds_on": None if self.path is None else self.path.name,
            "data": {"file": path.name, "sha256": checksum_of(path)},
            "steps": self.about["steps"],
        }
        stated = sealed(about)
        write_json(stated, path.with_suffix(".json"))
        return Calibration(self.parts, stated, path)

    def _dataset(self) -> xr.Dataset:
        import xarray as xr

        found, texts = {}, {"format": FORMAT}
        for name, part in self.parts.items():
            variables, said = to_variables(name, part)
            found.update(variables)
            texts.update(said)
        return xr.Dataset(found, attrs=texts)


def _now() -> datetime:
    return datetime.now(UTC).replace(microsecond=0)


def _free(prefix: Path, now: datetime) -> Path:
    """A name that no calibration has."""
    base = prefix.with_name(f"{_STAMP.sub('', _stem(prefix.name))}_{now:%Y-%m-%dT%H%M%S}")
    path, number = Path(f"{base}.nc"), 1
    while path.exists() or path.with_suffix(".json").exists():
        number += 1
        path = Path(f"{base}-{number}.nc")
    check_target(path)
    return path


def _stem(name: str) -> str:
    """A name without the suffix of either file of a calibration."""
    return name.removesuffix(".nc").removesuffix(".json")


def find_calibration(path: str | Path) -> Path:
    """The NetCDF file of a calibration: itself, its JSON file, or the newest of ``PATH_YYYY-MM-DDThhmmss.nc``.

    Raises:
        DataError: there is none.
    """
    path = Path(path)
    if path.suffix == ".json" and path.with_suffix(".nc").is_file():
        return path.with_suffix(".nc")
    if path.is_file():
        return path
    dated = [f for f in path.parent.glob(f"{path.name}_*.nc") if _STAMP.sub("", f.stem) == path.name]
    if not dated:
        raise DataError(path, "no such calibration", "a file of tmca calibrate", "check the name")
    return max(dated, key=lambda f: (f.stem[: len(path.name) + 18], len(f.stem), f.stem))


def load_calibration(path: str | Path) -> Calibration:
    """Read a calibration and check that its two files belong together.

    Raises:
        DataError: no calibration, one of the two files missing, or changed since it was written.
    """
    path = find_calibration(path)
    about = read_stated(path.with_suffix(".json"), path)
    if about["data"].get("sha256") != checksum_of(path):
        remedy = "take an unchanged copy; a calibration is never edited, a step is measured again"
        raise DataError(path, "a file that was changed after it was written", "the one that its JSON tells of", remedy)
    data = read_dataset(path)
    parts = {name: from_variables(name, data, path) for name in about["steps"] if kind_of(name) in KINDS}
    return Calibration(parts, about, path)
