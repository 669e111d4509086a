"""Cameras with what was measured of them: codes, planes and light are where physics puts them."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
import torch

from tmca.cameras import Hardware, LightFieldCamera, Snapshot, SpectralCamera, SpectralDepthCamera, imperfect
from tmca.errors import DataError, SettingError
from tmca.lab.calibration.apply import calibrated, calibrated_snapshot
from tmca.lab.calibration.dispersion import MeasuredDispersion
from tmca.lab.calibration.displacement import MeasuredShear
from tmca.lab.calibration.file import Calibration
from tmca.lab.calibration.psf import ZernikeFit
from tmca.lab.calibration.registration import Registration, nominal_matrix
from tmca.lab.calibration.sensor import DarkField, FlatField
from tmca.lab.calibration.timing import Timing
from tmca.optics.zernike import zernike_modes

WAVES = (450e-9, 550e-9, 650e-9)
SIZES = [(8, 11), (9, 12)]


def registered(codes, sensor, matrix, wavelength=550e-9, blur=0.0):
    return Registration(np.asarray(matrix, float), np.zeros((2, 3)), blur, 0.0, codes, sensor, wavelength)


def dispersed(shifts, response=(1.0, 1.0, 1.0), wavelengths=WAVES):
    """A measured curve that goes through three shifts along x."""
    waves = np.array(wavelengths)
    powers = np.vander((waves - 550e-9) / 100e-9, 3, increasing=True)
    along = np.stack([np.zeros(3), np.linalg.solve(powers, np.array(shifts, float))], axis=1)
    seen = np.stack([np.zeros(3), np.array(shifts, float)], axis=1)
    return MeasuredDispersion(
        waves, seen, np.zeros((3, 2)), "polynomial", along, np.zeros(2), np.array(response, float), np.zeros(3)
    )


def with_parts(**parts):
    found = Calibration.empty()
    for name, part in parts.items():
        found = found.with_part(name, part, {})
    return found


def images(camera, scene):
    with torch.no_grad():
        return camera.A(scene)


@pytest.mark.parametrize("size", SIZES)
def test_a_calibration_of_the_nominal_numbers_changes_nothing(size):
    camera = SpectralCamera(WAVES, size, 3, dispersion=[-1.0, 0.0, 2.0])
    sensor = camera.snapshot_shape[1:]
    own = with_parts(
        registration=registered(size, sensor, [[1, 0, 0], [0, 1, 1]]),
        dispersion=dispersed([-1, 0, 2]),
        timing=Timing(0.0, 1.0, np.zeros(2), 1.0, 0.0, 3),
    )
    scene = torch.rand(1, 3, *size)
    found = calibrated(camera, own)
    assert found.dispersion == camera.dispersion
    assert torch.allclose(images(found, scene), images(camera, scene), atol=1e-5)


@pytest.mark.parametrize("size", SIZES)
def test_codes_that_fall_a_pixel_aside_are_those_of_the_neighbour(size):
    camera = SpectralCamera(WAVES, size, 2)
    own = with_parts(registration=registered(size, camera.snapshot_shape[1:], [[1, 0, 1], [0, 1, 1 + 1]]))
    aperture = calibrated(camera, own).codes()[0]
    assert torch.allclose(aperture[:, 1:, 1:], camera.codes()[0][:, :-1, :-1], atol=1e-6)
    assert float(aperture[:, 0].abs().max()) < 1e-6


@pytest.mark.parametrize("shifts", [(-2.0, 0.0, 1.0), (-0.6, 0.0, 0.3), (-3.4, 0.1, 2.7)])
def test_a_point_falls_where_its_wavelength_was_measured(shifts):
    size = (6, 20)
    camera = SpectralCamera(WAVES, size, 2, aperture="open", shutter="open", dispersion=[0.0, 1.0, 2.0])
    sensor = camera.snapshot_shape[1:]
    own = with_parts(registration=registered(size, sensor, [[1, 0, 0], [0, 1, 1]]), dispersion=dispersed(shifts))
    taken = calibrated_snapshot(Snapshot(torch.rand(1, 1, *sensor), camera), own)
    nominal = torch.arange(sensor[1], dtype=torch.float32).expand(1, 1, *sensor)
    columns = calibrated_snapshot(Snapshot(nominal + 1, camera), own).values[0, 0, 0] - 1
    for band, shift in enumerate(shifts):
        scene = torch.zeros(1, 3, *size)
        scene[0, band, 3, 10] = 1
        seen = images(taken.camera, scene)[0, 0, 3]
        # scene column 10 is sensor column 11 at 550 nm: there the registration puts it
        assert float((seen * columns).sum() / seen.sum()) == pytest.approx(11 + shift, abs=1e-4)


def test_columns_that_the_sensor_does_not_have_are_shut():
    camera = SpectralCamera(WAVES, (6, 12), 2, shutter="open")
    own = with_parts(
        registration=registered((6, 12), (6, 14), [[1, 0, 0], [0, 1, 1]]), dispersion=dispersed((-2.5, 0, 2.5))
    )
    taken = calibrated_snapshot(Snapshot(torch.ones(1, 1, 6, 14), camera), own)
    assert taken.values.shape == (1, 1, 6, 18)
    shut = taken.camera.codes()[1][0, 0] == 0
    assert shut.tolist() == [True, True] + [False] * 14 + [True, True]
    assert torch.equal(taken.values[0, 0, 0] == 0, shut)


def test_response_keeps_its_sum_and_has_the_measured_shape():
    camera = SpectralCamera(WAVES, (6, 7), 2, response=[0.5, 0.5, 0.5])
    found = calibrated(camera, with_parts(dispersion=dispersed((0, 1, 2), (0.4, 1.2, 1.4))))
    assert found.response.tolist() == pytest.approx([0.2, 0.6, 0.7])
    assert found.dispersion.displacement == pytest.approx((0, 1, 2))


@pytest.mark.parametrize("exposure", ["equal", "per-slot"])
@pytest.mark.parametrize(("delay", "ratio"), [(0.3, 1.0), (-0.2, 1.04), (0.1, 0.9)])
def test_slots_that_are_late_mix_as_a_slow_integral_over_time(delay, ratio, exposure):
    camera = SpectralCamera(WAVES, (5, 6), 3, exposure=exposure)
    found = calibrated(camera, with_parts(timing=Timing(delay, ratio, np.zeros(2), 1.0, 0.0, 3)))
    scene = torch.rand(1, 3, 5, 6)
    aperture, shutter = camera.codes()
    light, instants = 0, 3000
    for time in (np.arange(3 * instants) + 0.5) / instants:
        i, j = int(time), int(np.floor((time - delay) / ratio))
        if 0 <= j < 3:
            light = light + torch.nn.functional.one_hot(torch.tensor(3 * i + j), 9).float() / instants
    exact = 0
    for pair in torch.nonzero(torch.as_tensor(light)).flatten().tolist():
        one = SpectralCamera(WAVES, (5, 6), 1, aperture=aperture[pair // 3][None], shutter=shutter[pair % 3][None])
        exact = exact + light[pair] * images(one, scene)
    exact = exact / (3 if exposure == "equal" else 1)
    assert torch.allclose(images(found, scene), exact, atol=3e-3)


@pytest.mark.parametrize("exposure", ["equal", "per-slot"])
@pytest.mark.parametrize("delay", [0.0, 0.3])
def test_closed_codes_leak_as_a_slow_integral_over_time(delay, exposure):
    slots, share, shut = 3, 0.03, 0.02
    camera = SpectralCamera(WAVES, (5, 6), slots, exposure=exposure)
    aperture, shutter = camera.codes()
    mask = replace(registered((5, 6), (5, 8), [[1, 0, 0], [0, 1, 1]]), leakage=share)
    # of an exposure that repeats, so that the shutter is in one of its slots at all times
    timing = Timing(delay, 1.0, np.zeros(2), 1.0, 0.0, slots, True, shut)
    found = calibrated(camera, with_parts(registration=mask, timing=timing))
    scene, exact, instants = torch.rand(1, 3, 5, 6), 0, 40
    for time in (np.arange(slots * instants) + 0.5) / instants:
        passed, caught = aperture[int(time)], shutter[int(np.floor(time - delay)) % slots]
        passed, caught = passed + share * (1 - passed), caught + shut * (1 - caught)
        one = SpectralCamera(WAVES, (5, 6), 1, aperture=passed[None], shutter=caught[None])
        exact = exact + images(one, scene) / instants / (slots if exposure == "equal" else 1)
    assert torch.allclose(images(found, scene), exact, atol=1e-5)


@pytest.mark.parametrize("exposure", ["equal", "per-slot"])
def test_a_light_field_camera_leaks_as_its_faults_do(exposure):
    camera = LightFieldCamera(3, (8, 9), 2, exposure=exposure)
    place = nominal_matrix(camera.mask_size, camera.size)
    mask = replace(registered(camera.mask_size, (8, 9), place), leakage=1 / 40)
    found = calibrated(
        camera, with_parts(registration=mask, timing=Timing(0.0, 1.0, np.zeros(2), 1.0, 0.0, 2, leakage=0.05))
    )
    scene = torch.rand(1, 3, 3, 8, 9)
    wanted = images(imperfect(camera, Hardware(contrast_ratio=40, leakage=0.05)), scene)
    assert torch.allclose(images(found, scene), wanted, atol=1e-5)


def test_pixels_whose_code_is_always_closed_keep_what_leaks_and_defects_are_shut():
    shutter = torch.ones(2, 6, 14)
    shutter[:, 1, 5] = 0
    camera = SpectralCamera(WAVES, (6, 12), 2, shutter=shutter)
    parts = raw_parts((6, 14), hot=[(3, 4)])
    place = registered((6, 12), (6, 14), [[1, 0, 0], [0, 1, 1]])
    timing = Timing(0.0, 1.0, np.zeros(2), 1.0, 0.0, 2, leakage=0.02)
    own = with_parts(**parts, registration=place, dispersion=dispersed((-2.5, 0, 2.5)), timing=timing)
    taken = calibrated_snapshot(Snapshot(torch.ones(1, 1, 6, 14), camera), own)
    seen = taken.camera.codes()[1][0]
    assert seen[1, 5 + 2] == pytest.approx(0.02)
    assert seen[3, 4 + 2] == 0
    assert not seen[:, :2].any()
    assert not seen[:, -2:].any()
    assert torch.equal(taken.values[0, 0] == 0, seen == 0)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("step", [1.0, 2.0])
def test_a_light_field_camera_takes_the_measured_shear(size, step):
    camera = LightFieldCamera(3, size, 2)
    place = nominal_matrix(camera.mask_size, size)
    places = np.array([(v, u) for v in (-1, 0, 1) for u in (-1, 0, 1)])
    light = 1 - 0.1 * (places**2).sum(axis=1)
    shear = MeasuredShear(places, -step * places, np.full(2, step), np.zeros(2), np.zeros(2), 0.0, light)
    found = calibrated(camera, with_parts(registration=registered(camera.mask_size, size, place), shear=shear))
    wide = torch.nn.functional.pad(camera.codes()[0], [int(step) - 1] * 4)
    vignetting = torch.as_tensor(light.reshape(3, 3) * 9 / light.sum())
    exact = LightFieldCamera(
        3, size, 2, aperture=wide, shutter=camera.codes()[1], shear=step, vignetting=vignetting.float()
    )
    scene = torch.rand(1, 3, 3, *size)
    assert torch.allclose(images(found, scene), images(exact, scene), atol=1e-5)


def test_wavefronts_are_added_to_the_heights():
    camera, modes = SpectralDepthCamera(4, (40, 41), 2), ((2, 0), (3, 1))
    fits = {
        f"wavefront{k}": ZernikeFit(
            ((2, 0), (3, 1)), np.array([1e-8, -2e-8 * k]), np.zeros(2), np.zeros((2, 2)), 0.0, 1
        )
        for k in (0, 1)
    }
    change = calibrated(camera, with_parts(**fits)).codes()[0] - camera.codes()[0]
    shapes = zernike_modes(modes, camera.bench.mask_size)
    assert torch.allclose(change[1].double(), 1e-8 * shapes[0] - 2e-8 * shapes[1], atol=1e-12)
    with pytest.raises(DataError, match="measure every slot"):
        calibrated(camera, with_parts(wavefront0=fits["wavefront0"]))


def raw_parts(sensor, hot=()):
    faults = np.zeros(sensor, np.uint8)
    for place in hot:
        faults[place] = 1
    rng = np.random.default_rng(0)
    gain = 1 + 0.02 * rng.standard_normal(sensor)
    return {
        "dark": DarkField(100 + rng.standard_normal(sensor), np.full(sensor, 5.0), faults, 8),
        "flat": FlatField(gain, 2000.0, 0.02, 0.0, np.zeros(sensor, np.uint8), 8),
    }


def test_digital_numbers_become_irradiance_and_defects_are_shut():
    camera = SpectralCamera(WAVES, (8, 9), 2)
    sensor = camera.snapshot_shape[1:]
    parts = raw_parts(sensor, hot=[(3, 4)])
    scene = torch.rand(1, 3, 8, 9)
    exact = images(camera, scene)
    numbers = parts["dark"].mean + parts["flat"].gain * 2000.0 * exact[0, 0].numpy() / camera.full_scale
    numbers[3, 4] = 60000
    taken = Snapshot(torch.from_numpy(numbers)[None, None].float(), camera, {"values": "digital numbers"})
    found = calibrated_snapshot(taken, with_parts(**parts))
    exact[0, 0, 3, 4] = 0
    assert torch.allclose(found.values, exact, atol=1e-4)
    assert torch.allclose(images(found.camera, scene), exact, atol=1e-5)
    assert found.camera.noise.read == pytest.approx(5.0 * camera.full_scale / 2000)
    assert "values" not in found.notes
    with pytest.raises(DataError, match="no dark and flat"):
        calibrated_snapshot(taken, with_parts(dark=parts["dark"]))


def test_calibrations_of_other_cameras_are_refused():
    camera = SpectralCamera(WAVES, (8, 9), 2)
    timing = Timing(0.0, 1.0, np.zeros(2), 1.0, 0.0, 2)
    own = Calibration.empty("one").with_part("timing", timing, {}, sensor=(8, 11), codes=(8, 9))
    calibrated(camera, own, {"camera_name": "one"})
    with pytest.raises(DataError, match="a calibration of camera one, expected one of two"):
        calibrated(camera, own, {"camera_name": "two"})
    with pytest.raises(DataError, match="codes of 8×9 pixels, expected 8×10"):
        calibrated(SpectralCamera(WAVES, (8, 10), 2, dispersion=0.5), own)
    with pytest.raises(DataError, match="sensor of 8×11 pixels, expected 8×13"):
        calibrated(SpectralCamera(WAVES, (8, 9), 2, dispersion=2.0), own)
    with pytest.raises(DataError, match="a timing of 2 slots, expected 3"):
        calibrated(SpectralCamera(WAVES, (8, 9), 3), own)
    with pytest.raises(DataError, match="with dispersion, expected one of a light-field camera"):
        calibrated(LightFieldCamera(3, (8, 9), 2), with_parts(dispersion=dispersed((0, 1, 2))))


def test_calibrations_older_than_the_codes_are_refused():
    camera, now = SpectralCamera(WAVES, (8, 9), 2), datetime.now(UTC)
    own = replace(with_parts(), about={**with_parts().about, "created": now.isoformat()})
    calibrated(camera, own, {"codes_date": (now - timedelta(days=1)).isoformat()})
    with pytest.raises(DataError, match="one after the codes"):
        calibrated(camera, own, {"codes_date": (now + timedelta(days=1)).isoformat()})
    with pytest.raises(DataError, match="a date such as"):
        calibrated(camera, own, {"codes_date": "yesterday"})


def against(told, now, shifts=(-1.0, 0.0, 2.0), waves=WAVES):
    """A calibration whose registration was measured again, at another wavelength."""
    settings = {} if told is None else {"registration_wavelength_m": told}
    place = registered((8, 9), (8, 12), [[1, 0, 0], [0, 1, 1]], wavelength=now)
    own = with_parts(registration=place)
    return own.with_part("dispersion", dispersed(shifts, wavelengths=waves), {}, settings=settings)


@pytest.mark.parametrize("told", [550e-9, None])
def test_a_mask_that_was_registered_again_keeps_the_dispersion(told):
    camera = SpectralCamera(WAVES, (8, 9), 2, dispersion=[-1.0, 0.0, 2.0])
    moved = registered((8, 9), (8, 12), [[1, 0, 1], [0, 1, 2]])
    found = calibrated(camera, against(told, 550e-9).with_part("registration", moved, {}))
    assert found.dispersion == camera.dispersion


def test_a_mask_that_was_registered_again_in_other_light_keeps_what_lies_between_the_wavelengths():
    camera = SpectralCamera(WAVES, (8, 9), 2, dispersion=[-1.0, 0.0, 2.0])
    found = calibrated(camera, against(550e-9, 650e-9))
    assert found.dispersion.displacement == pytest.approx(camera.dispersion.displacement)


def test_what_a_mask_was_not_known_to_leak_is_none_of_the_shutter():
    camera = SpectralCamera(WAVES, (8, 9), 2, shutter=torch.eye(2)[:, :, None].expand(2, 2, 11).repeat(1, 4, 1))
    late = Timing(0.0, 1.0, np.zeros(2), 1.0, 0.0, 2, leakage=0.03)
    mask = replace(registered((8, 9), (8, 11), [[1, 0, 0], [0, 1, 1]]), leakage=0.01)
    own = with_parts(registration=mask).with_part("timing", late, {}, settings={"aperture_leakage": 0.0})
    assert float(calibrated(camera, own).codes()[1].min()) == pytest.approx(0.02)


def test_what_cannot_be_calibrated_is_said():
    dual = SpectralCamera(WAVES, (8, 9), 2, disperser="dual")
    with pytest.raises(SettingError, match="a single disperser"):
        calibrated(dual, with_parts())
    camera = SpectralCamera(WAVES, (8, 9), 2)
    unknown = registered((8, 9), (8, 11), [[1, 0, 0], [0, 1, 1]], wavelength=None)
    with pytest.raises(DataError, match="unknown wavelength"):
        calibrated(camera, with_parts(registration=unknown))
    with pytest.raises(SettingError, match="over all bands"):
        calibrated(SpectralCamera((400e-9, 550e-9, 700e-9), (8, 9), 2), with_parts(dispersion=dispersed((0, 1, 2))))
