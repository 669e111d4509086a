"""Drivers of real benches: how they plug in, what they answer, what becomes of the frames when they fail."""

import itertools
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import torch

from tests.lab.acquisition.test_capture import exported, scene_of
from tests.lab.display.test_export import spectral
from tmca.errors import DataError, DeviceError, OutputError, SettingError
from tmca.lab.acquisition import drivers
from tmca.lab.acquisition.drivers import Calls, Device, find_device, time_limit
from tmca.lab.acquisition.session import capture, joined
from tmca.lab.acquisition.simulated import SimulatedBench
from tmca.lab.calibration.apply import calibrated_snapshot
from tmca.lab.calibration.file import Calibration
from tmca.lab.calibration.sensor import DarkField, FlatField
from tmca.lab.quality import Doubtful


class Lamp:
    """A bench that sees one level everywhere, and noise that never repeats."""

    saturation = 4095.0
    taken = itertools.count()

    def __init__(self, level):
        self.level, self.on = level, False

    def load(self, export):
        pass

    def show(self, slot):
        self.on = slot is not None

    def capture(self, whole=False):
        noise = np.random.default_rng(next(self.taken)).integers(0, 5, (12, 18))
        return (noise + (self.level if self.on or whole else 60)).clip(0, 4095).astype(np.uint16)


def test_saturated_captures_are_refused(tmp_path):
    with pytest.raises(DataError, match="saturated"):
        capture(exported(tmp_path, spectral()), Lamp(4095), tmp_path / "frames")
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


def raising(error):
    def fail():
        raise error

    return fail


@pytest.mark.parametrize(
    ("failure", "words"),
    [
        (raising(TimeoutError("USB gone")), "TimeoutError: USB gone"),
        (raising(SystemExit(3)), "SystemExit: 3"), (lambda: np.full((12, 18), np.nan), "float64"),
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
    assert len([*(tmp_path / "frames").glob("*.tif")]) == 3 + 4


class Hanging(Lamp):
    """A driver that answers no more from a call on."""

    def __init__(self, call, after):
        super().__init__(900)
        self.left, self.threads = after, []
        self.name_frame = lambda name: None
        setattr(self, call, self.counted(getattr(self, call)))

    def counted(self, call):
        def counted(*given, **named):
            self.threads.append(threading.current_thread())
            self.left -= 1
            return call(*given, **named) if self.left >= 0 else threading.Event().wait()

        return counted


@pytest.mark.parametrize(
    ("call", "after", "kept"), [("load", 0, 0), ("name_frame", 1, 1), ("show", 1, 1), ("capture", 2, 2)]
)
def test_a_driver_that_hangs_ends_the_capture_in_one_line_and_loses_no_frame(tmp_path, call, after, kept):
    export, hanging = exported(tmp_path, spectral()), Hanging(call, after)
    with pytest.raises(DeviceError, match=r"device Hanging: found no answer in 0\.2 s, .*--timeout") as found:
        capture(export, hanging, tmp_path / "frames", timeout=0.2)
    assert "\n" not in str(found.value)
    assert len([*(tmp_path / "frames").glob("*.tif")]) == kept
    assert len({*hanging.threads}) == 1
    assert hanging.threads[0].daemon
    capture(export, Lamp(900), tmp_path / "frames", timeout=10)
    assert len([*(tmp_path / "frames").glob("*.tif")]) == 3 + 4


@pytest.mark.slow
def test_the_process_ends_while_a_driver_hangs():
    code = "\n".join([
        "import threading",
        "from tmca.errors import DeviceError",
        "from tmca.lab.acquisition.drivers import Calls",
        "try:",
        "    with Calls(object(), 0.1) as calls:",
        "        calls.of(threading.Event().wait)",
        "except DeviceError:",
        "    raise SystemExit(2)",
    ])  # fmt: skip
    assert subprocess.run([sys.executable, "-c", code], timeout=100, check=False).returncode == 2


def test_frames_do_not_depend_on_the_time_limit_and_no_thread_stays(tmp_path):
    export, lamp = exported(tmp_path, spectral()), Hanging("capture", 99)
    lamp.taken = itertools.count()
    limited = capture(export, lamp, tmp_path / "limited")
    within, lamp.threads, lamp.taken = {*lamp.threads}, [], itertools.count()
    unlimited = capture(export, lamp, tmp_path / "unlimited", timeout=0)
    assert {*lamp.threads} == {threading.current_thread()}
    assert len(within) == 1
    (thread,) = within
    thread.join(10)
    assert not thread.is_alive()
    for file in unlimited.glob("*.tif"):
        assert file.read_bytes() == (limited / file.name).read_bytes()


def test_a_simulated_bench_computes_as_long_as_it_takes(tmp_path, monkeypatch):
    camera, threads = spectral(), []
    export, bench = exported(tmp_path, camera), SimulatedBench(camera, scene_of(camera))
    own = bench.capture

    def slow(whole=False):
        threads.append(threading.current_thread())
        time.sleep(0.02)
        return own(whole)

    monkeypatch.setattr(bench, "capture", slow)
    capture(export, bench, tmp_path / "frames", timeout=0.001)
    assert {*threads} == {threading.current_thread()}


@pytest.mark.parametrize(("exposure", "asked", "limit"), [
    (0.1, None, 30), (20, None, 60), (20, 5, 5), (20, 0, None), (20, 1e30, 1e30),
])  # fmt: skip
def test_the_limit_is_longer_than_an_exposure(exposure, asked, limit):
    assert time_limit({"exposure_s": exposure}, asked) == limit
    for impossible in (-1.0, np.nan, np.inf):
        with pytest.raises(SettingError, match="--timeout"):
            time_limit({"exposure_s": exposure}, impossible)


def test_a_limit_beyond_what_a_thread_can_wait_is_none():
    with Calls(Lamp(900), 1e30) as calls:
        assert calls.of(lambda: 3) == 3


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


@pytest.fixture
def plugged(monkeypatch):
    """Plugs a driver in as another package does: by its name, and what loads its factory."""

    def plug(name, load):
        point = type("Point", (), {"name": name, "load": staticmethod(load)})
        monkeypatch.setattr(drivers, "entry_points", lambda group: [point] if group == "tmca.devices" else [])

    return plug


def test_drivers_that_do_not_start_say_so(plugged):
    plugged("lamp", raising(ImportError("no libdmd.so")))
    with pytest.raises(DeviceError, match=r"device lamp: .*no libdmd\.so"):
        find_device("lamp")
    plugged("lamp", lambda: raising(OSError("no lamp on port 0")))
    with pytest.raises(DeviceError, match=r"device lamp: .*no lamp on port 0"):
        find_device("lamp")


def old_port(port="0"):
    return Lamp(int(port))


def typed(level: int, warm: bool = False):
    return Lamp(level if warm else -level)


@pytest.mark.parametrize(("factory", "settings", "said"), [
    (Lamp, {}, "--set level: found none, expected level, which this device needs; pass --set level=…"),
    (Lamp, {"level": "1", "levle": "2"}, "--set levle: found a setting .*, expected one of level; did you mean level"),
    (Lamp, {"level": "1", "port": "2"}, r"--set port: found .*expected one of level; lamp has level \(a text\)"),
    (old_port, {"port": "abc"}, r"--set port: found ValueError: .*'abc', .*; lamp has port \(a text, '0' without\)"),
    (typed, {"level": "x"}, r"--set level: found 'x', expected a whole number; lamp has level \(a whole number\)"),
    (typed, {"level": "1", "warm": "much"}, "--set warm: found 'much', expected True or False"),
])  # fmt: skip
def test_a_setting_that_a_driver_cannot_use_is_named_with_those_that_there_are(plugged, factory, settings, said):
    plugged("lamp", lambda: factory)
    with pytest.raises(SettingError, match=said) as refused:
        find_device("lamp", **settings)
    assert "see to the device" not in str(refused.value)
    assert "\n" not in str(refused.value)


def test_texts_become_what_a_driver_annotates_and_stay_texts_elsewhere(plugged):
    plugged("lamp", lambda: typed)
    assert find_device("lamp", level="7", warm="true").level == 7
    plugged("lamp", lambda: Lamp)
    assert find_device("lamp", level="7").level == "7"


def test_a_driver_of_a_file_is_named_by_it(tmp_path):
    file = tmp_path / "bench.py"
    file.write_text(
        "class Bench:\n    saturation = 255.0\n    def __init__(self, port: int = 0):\n        self.port = port\n"
        "    def load(self, export): pass\n    def show(self, slot): pass\n    def capture(self, whole=False): pass\n"
        "class Half:\n    saturation = 255.0\n"
    )
    assert find_device(f"{file}:Bench", port="3").port == 3
    with pytest.raises(
        SettingError, match=r"--set port: found 'x', expected a whole number; .*bench.py:Bench has port"
    ):
        find_device(f"{file}:Bench", port="x")
    with pytest.raises(SettingError, match=r"--device: found .*Half, expected load, show, capture and saturation"):
        find_device(f"{file}:Half")
    with pytest.raises(SettingError, match="--device: found no class Bank"):
        find_device(f"{file}:Bank")


def test_what_fails_in_a_driver_of_a_file_names_its_line(tmp_path):
    file = tmp_path / "bench.py"
    file.write_text(
        "class Bench:\n    saturation = 255.0\n    def __init__(self, port: int = 0):\n        [][port]\n"
        "class Later(Bench):\n    def __init__(self): pass\n    def load(self, export):\n        return [][1]\n"
        "    def show(self, slot): pass\n    def capture(self, whole=False): pass\n"
    )
    said = r"bench.py:{}, which fails with IndexError: list index out of range \(line {}\), expected an answer"
    with pytest.raises(DeviceError, match=said.format("Bench", 4)):
        find_device(f"{file}:Bench")
    with pytest.raises(DeviceError, match=said.format("Later", 8)):
        capture(exported(tmp_path, spectral()), find_device(f"{file}:Later"), tmp_path / "frames")


def test_drivers_of_other_packages_plug_in(plugged):
    plugged("lamp", lambda: Lamp)
    found = find_device("lamp", level=100)
    assert isinstance(found, Device)
    assert found.level == 100
    with pytest.raises(SettingError, match="simulated, folder, lamp"):
        find_device("laser")


@pytest.mark.parametrize("how", [{"gain": 2.0}, {"bench": {"scene": "other"}}, {"saturation": 1023.0}])
def test_frames_of_another_bench_are_never_joined_with_those_that_are_there(tmp_path, how):
    export, lamp = exported(tmp_path, spectral()), Lamp(900)
    with pytest.raises(DeviceError):
        capture(export, Broken(raising(TimeoutError("USB gone"))), tmp_path / "frames", bench={"scene": "one"})
    lamp.saturation = how.get("saturation", lamp.saturation)
    given = {"bench": {"scene": "one"}, **{k: v for k, v in how.items() if k != "saturation"}}
    with pytest.raises(OutputError, match=next(iter(how)).replace("bench", "scene")):
        capture(export, lamp, tmp_path / "frames", **given)
    assert len([*(tmp_path / "frames").glob("*.tif")]) == 2


def bright_corner(lamp):
    own = lamp.capture

    def capture(whole=False):
        frame = own(whole)
        frame[:2, :9] = 4095 if lamp.on else frame[:2, :9]
        return frame

    return capture


def test_saturated_pixels_are_told_in_the_snapshot(tmp_path):
    camera, lamp = spectral(), Lamp(900)
    export = exported(tmp_path, camera)
    clean = joined(capture(export, lamp, tmp_path / "clean"), export, camera)
    lamp.capture = bright_corner(lamp)
    with pytest.warns(Doubtful, match=r"frames: 8\.33% of the pixels are saturated: .*expose for less time") as told:
        found = joined(capture(export, lamp, tmp_path / "frames"), export, camera)
    assert len(told) == 1
    assert clean.notes["saturated_share"] == 0
    assert found.notes["saturated_share"] == pytest.approx(18 / (12 * 18))


def test_a_capture_by_a_driver_gets_the_flat_field_and_the_white_of_its_calibration(tmp_path):
    camera, lamp = spectral(), Lamp(900)
    export = exported(tmp_path, camera)
    taken = joined(capture(export, lamp, tmp_path / "frames", gain=0.01), export, camera)
    size, clean = camera.snapshot_shape[1:], np.zeros(camera.snapshot_shape[1:], np.int64)
    vignette = np.linspace(0.8, 1.2, size[1])[None].repeat(size[0], 0)
    dark = DarkField(np.full(size, 60.0), np.ones(size), clean, 4)
    flat = FlatField(vignette, 500.0, 0.0, 0.0, clean, 4)
    known = Calibration.empty().with_part("dark", dark, {}).with_part("flat", flat, {})
    found = calibrated_snapshot(taken, known)
    wanted = taken.values / 0.01 / torch.from_numpy(vignette).float() * camera.full_scale / 500
    torch.testing.assert_close(found.values, wanted * (camera.codes()[1].amax(0) > 0), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("name", ["saturation", "snapshot_units_per_dn"])
@pytest.mark.parametrize("number", [0, -1.0, np.nan, np.inf, "abc", None])
def test_a_saturation_or_a_scale_that_is_none_is_refused(tmp_path, name, number):
    camera, lamp = spectral(), Lamp(900)
    setattr(lamp, name, number)
    with pytest.raises(DeviceError, match=f"{name}|ValueError|TypeError"):
        capture(exported(tmp_path, camera), lamp, tmp_path / "frames", gain=None, camera=camera)
    assert not (tmp_path / "frames").exists()


@pytest.mark.parametrize("exposure", ["equal", "per-slot"])
@pytest.mark.parametrize("shutter", ["emulated-shutter", "coded-exposure"])
def test_saturation_is_white_in_one_frame_unless_the_driver_knows_its_scale(tmp_path, exposure, shutter):
    camera, lamp = spectral(exposure=exposure), Lamp(900)
    export = exported(tmp_path, camera, "dli4120", shutter)
    lamp.gain = 12.0  # decibels of its amplifier, which say nothing of a snapshot's units
    found = joined(capture(export, lamp, tmp_path / "frames", gain=None, camera=camera), export, camera)
    white = camera.full_scale if shutter == "coded-exposure" else camera.white
    assert found.notes["gain_per_digital_number"] == pytest.approx(white / 4095)
    lamp.snapshot_units_per_dn = 0.25
    found = joined(capture(export, lamp, tmp_path / "other", gain=None, camera=camera), export, camera)
    assert found.notes["gain_per_digital_number"] == 0.25


@pytest.mark.parametrize("name", ["simulated", "folder"])
def test_no_driver_takes_the_name_of_the_packages_own(tmp_path, plugged, name):
    plugged(name, raising(ImportError("no libdmd.so")))
    if name == "simulated":
        assert isinstance(find_device(name, camera=spectral(), scene=[]), SimulatedBench)
    else:
        with pytest.raises(DataError, match="none: found no such folder"):
            find_device(name, path=tmp_path / "none")
