"""One dated calibration: a NetCDF file with a group for every step that was measured.

Files are never changed: every step writes a new one, which holds the steps before it too.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Json

from tmca.attributes import Attributes, attributes_of, read_json
from tmca.data import atomic_path, check_target, checksum_of, plain, read_dataset
from tmca.data.files import read_groups
from tmca.errors import DataError, check_choice
from tmca.lab.calibration.parts import StatedStep, StoredStep, group_of, kind_of, part_of
from tmca.lab.calibration.sensor import mended
from tmca.lab.frames import Array, check_size
from tmca.lab.notes import date_of_frames, parsed_date
from tmca.summaries import Summary, sizes

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

FORMAT, FORMAT_1 = "tmca calibration 2", "tmca calibration 1"
"""Of version 0.1 a NetCDF file of all steps lay beside a JSON file that told of them."""
_SENSOR_ALONE = ("dark", "flat", "linearity", "buckets")
_STAMP = re.compile(r"_\d{4}-\d{2}-\d{2}T\d{6}(-\d+)?$")


@dataclass(frozen=True, repr=False)
class Calibration(Summary):
    """What was measured of one camera.

    Args:
        parts: name (``dark``, ``flat``, ``registration``, … , ``wavefront0``) → what was measured.
        about: ``camera`` (name, sensor, codes), ``created``, ``builds_on``, and ``steps``: of every part its
            ``residuals``, ``sources``, ``settings`` and when it was ``measured``.
        path: of the file; None before it is saved.
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

    def corrected(self, values: ArrayLike) -> Array:
        """Frames (…, H, W), or (…, R, H, W), without dark, over the flat field, defects mended, as far as these were
        measured."""
        light, dark, flat = np.asarray(values, dtype=np.float64), self.part("dark"), self.part("flat")
        if dark is not None:
            light = light - dark.mean
        if flat is not None:
            light = light / np.where(flat.defects == 0, np.maximum(flat.gain, 1e-3), 1.0)
        bad = self.defects()
        return light if bad is None or not bad.any() else mended(light, bad)

    def light(self, values: ArrayLike) -> Array:
        """(N, H, W) of frames (N, H, W), or (N, R, H, W), corrected, all buckets together."""
        light = self.corrected(values)
        return light if light.ndim == 3 else light.sum(1)

    def defects(self) -> NDArray[np.bool_] | None:
        """(H, W), or (R, H, W), hot and dead pixels; None where neither dark nor flat was measured."""
        planes = [self.parts[name].defects > 0 for name in ("dark", "flat") if name in self.parts]
        return np.asarray(np.logical_or.reduce(planes)) if planes else None

    def settings(self, name: str) -> Mapping[str, Any]:
        """Of the step that measured a part, none where it was not measured."""
        return dict(self.about["steps"].get(name, {}).get("settings", {}))

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
        steps = [about for name, about in self.about["steps"].items() if kind_of(name) not in _SENSOR_ALONE]
        return min((parsed_date(about["measured"], self.where) for about in steps), default=self.created)

    def with_part(
        self,
        name: str,
        part: Any,
        residuals: Mapping[str, float],
        sources: Sequence[str | Path] = (),
        *,
        sensor: tuple[int, ...] | None = None,
        codes: tuple[int, ...] | None = None,
        settings: Mapping[str, Any] | None = None,
    ) -> Calibration:
        """This and one more step, or one measured again, dated by the oldest of its frames where a list of captures
        lies beside them, else by now.

        Args:
            name: of the part.
            part: what was measured.
            residuals: what the step says of its own errors.
            sources: files and folders it was measured from.
            sensor, codes: (rows, columns) of sensor and mask; (R, rows, columns) of a sensor with several buckets.
            settings: of the step.

        Raises:
            DataError: a sensor or mask of another size than in the steps before: another camera.
        """
        camera = dict(self.about["camera"])
        for what, size in (("sensor", sensor), ("codes", codes)):
            if size is not None and camera.get(what) is not None:
                remedy = "calibrate another camera in a calibration of its own"
                check_size(self.where, f"{what} in {name}", size, camera[what], remedy)
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

    def to_xarray(self) -> xr.DataTree:
        """A group for every part, as its file has them."""
        import xarray as xr

        groups = {name: group_of(name, part, self.about["steps"][name]) for name, part in self.parts.items()}
        return xr.DataTree.from_dict({"/": xr.Dataset(), **groups})

    def plot(self, part: str | None = None) -> Figure:
        """Pictures of a part; of the first that was measured if None.

        Raises:
            SettingError: a part that was not measured, or nothing measured at all.
        """
        from tmca.lab.calibration.figures import part_figure

        name = next(iter(self.parts), "") if part is None else part
        check_choice("part", name, self.parts)
        return part_figure(self.parts, name, name)

    def _facts(self) -> dict[str, str]:
        camera, steps = self.about["camera"], self.about["steps"]
        days = sorted(str(step["measured"])[:10] for step in steps.values())
        planes = ((what, camera.get(what)) for what in ("sensor", "codes"))
        return {
            "camera": str(camera.get("name") or ""),
            "sizes": ", ".join(f"{what} {sizes(size)} pixels" for what, size in planes if size),
            "parts": ", ".join(self.parts) or "none",
            "measured": " to ".join(dict.fromkeys((*days[:1], *days[-1:]))),
            "file": "" if self.path is None else self.path.name,
        }

    def _picture(self) -> Figure | None:
        if not self.parts:
            return None
        figure = self.plot()
        figure.set_size_inches(6.6, 2.8)
        return figure

    def save(self, prefix: str | Path) -> Calibration:
        """Write ``PREFIX_YYYY-MM-DDThhmmss.nc`` (UTC), a group for every part; a name that is taken gets a number.

        Raises:
            OutputError: it cannot be written.
        """
        import xarray as xr

        from tmca import __version__

        now = _now()
        path, builds_on = _free(Path(prefix), now), None if self.path is None else self.path.name
        about = {
            "format": FORMAT, "created": now.isoformat(), "tmca_version": __version__, "builds_on": builds_on,
            "camera": self.about["camera"],
        }  # fmt: skip
        groups = {"/": xr.Dataset(attrs={k: json.dumps(plain(v)) for k, v in about.items()})}
        groups |= {name: group_of(name, part, self.about["steps"][name]) for name, part in self.parts.items()}
        with atomic_path(path) as temporary:
            # HDF5 can crash the process when a write fails under it, so it only writes to memory
            temporary.write_bytes(xr.DataTree.from_dict(groups).to_netcdf(None, engine="h5netcdf"))
        return Calibration(self.parts, {**about, "steps": self.about["steps"]}, path)


def _now() -> datetime:
    return datetime.now(UTC).replace(microsecond=0)


def _free(prefix: Path, now: datetime) -> Path:
    """A name that no calibration has."""
    name = prefix.name.removesuffix(".nc").removesuffix(".json")
    base = prefix.with_name(f"{_STAMP.sub('', name)}_{now:%Y-%m-%dT%H%M%S}")
    path, number = Path(f"{base}.nc"), 1
    while path.exists():
        number += 1
        path = Path(f"{base}-{number}.nc")
    check_target(path)
    return path


def find_calibration(path: str | Path) -> Path:
    """The file of a calibration: itself, that beside a JSON file of version 0.1, or the newest ``PATH_DATE.nc``.

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
    """Read a calibration, also one of version 0.1.

    Raises:
        DataError: no calibration, a damaged one, or one of version 0.1 without its JSON file.
    """
    path = find_calibration(path)
    data = read_dataset(path)
    stated = str(data.attrs.get("format"))  # a damaged one may be an array
    if stated == FORMAT_1:
        return _read_1(path, data)
    if stated != json.dumps(FORMAT):
        raise DataError(path, "no calibration", f"a file of tmca calibrate, {FORMAT!r}", "name one")
    return _read(path, data)


class _Camera(Attributes):
    """Whose calibration it is."""

    name: str | None = None
    sensor: tuple[int, int] | tuple[int, int, int] | None = None
    codes: tuple[int, int] | None = None


class _About(Attributes):
    """What a calibration says of itself."""

    format: Json[str]
    created: Json[str]
    tmca_version: Json[str]
    builds_on: Json[str | None]
    camera: Json[_Camera]


class _About1(Attributes):
    """The JSON file of version 0.1."""

    camera: _Camera
    created: str
    steps: dict[str, StatedStep]


def _read(path: Path, data: xr.Dataset) -> Calibration:
    about = attributes_of(_About, data.attrs, path).model_dump()
    groups = read_groups(path, "calibration")
    steps = {n: attributes_of(StoredStep, group.attrs, f"{path}: {n}").model_dump() for n, group in groups.items()}
    parts = {name: part_of(name, group, path) for name, group in groups.items()}
    return _dated(Calibration(parts, about | {"steps": steps}, path))


def _read_1(path: Path, data: xr.Dataset) -> Calibration:
    """Of version 0.1: variables ``NAME_FIELD``, and a JSON file beside them."""
    side = path.with_suffix(".json")
    if not side.is_file():
        raise DataError(path, f"no {side.name} beside it", "both files of a calibration", "copy both")
    about = read_json(side, _About1).model_dump()
    return _dated(Calibration({name: part_of(name, data, path, f"{name}_") for name in about["steps"]}, about, path))


def _dated(calibration: Calibration) -> Calibration:
    """The same; DataError for a date that is none."""
    for stated in [calibration.about["created"], *(step["measured"] for step in calibration.about["steps"].values())]:
        parsed_date(stated, calibration.where)
    return calibration
