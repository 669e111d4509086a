"""Captures on the simulated bench: frames join into the camera's own snapshot; a bench that stops is gone on with."""

import shutil

import numpy as np
import pytest
import torch

from tests.lab.devices.test_export import mirror, snapshot, spectral
from tmca.cameras import LightFieldCamera
from tmca.cameras.hardware import Hardware, imperfect
from tmca.errors import DataError, OutputError, SettingError
from tmca.lab.devices import Device, capture, device_named, export_codes, find_device, joined, read_planes
from tmca.lab.devices import protocol as protocol_module
from tmca.lab.devices.protocol import DeviceError
from tmca.sensor import Sensor


def exported(folder, camera, *names):
    devices = [device_named(name) for name in names or ("dli4120", "emulated-shutter")]
    return export_codes(read_planes(snapshot(folder, camera)), devices, folder / "out").folder


def scene_of(camera):
    scene = torch.rand(1, *camera.scene_shape, generator=torch.Generator().manual_seed(3))
    return [scene] if not hasattr(camera, "planes") else [scene, torch.full((1, 1, *camera.size), 0.9)]


def bench_of(camera, **settings):
    return find_device("simulated", camera=camera, scene=scene_of(camera), **settings)


@pytest.mark.parametrize("shutter", ["emulated-shutter", "coded-exposure"])
@pytest.mark.parametrize(
    "camera",
    [spectral(), spectral((13, 17), exposure="per-slot"), LightFieldCamera(views=3, size=(9, 11), slots=2), mirror()],
    ids=["spectral", "per slot", "light field", "spectral-depth"],
)
def test_frames_join_into_the_snapshot_of_the_camera(tmp_path, camera, shutter):
    first = "dmp40" if hasattr(camera, "planes") else "dli4120"
    export, bench = exported(tmp_path, camera, first, shutter), bench_of(camera, black=100)
    folder = capture(export, bench, tmp_path / "frames", gain=bench.gain)
    found = joined(folder, export, camera)
    wanted = camera(*scene_of(camera))
    step = bench.gain * (camera.slots if camera.exposure == "per-slot" else 1)
    assert float((found.values - wanted).abs().max()) <= 1.01 * step + 1e-3 * float(hasattr(camera, "planes"))
    assert bench.taken == (camera.slots if shutter == "emulated-shutter" else 1) + 1


def test_a_bench_images_what_was_exported(tmp_path):
    """A mirror without the higher modes of a mask blurs otherwise than the mask."""
    camera = mirror(modes=range(4, 28), rms=100e-9)
    export, bench = exported(tmp_path, camera, "dmp40", "coded-exposure"), bench_of(camera)
    found = joined(capture(export, bench, tmp_path / "f", gain=bench.gain), export, camera)
    assert float((found.values - camera(*scene_of(camera))).abs().max()) > 20 * bench.gain


def test_a_bench_with_faults_is_one(tmp_path):
    camera, faults = spectral(), Hardware(misregistration=0.5, contrast_ratio=30)
    export, bench = exported(tmp_path, camera), bench_of(camera, hardware=faults)
    found = joined(capture(export, bench, tmp_path / "f", gain=bench.gain), export, camera)
    wanted = imperfect(camera, faults)(*scene_of(camera))
    assert float((found.values - wanted).abs().max()) <= 1.01 * bench.gain


def test_a_bench_that_stops_loses_no_frame(tmp_path):
    camera = spectral(sensor=Sensor(read_noise=0.01))
    export, told = exported(tmp_path, camera), []
    with pytest.raises(DeviceError, match="no answer after 2 frames"):
        capture(export, bench_of(camera, stops_after=2), tmp_path / "frames")
    kept = {file.name: file.read_bytes() for file in (tmp_path / "frames").glob("*.tif")}
    assert sorted(kept) == ["dark.tif", "slot_000.tif"]
    bench = bench_of(camera)
    capture(export, bench, tmp_path / "frames", progress=lambda done, total, name: told.append((done, total)))
    assert bench.taken == 2
    assert told == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert all((tmp_path / "frames" / name).read_bytes() == content for name, content in kept.items())


@pytest.fixture
def taken(tmp_path):
    camera = spectral()
    export = exported(tmp_path, camera)
    return camera, export, capture(export, bench_of(camera), tmp_path / "frames")


def test_frames_in_the_wrong_order_are_refused(taken):
    camera, export, folder = taken
    shutil.copy(folder / "slot_002.tif", folder / "slot_000.tif")
    with pytest.raises(DataError, match=r"slot_002: frames in the wrong order"):
        joined(folder, export, camera)


def test_missing_frames_are_named(taken):
    camera, export, folder = taken
    (folder / "slot_001.tif").unlink()
    with pytest.raises(DataError, match=r"slot_001.tif: found no such file"):
        joined(folder, export, camera)


def test_a_capture_is_of_one_export_and_one_camera(taken, tmp_path):
    camera, export, folder = taken
    with pytest.raises(DataError, match="12×18"):
        joined(folder, export, spectral((20, 20)))
    other = export_codes(read_planes(tmp_path / "taken.nc"), [device_named("dli4120")], tmp_path / "b", exposure=0.2)
    with pytest.raises(OutputError, match="a capture of"):
        capture(other.folder, bench_of(camera), folder)
    with pytest.raises(DataError, match="a capture of"):
        joined(folder, other.folder, camera)


class Lamp:
    """A bench that sees one level everywhere."""

    saturation = 4095.0

    def __init__(self, level):
        self.level, self.on = level, False

    def load(self, export):
        pass

    def show(self, slot):
        self.on = slot is not None

    def capture(self, whole=False):
        noise = np.random.default_rng(0).integers(0, 5, (12, 18))
        return (noise + (self.level if self.on or whole else 60)).clip(0, 4095).astype(np.uint16)


@pytest.mark.parametrize(("level", "words"), [(4095, "saturated"), (60, "lens cap")])
def test_saturated_and_dark_captures_are_refused(tmp_path, level, words):
    export = exported(tmp_path, spectral())
    with pytest.raises(DataError, match=words):
        capture(export, Lamp(level), tmp_path / "frames")
    assert [file.name for file in sorted((tmp_path / "frames").iterdir())] == ["captures.json", "dark.tif"]


def test_drivers_of_other_packages_plug_in(monkeypatch):
    class Point:
        name = "lamp"

        @staticmethod
        def load():
            return Lamp

    monkeypatch.setattr(protocol_module, "entry_points", lambda group: [Point] if group == "tmca.devices" else [])
    found = find_device("lamp", level=100)
    assert isinstance(found, Device)
    assert found.level == 100
    with pytest.raises(SettingError, match="simulated, lamp"):
        find_device("laser")


def test_codes_of_another_size_are_no_export_for_a_bench(tmp_path):
    export = exported(tmp_path, spectral())
    with pytest.raises(DeviceError, match="aperture of"):
        bench_of(spectral((20, 20))).load(type("Export", (), {"folder": export})())
