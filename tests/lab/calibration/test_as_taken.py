"""Simulated snapshots of calibrated cameras: light where it was measured, on the pixels that the sensor has."""

from datetime import UTC, datetime

import numpy as np
import pytest
import torch

from tests.lab.calibration.test_apply import WAVES, dispersed, registered, with_parts
from tmca.cameras import LightFieldCamera, Snapshot, SpectralCamera
from tmca.errors import DataError
from tmca.lab.calibration import file as calibration_file
from tmca.lab.calibration.apply import bench_of, calibrated, calibrated_snapshot
from tmca.lab.calibration.sensor import DarkField, FlatField
from tmca.lab.calibration.timing import Timing


def saved(folder, when=None, monkeypatch=None, **parts):
    if when is not None:
        monkeypatch.setattr(calibration_file, "_now", lambda: when)
    return with_parts(**parts).save(folder / "cam")


def taken(bench, *scene):
    with torch.no_grad():
        return bench.recorded(Snapshot(bench.camera(*scene), bench.camera))


@pytest.mark.parametrize("size", [(7, 20), (8, 21)])
@pytest.mark.parametrize("shifts", [(-2.5, 0.0, 2.5), (-0.6, 0.0, 0.3)])
def test_the_same_calibration_leads_back_to_the_camera_that_took_it(tmp_path, size, shifts):
    camera = SpectralCamera(WAVES, size, 2, seed=3)
    place = registered(size, camera.snapshot_shape[1:], [[1, 0.01, 0.3], [0, 1, 0.6]])
    parts = {"registration": place, "dispersion": dispersed(shifts), "timing": Timing(0.2, 1, np.zeros(2), 1, 0.0, 2)}
    known = saved(tmp_path, **parts)
    found, scene = bench_of(camera, known.path), torch.rand(1, 3, *size)
    snapshot = taken(found, scene)
    assert snapshot.camera is camera
    back = calibrated_snapshot(snapshot, known)
    with torch.no_grad():
        assert torch.allclose(back.values, calibrated(camera, known).A(scene), atol=1e-6)
        assert not torch.allclose(snapshot.values, camera.A(scene), atol=0.1)
    with pytest.raises(DataError, match="was applied to"):
        calibrated_snapshot(back, known)


def test_a_sensor_is_as_noisy_as_it_was_measured(tmp_path):
    camera = LightFieldCamera(3, (40, 41), 2, shutter="open")
    even, good = np.ones((40, 41)), np.zeros((40, 41), np.uint8)
    dark, flat = DarkField(100 * even, 8 * even, good, 4), FlatField(even, 2000.0, 0.0, 0.0, good, 4)
    known = saved(tmp_path, dark=dark, flat=flat)
    snapshot = taken(bench_of(camera, known.path), torch.zeros(1, 3, 3, 40, 41))
    assert float(snapshot.values.std()) == pytest.approx(8 * camera.full_scale / 2000, rel=0.05)


def test_codes_that_are_drawn_are_as_old_as_the_calibration_they_are_shown_under(tmp_path, monkeypatch):
    camera = SpectralCamera(WAVES, (6, 7), 2)
    when = datetime(2020, 5, 1, 12, tzinfo=UTC)
    known = saved(tmp_path, when, monkeypatch, timing=Timing(0.0, 1.0, np.zeros(2), 1.0, 0.0, 2))
    assert bench_of(camera, known.path).notes["codes_date"] == when.isoformat()
    now = datetime.fromisoformat(bench_of(camera).notes["codes_date"])
    assert abs((datetime.now(UTC) - now).total_seconds()) < 60
