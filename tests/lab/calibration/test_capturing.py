"""Frames of calibration on the simulated bench: what a lamp and a pattern give, pixel by pixel; drivers; resuming."""

import itertools
import json

import numpy as np
import pytest
import torch

from tests.lab.acquisition.test_capture import exported
from tests.lab.calibration.test_one_bench import bench_of
from tmca.cameras import LightFieldCamera, Snapshot, SpectralCamera, SpectralDepthCamera
from tmca.data import read_array
from tmca.errors import DataError, DeviceError, OutputError, SettingError
from tmca.lab.acquisition.drivers import find_device
from tmca.lab.bench import Bench, sets_light, usual_frames
from tmca.lab.calibration.captures import calibration_patterns
from tmca.lab.calibration.capturing import capture_step, shots_of
from tmca.lab.calibration.file import Calibration, load_calibration
from tmca.lab.calibration.shots import Asked
from tmca.lab.calibration.steps import measure_all, not_measured, steps_of
from tmca.lab.cameras import lab_camera
from tmca.lab.cameras.base import Light
from tmca.lab.display.manifest import read_manifest
from tmca.sensor import Sensor

BOTH = ("dli4120", "coded-exposure")


def spectral(size=(17, 20), slots=3, **settings):
    waves = [450e-9, 540e-9, 650e-9]
    return SpectralCamera(waves, size, slots, shutter="one-hot", response=torch.tensor([0.5, 1.0, 0.7]), **settings)


def light_field(size=(16, 19), slots=2):
    return LightFieldCamera(views=3, size=size, slots=slots, shutter="one-hot")


def frame(folder, name, bench):
    """Snapshot units above the black level."""
    return (read_array(folder / f"{name}.tif").astype(float) - bench.black) * bench.gain


@pytest.mark.parametrize("size", [(17, 20), (16, 23)])
@pytest.mark.parametrize("exposure", ["equal", "per-slot"])
def test_a_pattern_in_one_wavelength_is_seen_displaced(tmp_path, size, exposure):
    camera = spectral(size, exposure=exposure)
    bench, asked = bench_of(camera), Asked(wavelengths=(650e-9,), pattern=2)
    folder = capture_step("dispersion", exported(tmp_path, camera, *BOTH), bench, tmp_path / "b", camera, asked)
    seen, pattern = frame(folder, "band_650nm", bench), calibration_patterns(size)[2]
    wanted, shift = np.zeros_like(seen), int(camera.dispersion.displacement[2]) - camera.dispersion.origin
    for y, x in itertools.product(*(range(n) for n in size)):
        wanted[y, x + shift] = pattern[y, x] * 0.8 * 2.2 * 0.7  # the brightest band at 0.8 of white, κ 0.7 of it
    np.testing.assert_allclose(seen, wanted, atol=1.01 * bench.gain * camera.slots)


@pytest.mark.parametrize("size", [(16, 19), (18, 21)])
def test_a_pattern_in_one_view_is_seen_displaced(tmp_path, size):
    camera = light_field(size)
    bench = bench_of(camera)
    folder = capture_step("shear", exported(tmp_path, camera), bench, tmp_path / "b", camera)
    pattern, (rows, columns) = calibration_patterns(camera.mask_size)[3], size
    border = [(m - n) // 2 for m, n in zip(camera.mask_size, size, strict=True)]
    for v, u in ((0, 0), (-1, 1)):
        top, left = border[0] + v, border[1] + u
        share = float(camera.vignetting[v + 1, u + 1] / camera.vignetting.max())
        wanted = 0.8 * camera.white * share * pattern[top : top + rows, left : left + columns]
        np.testing.assert_allclose(frame(folder, f"view_{v}_{u}", bench), wanted, atol=2.02 * bench.gain)


@pytest.mark.parametrize("shutter", ["coded-exposure", "emulated-shutter"])
def test_even_light_and_white_are_exposed_as_the_frames_are(tmp_path, shutter):
    camera = spectral()
    export, bench = exported(tmp_path, camera, "dli4120", shutter), bench_of(camera)
    asked = Asked(frames=2, reflectance=0.25)
    levels = {}
    for step in ("dark", "flat", "white", "linearity"):
        folder = capture_step(step, export, bench, tmp_path / "b", camera, asked)
        levels[step] = {file.stem: frame(folder, file.stem, bench) for file in folder.glob("*.tif")}
    assert np.abs(levels["dark"]["dark_1"]).max() < bench.gain
    np.testing.assert_allclose(levels["flat"]["flat_0"], 0.5 * 2.2, atol=1.01 * bench.gain)
    np.testing.assert_allclose(levels["white"]["white_1"][:, 2:-2], 0.25 * 2.2, atol=1.01 * bench.gain)
    each = 100 / (1 if shutter == "coded-exposure" else 3)
    times = {name: float(name.split("_")[1][:-2]) for name in levels["linearity"]}
    assert min(times.values()) == pytest.approx(0.1 * each, rel=1e-5)
    for name, time in times.items():
        wanted = min(0.5 * 2.2 * time / each, 2.2)
        np.testing.assert_allclose(levels["linearity"][name], wanted, atol=2e-4)


def test_of_many_slots_only_neighbours_are_paired(tmp_path):
    camera = spectral(slots=7)
    manifest = read_manifest(exported(tmp_path, camera, *BOTH))
    pairs = [tuple(map(int, shot.name.split("_")[1::2])) for shot in shots_of("timing", camera, manifest, Asked())]
    wanted = {(i, (i + d) % 7) for i in range(7) for d in (-2, -1, 0, 1, 2)}
    assert len(pairs) == len(wanted) == 35
    assert set(pairs) == wanted


def test_steps_are_those_of_the_camera_and_its_shutter(tmp_path):
    camera = spectral()
    coded = read_manifest(exported(tmp_path / "a", camera, *BOTH))
    emulated = read_manifest(exported(tmp_path / "b", light_field()))
    assert steps_of(camera, coded)[-2:] == ("timing", "dispersion")
    assert "timing" not in steps_of(light_field(), emulated)
    assert steps_of(light_field(), emulated)[-1] == "shear"
    with pytest.raises(SettingError, match="'timing', but the sensor does not code this shutter"):
        shots_of("timing", light_field(), emulated, Asked())
    with pytest.raises(SettingError, match="wavelength"):
        shots_of("registration", camera, coded, Asked())


def test_a_stopped_step_goes_on_and_keeps_its_frames(tmp_path):
    camera = spectral()
    export, out = exported(tmp_path, camera, *BOTH), tmp_path / "b"
    with pytest.raises(DeviceError, match="after 5 frames"):
        capture_step("timing", export, bench_of(camera, stops_after=5), out, camera)
    kept = {file.name: file.stat().st_mtime_ns for file in (out / "timing").glob("*.tif")}
    assert len(kept) == 5
    folder = capture_step("timing", export, bench_of(camera), out, camera)
    assert len(list(folder.glob("*.tif"))) == 9
    assert all((folder / name).stat().st_mtime_ns == time for name, time in kept.items())


def test_frames_of_another_bench_or_other_patterns_are_not_mixed(tmp_path):
    camera = spectral()
    export, out, asked = exported(tmp_path, camera, *BOTH), tmp_path / "b", Asked(wavelengths=(540e-9,))
    capture_step("registration", export, bench_of(camera), out, camera, asked, bench={"seed": 0})
    with pytest.raises(OutputError, match="seed 0"):
        capture_step("registration", export, bench_of(camera), out, camera, asked, bench={"seed": 1})
    with pytest.raises(OutputError, match="other patterns"):
        capture_step("dispersion", export, bench_of(camera), out, camera, Asked(wavelengths=(540e-9,), count=3))


class Driver:
    """A bench whose light a person sets."""

    saturation = 4095.0

    def __init__(self, size, level=900):
        self.frame, self.shown = np.full(size, level, np.uint16), []

    def load(self, export):
        self.slots = export.manifest["slots"]

    def show(self, slot):
        self.shown.append(slot)

    def capture(self, whole=False):
        return self.frame


def test_a_driver_without_a_lamp_takes_one_light_at_a_time(tmp_path):
    camera = spectral()
    export, driver, out = exported(tmp_path, camera, *BOTH), Driver(camera.snapshot_shape[1:]), tmp_path / "b"
    capture_step("registration", export, driver, out, camera, Asked(wavelengths=(540e-9,)))
    assert driver.shown == [0, 1, 2, 3]
    assert driver.slots == 4
    with pytest.raises(SettingError, match="2 lights"):
        capture_step("dispersion", export, driver, out, camera, Asked(wavelengths=(540e-9, 450e-9)))
    for wave in (540e-9, 450e-9):
        folder = capture_step("dispersion", export, driver, out, camera, Asked(wavelengths=(wave,)))
    assert {file.stem for file in folder.glob("*.tif")} == {"band_540nm", "band_450nm"}
    assert len(json.loads((folder / "captures.json").read_text())["frames"]) == 2


@pytest.mark.parametrize(("found", "said"), [((3, 17, 22), "3×17×22"), ((17, 21), "17×21"), ((17, 22), "saturated")])
def test_frames_that_calibration_cannot_use_are_refused(tmp_path, found, said):
    camera = spectral()
    driver = Driver(found, 4095 if said == "saturated" else 900)
    with pytest.raises(DataError, match=said):
        capture_step("dark", exported(tmp_path, camera, *BOTH), driver, tmp_path / "b", camera)


def test_frames_that_were_taken_before_are_no_bench_of_a_calibration(tmp_path):
    camera = spectral()
    export = exported(tmp_path, camera, *BOTH)
    folder = capture_step("dark", export, bench_of(camera), tmp_path / "b", camera, Asked(frames=2))
    with pytest.raises(SettingError, match=r"--device: found FrameFolder.*tmca calibrate STEP FOLDER"):
        capture_step("dark", export, find_device("folder", path=str(folder)), tmp_path / "c", camera, Asked(frames=2))
    assert not (tmp_path / "c").exists()


class Lit(Driver):
    """A bench that sets its light, and keeps what it was told."""

    def __init__(self, size):
        super().__init__(size)
        self.lights, self.exports = [], []

    def load(self, export):
        self.exports.append(export.manifest)

    def illuminate(self, light):
        self.lights.append(light)


def test_a_driver_with_a_lamp_is_told_the_bands_of_the_camera_and_the_settings_of_the_codes(tmp_path):
    camera = spectral()
    export, driver = exported(tmp_path, camera, *BOTH), Lit(camera.snapshot_shape[1:])
    asked = usual_frames(camera, sets_light(driver))
    for step in ("registration", "dispersion"):
        folder = capture_step(step, export, driver, tmp_path / "b", camera, asked)
    assert [light.wavelength for light in driver.lights] == [540e-9] * 4 + [540e-9, 450e-9, 650e-9]
    assert {file.stem for file in folder.glob("*.tif")} == {"band_450nm", "band_540nm", "band_650nm"}
    assert all(list(one["settings"]["sensor"]) == [*camera.snapshot_shape[1:]] for one in driver.exports)
    noted = json.loads((tmp_path / "b" / "registration" / "captures.json").read_text())["taken_with"]
    assert noted["wavelength_nm"] == 540
    shift = camera.dispersion.displacement[1] - camera.dispersion.origin
    assert noted["drawn_map"] == [[1, 0, 0], [0, 1, shift]]


def test_what_a_bench_lacks_is_said_before_its_first_frame(tmp_path):
    camera = spectral()
    export, driver = exported(tmp_path, camera, *BOTH), Driver(camera.snapshot_shape[1:])
    Snapshot(torch.zeros(1, *camera.snapshot_shape), camera).save(tmp_path / "drawn.nc")
    bench = Bench(export, snapshot=Snapshot.load(tmp_path / "drawn.nc"))
    bench.driver, bench.simulated = driver, False
    with pytest.raises(SettingError, match=r"10 lights.*illuminate"):
        bench.calibrate(tmp_path / "b", wavelengths=[450e-9])
    assert driver.shown == []
    assert not (tmp_path / "b").exists()


def test_steps_that_a_calibration_lacks_are_named_by_the_cameras_that_it_may_be_of():
    flat = Calibration({"dark": None, "flat": None}, {"camera": {}, "steps": {}})
    rest = "linearity, registration, timing, dispersion"
    assert not_measured(flat) == f"{rest} (spectral), shear (light-field)"
    assert not_measured(flat, spectral()) == rest
    assert (
        not_measured(flat, spectral(), whole=False)
        == not_measured(flat, spectral(slots=1))
        == rest.replace("timing, ", "")
    )
    whole = Calibration({**flat.parts, **dict.fromkeys(rest.split(", "))}, flat.about)
    assert not_measured(whole) == not_measured(whole, spectral()) == ""


@pytest.mark.parametrize("shutter", ["coded-exposure", "emulated-shutter"])
def test_a_shutter_that_is_laid_on_frames_afterwards_lacks_no_timing(tmp_path, shutter):
    camera = spectral((17, 20), sensor=Sensor(1e-3))
    export = exported(tmp_path, camera, "dli4120", shutter)
    for step in ("dark", "flat", "white"):
        capture_step(step, export, bench_of(camera, export), tmp_path / "b", camera, Asked(2))
    *_, (_, known) = measure_all(tmp_path / "b", Calibration.empty())
    known = load_calibration(str(known.save(tmp_path / "known").path))
    coded = shutter == "coded-exposure"
    assert [("timing" in not_measured(known, *of)) for of in ((), (camera,))] == [coded, coded]


def test_an_export_without_an_aperture_shows_no_patterns(tmp_path):
    camera = spectral((17, 20), slots=3, aperture=torch.ones(3, 17, 20))
    export = exported(tmp_path, camera, "emulated-shutter")
    with pytest.raises(DataError, match="aperture"):
        capture_step("dark", export, bench_of(camera), tmp_path / "b", camera)


@pytest.mark.parametrize(
    ("camera", "light", "said"),
    [
        (spectral(), Light("white", wavelength=500e-9), "450, 540, 650"),
        (spectral(), Light("white", view=(0, 0)), "none of a spectral"),
        (light_field(), Light("white", view=(2, 0)), "one of 3×3, from the middle"),
        (light_field(), Light("point"), "found a point before a light-field camera"),
        (SpectralDepthCamera.from_preset("quick", size=(20, 21), slots=1), Light("point", depth=0.8), "colour filters"),
    ],
)
def test_the_simulated_bench_says_what_it_can_be_lit_with(camera, light, said):
    with pytest.raises(DeviceError, match=said):
        lab_camera(camera).lit(camera, light)


@pytest.mark.parametrize("asked", [{"frames": 1}, {"reflectance": 0}, {"reflectance": float("nan")}, {"pattern": 4}])
def test_impossible_requests_are_refused(asked):
    with pytest.raises(SettingError):
        Asked(**asked)
