"""Simulated snapshots as a calibrated camera takes them: light by what was measured, a file like that of a capture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tmca.cameras import Camera, Snapshot, SpectralCamera
from tmca.lab.calibration.apply import calibrated
from tmca.lab.calibration.calibration_file import Calibration, load_calibration
from tmca.lab.calibration.measured_cameras import columns_of
from tmca.lab.codes_date import CODES_DATE, date_of_codes, now

SIMULATED = "simulated_calibration"
"""Attribute of a snapshot that a calibrated camera took in simulation: the calibration's file."""


@dataclass(frozen=True)
class CalibratedBench:
    """A camera as it is known, and the one that takes snapshots.

    Args:
        nominal: as it was designed; snapshot files hold this one, like those of captures.
        camera: with what was measured of it; ``nominal`` without a calibration.
        notes: of its snapshots: date of the codes, name of the camera, calibration.
    """

    nominal: Camera
    camera: Any
    notes: dict[str, Any]

    def recorded(self, taken: Snapshot[Any]) -> Snapshot[Any]:
        """A snapshot of ``camera`` as the sensor's pixels record it, with the nominal camera.

        Columns of the sensor that no light reaches are 0.
        """
        values = taken.values
        if isinstance(self.nominal, SpectralCamera):
            values = columns_of(self.nominal, self.camera).cut(values, self.nominal.snapshot_shape[2])
        return Snapshot(values, self.nominal, {**taken.notes, **self.notes})


def bench_of(
    camera: Camera, calibration: str | Path | None = None, codes: Sequence[str | Path] = ()
) -> CalibratedBench:
    """A bench for simulated snapshots.

    Codes that are drawn for the simulation have no date of their own: it is that of the calibration under which they
    are shown, or now.

    Args:
        camera: nominal, with the codes.
        calibration: of the camera; None for the camera as it was designed.
        codes: files that the codes come from.

    Raises:
        DataError: a calibration of another camera, or one that is older than the codes.
        SettingError: optics for which there is no calibration.
    """
    date = date_of_codes(codes)
    if calibration is None:
        return CalibratedBench(camera, camera, {CODES_DATE: date or now()})
    found = load_calibration(calibration)
    notes = {CODES_DATE: date or _date(found), SIMULATED: found.where}
    if name := found.about["camera"].get("name"):
        notes["camera_name"] = name
    return CalibratedBench(camera, calibrated(camera, found, notes), notes)


def _date(calibration: Calibration) -> str:
    seen = calibration.codes_seen
    return now() if seen is None else seen.isoformat()
