"""Drivers of real benches: how they plug in, what they answer, what becomes of the frames when they fail."""

import numpy as np
import pytest

from tests.lab.devices.test_capture import exported
from tests.lab.devices.test_export import spectral
from tmca.errors import DataError, DeviceError, SettingError
from tmca.lab.devices import Device, capture, find_device
from tmca.lab.devices import protocol as protocol_module


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


class Broken(Lamp):
    """A driver that fails as drivers do, in slot 1."""

    def __init__(self, failure):
        super().__init__(900)
        self.failure = failure

    def show(self, slot):
        self.on, self.slot = slot is not None, slot

    def capture(self, whole=False):
        return super().capture(whole) if self.slot != 1 else self.failure()


def timeout():
    raise TimeoutError("USB gone")


@pytest.mark.parametrize(
    ("failure", "words"),
    [
        (timeout, "TimeoutError: USB gone"), (lambda: np.full((12, 18), np.nan), "float64"),
        (lambda: np.full((12, 18), 70000), "70000"), (lambda: np.full((12, 18), -1), "-1"),
        (lambda: np.zeros(7, np.uint16), r"\(7,\)"), (lambda: np.zeros((0, 3), np.uint16), r"\(0, 3\)"),
        (lambda: None, "object"),
    ],
)  # fmt: skip
def test_drivers_that_fail_do_so_in_one_line_and_lose_no_frame(tmp_path, failure, words):
    export = exported(tmp_path, spectral())
    with pytest.raises(DeviceError, match=f"device Broken.*{words}") as found:
        capture(export, Broken(failure), tmp_path / "frames")
    assert "\n" not in str(found.value)
    assert [file.name for file in sorted((tmp_path / "frames").glob("*.tif"))] == ["dark.tif", "slot_000.tif"]
    capture(export, Lamp(900), tmp_path / "frames")
    assert len([*(tmp_path / "frames").glob("*.tif")]) == 4


def test_frames_of_another_size_are_refused_when_they_come(tmp_path):
    export = exported(tmp_path, spectral())
    with pytest.raises(DataError, match="slot_001: found a frame of 13×18, expected 12×18"):
        capture(export, Broken(lambda: np.full((13, 18), 900)), tmp_path / "frames")
    wide = Lamp(900)
    wide.capture = lambda whole=False: np.full((13, 18), 60)
    with pytest.raises(DataError, match="dark: found a frame of 13×18, expected 12×18"):
        capture(export, wide, tmp_path / "other", camera=spectral())
    assert not (tmp_path / "other").exists()


def test_a_frame_is_captured_at_least_once(tmp_path):
    with pytest.raises(SettingError, match="--repeat"):
        capture(exported(tmp_path, spectral()), Lamp(900), tmp_path / "frames", repeats=0)


def failing():
    raise ImportError("no libdmd.so")


@pytest.mark.parametrize(("load", "words"), [(failing, "no libdmd.so"), (lambda: Lamp, "missing 1 required")])
def test_drivers_that_do_not_start_say_so(monkeypatch, load, words):
    point = type("Point", (), {"name": "lamp", "load": staticmethod(load)})
    monkeypatch.setattr(protocol_module, "entry_points", lambda group: [point])
    with pytest.raises(DeviceError, match=f"device lamp: .*{words}"):
        find_device("lamp")


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
