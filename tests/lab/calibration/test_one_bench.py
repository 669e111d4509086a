"""Codes, patterns and scene on one bench with hidden faults: what was measured of it reconstructs what it captured."""

import pytest
import torch

from tests.lab.acquisition.test_capture import exported
from tmca.cameras import Hardware, SpectralCamera, imperfect
from tmca.errors import DataError
from tmca.lab.acquisition.drivers import find_device
from tmca.lab.acquisition.session import capture, joined
from tmca.lab.calibration.apply import calibrated, calibrated_snapshot
from tmca.lab.calibration.captured import StepSettings
from tmca.lab.calibration.capturing import capture_step
from tmca.lab.calibration.file import Calibration
from tmca.lab.calibration.shots import Asked
from tmca.lab.calibration.steps import measure, measure_all, steps_of
from tmca.lab.display.manifest import exposed_whole, read_manifest
from tmca.sensor import Sensor

SHUTTERS = ("coded-exposure", "emulated-shutter")


def spectral(size=(33, 40), **settings):
    return SpectralCamera(bands=4, size=size, slots=3, shutter="one-hot", seed=2, sensor=Sensor(1e-3), **settings)


def scene_of(camera):
    fine = torch.rand(1, *camera.scene_shape, generator=torch.Generator().manual_seed(3))
    return torch.nn.functional.avg_pool2d(fine.flatten(1, -3), 5, 1, 2).reshape(fine.shape)


def bench_of(camera, export=None, scene=(), hardware=None, **more):
    """The simulated bench that an export is shown on."""
    whole = export is None or exposed_whole(read_manifest(export))
    return find_device("simulated", camera=camera, scene=list(scene), hardware=hardware, whole=whole, **more)


def measured(folder, export, camera, hardware=None, asked=None, known=None):
    """The calibration of a simulated bench, from frames of all steps."""
    waves = tuple(getattr(camera, "wavelengths", ()))
    asked = asked or Asked(frames=8, wavelengths=(*waves[2:], *waves[:2]))
    for step in steps_of(camera, read_manifest(export)):
        if step != "linearity" or camera.sensor.full_well is not None:
            bench = bench_of(camera, export, hardware=hardware)
            capture_step(step, export, bench, folder, camera, asked, bench={"driver": "simulated"})
    return list(measure_all(folder, Calibration.empty(), known or StepSettings(curve="measured")))[-1][1]


def taken(folder, export, camera, hardware=None):
    bench = bench_of(camera, export, [scene_of(camera)], hardware)
    return joined(capture(export, bench, folder, gain=bench.gain), export, camera)


def left(snapshot, scene):
    """Of a snapshot, that its camera's image of the scene leaves, root mean square over its own."""
    with torch.no_grad():
        seen = snapshot.camera.operator().A(scene.flatten(1, -3))
    return float((snapshot.values - seen).norm() / snapshot.values.norm())


FAULTS = (
    {"misregistration": (0.7, -0.4)},
    {"rotation": 0.5, "magnification": 1.01},
    {"dispersion_error": 0.08},
    {"misregistration": (-0.3, 0.6), "rotation": 0.3, "dispersion_error": 0.05},
)
LATE = {"delay": 0.15}
EACH = [(faults, shutter) for faults in FAULTS for shutter in SHUTTERS]
EACH += [(FAULTS[-1] | LATE, SHUTTERS[0]), ({"delay": 0.2}, SHUTTERS[0])]
"""No calibration measures how late the frames of an ordinary camera are."""


@pytest.mark.slow
@pytest.mark.parametrize(("faults", "shutter"), EACH, ids=lambda one: ", ".join(one) if isinstance(one, dict) else one)
def test_a_calibrated_spectral_camera_explains_what_its_bench_captured(tmp_path, faults, shutter):
    camera, hardware = spectral(), Hardware(**faults)
    export = exported(tmp_path, camera, "dli4120", shutter)
    seen = taken(tmp_path / "frames", export, camera, hardware)
    found = calibrated_snapshot(seen, measured(tmp_path / "bench", export, camera, hardware))
    as_drawn, as_measured = left(seen, scene_of(camera)), left(found, scene_of(camera))
    assert as_drawn > 0.05
    assert as_measured < 0.035
    assert as_measured < 0.4 * as_drawn


@pytest.mark.slow
@pytest.mark.parametrize("shutter", SHUTTERS)
@pytest.mark.parametrize("exposure", ["equal", "per-slot"])
@pytest.mark.parametrize("full_well", [None, 5000])
def test_a_faultless_bench_keeps_its_units_noise_and_electrons(tmp_path, full_well, exposure, shutter):
    camera = spectral((40, 45), exposure=exposure).replace(sensor=Sensor(1e-3, full_well=full_well))
    export = exported(tmp_path, camera, "dli4120", shutter)
    seen = taken(tmp_path / "frames", export, camera)
    known = measured(tmp_path / "bench", export, camera, asked=Asked(16, tuple(camera.wavelengths)))
    found = calibrated_snapshot(seen, known.without("dispersion"))
    if full_well is not None:
        assert found.camera.noise.shot == pytest.approx(camera.noise.shot, rel=0.1)
        return
    close = found.camera.codes()[1].amax(0) > 0
    torch.testing.assert_close(found.values[..., close], seen.values[..., close], rtol=5e-3, atol=2e-3)
    assert found.camera.noise.read == pytest.approx(seen.camera.noise.read, rel=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("known", [True, False])
def test_leaks_are_shared_out_whenever_the_mask_is_registered(tmp_path, known):
    camera, hardware, bench = spectral(), Hardware(contrast_ratio=40, leakage=0.02), tmp_path / "bench"
    export = exported(tmp_path, camera, "dli4120", SHUTTERS[0])
    found = measured(bench, export, camera, hardware)
    assert found.part("registration").closed_light == pytest.approx(1 / 40, abs=1e-3)
    assert found.part("timing").leakage == pytest.approx(0.02, abs=1e-3)
    if not known:
        alone = measure("timing", found.without("registration"), bench / "timing")
        found = measure("registration", alone, bench / "registration", StepSettings(bench / "patterns"))
    seen = taken(tmp_path / "frames", export, camera, hardware)
    assert left(calibrated_snapshot(seen, found), scene_of(camera)) < 0.1 * left(seen, scene_of(camera))


def test_even_light_of_a_bench_does_not_stand_for_white(tmp_path):
    camera = spectral((18, 21))
    export, bench = exported(tmp_path, camera), bench_of(camera)
    for step in ("dark", "flat"):
        capture_step(step, export, bench, tmp_path / "bench", camera, Asked(2))
    with pytest.raises(DataError, match="calibrate capture white"):
        list(measure_all(tmp_path / "bench", Calibration.empty(), StepSettings()))


@pytest.mark.slow
def test_a_camera_of_one_slot_is_calibrated_behind_a_coded_exposure(tmp_path):
    camera = SpectralCamera(bands=4, size=(33, 40), slots=1, seed=2, sensor=Sensor(1e-3))
    found = measured(tmp_path / "b", exported(tmp_path, camera, "dli4120", SHUTTERS[0]), camera, None)
    assert set(found.about["steps"]) == {"dark", "flat", "registration", "dispersion"}


@pytest.mark.parametrize(("name", "words"), [("gone", "gone: found no such folder"), ("", "no frames of any step")])
def test_a_folder_without_frames_is_refused(tmp_path, name, words):
    with pytest.raises(DataError, match=words):
        next(measure_all(tmp_path / name, Calibration.empty(), StepSettings()))


@pytest.mark.slow
def test_outside_its_mask_a_device_is_dark(tmp_path):
    """So a mask that is displaced by a pixel leaves a dark row, which the registered one knows."""
    camera, hardware = spectral(), Hardware(misregistration=(1.0, 0.0))
    found = measured(tmp_path / "b", exported(tmp_path, camera, "dli4120", SHUTTERS[1]), camera, hardware)
    own = calibrated(camera, found).codes()[0]
    assert float(own[:, 0].max()) < 1e-3
    assert float(imperfect(camera, hardware).codes()[0][:, 0].max()) == 1
    assert float(imperfect(camera, hardware, 0, "dark").codes()[0][:, 0].max()) == 0
