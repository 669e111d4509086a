"""Cameras with what was measured of them: codes, planes and light are where physics puts them."""

from collections import Counter

import numpy as np
import pytest
import torch

from tests.lab.calibration.test_file import PARTS
from tmca.cameras import Hardware, LightFieldCamera, Snapshot, SpectralCamera, SpectralDepthCamera, imperfect
from tmca.errors import DataError, SettingError
from tmca.lab.calibration.apply import bench_of, calibrated, calibrated_snapshot
from tmca.lab.calibration.displacement import MeasuredDispersion, MeasuredShear
from tmca.lab.calibration.file import Calibration
from tmca.lab.calibration.registration import Registration, nominal_matrix
from tmca.lab.calibration.sensor import DarkField, FlatField
from tmca.lab.calibration.timing import Timing

WAVES = (450e-9, 550e-9, 650e-9)
SIZES = [(8, 11), (9, 12)]


def registered(codes, sensor, matrix=((1, 0, 0), (0, 1, 1)), wavelength=550e-9, **more):
    return Registration(np.array(matrix, float), np.zeros((2, 3)), 0.0, 0.0, codes, sensor, wavelength, **more)


def timed(slots=2, delay=0.0, ratio=1.0, **more):
    return Timing(delay, ratio, np.zeros(2), 1.0, 0.0, slots, **more)


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
        registration=registered(size, sensor),
        dispersion=dispersed([-1, 0, 2]),
        timing=timed(3),
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
    own = with_parts(registration=registered(size, sensor), dispersion=dispersed(shifts))
    taken = calibrated_snapshot(Snapshot(torch.rand(1, 1, *sensor), camera), own)
    nominal = torch.arange(sensor[1], dtype=torch.float32).expand(1, 1, *sensor)
    columns = calibrated_snapshot(Snapshot(nominal + 1, camera), own).values[0, 0, 0] - 1
    for band, shift in enumerate(shifts):
        scene = torch.zeros(1, 3, *size)
        scene[0, band, 3, 10] = 1
        seen = images(taken.camera, scene)[0, 0, 3]
        # scene column 10 is sensor column 11 at 550 nm: there the registration puts it
        assert float((seen * columns).sum() / seen.sum()) == pytest.approx(11 + shift, abs=1e-4)


def test_response_keeps_its_sum_and_has_the_measured_shape():
    camera = SpectralCamera(WAVES, (6, 7), 2, response=[0.5, 0.5, 0.5])
    found = calibrated(camera, with_parts(dispersion=dispersed((0, 1, 2), (0.4, 1.2, 1.4))))
    assert found.response.tolist() == pytest.approx([0.2, 0.6, 0.7])
    assert found.dispersion.displacement == pytest.approx((0, 1, 2))


@pytest.mark.parametrize("exposure", ["equal", "per-slot"])
@pytest.mark.parametrize("late", [(0.3, 1.0), (-0.2, 1.04), (0.1, 0.9)])
def test_slots_that_are_late_mix_as_a_slow_integral_over_time(late, exposure):
    check_integral(exposure, timed(3, *late), 0.0)


@pytest.mark.parametrize("exposure", ["equal", "per-slot"])
@pytest.mark.parametrize("delay", [0.0, 0.3])
def test_closed_codes_leak_as_a_slow_integral_over_time(delay, exposure):
    # of an exposure that repeats, so that the shutter is in one of its slots at all times
    check_integral(exposure, timed(3, delay, repeats=True, leakage=0.02), 0.03)


def check_integral(exposure, timing, passes):
    camera, scene = SpectralCamera(WAVES, (5, 6), timing.slots, exposure=exposure), torch.rand(1, 3, 5, 6)
    mask = registered((5, 6), (5, 8), leakage=passes)
    found = calibrated(camera, with_parts(registration=mask, timing=timing))
    aperture, shutter = (torch.cat([plane, 0 * plane[:1]]) for plane in camera.codes())  # the last one: all shut
    times = (np.arange(100 * timing.slots) + 0.5) / 100
    on = np.floor((times - timing.delay) / timing.ratio).astype(int)
    on = on % timing.slots if timing.repeats else np.where(np.isin(on, range(timing.slots)), on, timing.slots)
    exact = torch.zeros(1, *camera.snapshot_shape)
    for (i, j), count in Counter(zip(times.astype(int), on, strict=True)).items():
        passed, caught = passes + (1 - passes) * aperture[i], timing.leakage + (1 - timing.leakage) * shutter[j]
        one = SpectralCamera(WAVES, (5, 6), 1, aperture=passed[None], shutter=caught[None])
        exact += count / len(times) * camera.exposures * images(one, scene)
    assert torch.allclose(images(found, scene), exact, atol=1e-5)


@pytest.mark.parametrize("exposure", ["equal", "per-slot"])
def test_a_light_field_camera_leaks_as_its_faults_do(exposure):
    camera = LightFieldCamera(3, (8, 9), 2, exposure=exposure)
    place = nominal_matrix(camera.mask_size, camera.size)
    mask = registered(camera.mask_size, (8, 9), place, leakage=1 / 40)
    found = calibrated(camera, with_parts(registration=mask, timing=timed(leakage=0.05)))
    scene = torch.rand(1, 3, 3, 8, 9)
    wanted = images(imperfect(camera, Hardware(contrast_ratio=40, leakage=0.05)), scene)
    assert torch.allclose(images(found, scene), wanted, atol=1e-5)


def test_pixels_whose_code_is_closed_keep_what_leaks_and_defects_are_shut():
    shutter = torch.ones(2, 6, 14)
    shutter[:, 1, 5] = 0
    camera = SpectralCamera(WAVES, (6, 12), 2, shutter=shutter)
    parts = raw_parts((6, 14), hot=[(3, 4)])
    place = registered((6, 12), (6, 14))
    timing = timed(leakage=0.02)
    own = with_parts(**parts, registration=place, dispersion=dispersed((-2.5, 0, 2.5)), timing=timing)
    taken = calibrated_snapshot(Snapshot(torch.ones(1, 1, 6, 14), camera), own)
    seen, wanted = taken.camera.codes()[1][0], torch.ones(6, 14)
    wanted[1, 5], wanted[3, 4] = 0.02, 0
    torch.testing.assert_close(seen, torch.nn.functional.pad(wanted, (2, 2)))
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


@pytest.mark.parametrize(
    ("camera", "notes", "words"),
    [
        (SpectralCamera(WAVES, (8, 9), 2), {"camera_name": "two"}, "a calibration of camera one, expected one of two"),
        (SpectralCamera(WAVES, (8, 10), 2, dispersion=0.5), {}, "codes of 8×9 pixels, expected 8×10"),
        (SpectralCamera(WAVES, (8, 9), 2, dispersion=2.0), {}, "sensor of 8×11 pixels, expected 8×13"),
        (SpectralCamera(WAVES, (8, 9), 3), {}, "a timing of 2 slots, expected 3"),
        (LightFieldCamera(3, (8, 9), 2), {}, "with dispersion, expected one of a light-field camera"),
    ],
)
def test_calibrations_of_other_cameras_are_refused(camera, notes, words):
    own = Calibration.empty("one").with_part("timing", timed(), {}, sensor=(8, 11), codes=(8, 9))
    calibrated(SpectralCamera(WAVES, (8, 9), 2), own, {"camera_name": "one"})
    if camera.kind == "light-field":
        own = with_parts(dispersion=dispersed((0, 1, 2)))
    with pytest.raises(DataError, match=words):
        calibrated(camera, own, notes)


@pytest.mark.parametrize(("told", "now"), [(550e-9, 550e-9), (None, 550e-9), (550e-9, 650e-9)])
def test_a_mask_that_was_registered_again_keeps_the_dispersion(told, now):
    camera = SpectralCamera(WAVES, (8, 9), 2, dispersion=[-1.0, 0.0, 2.0])
    settings = {} if told is None else {"registration_wavelength_m": told}
    again = with_parts(registration=registered((8, 9), (8, 12), [[1, 0, 1], [0, 1, 2]], now))
    found = calibrated(camera, again.with_part("dispersion", dispersed((-1.0, 0.0, 2.0)), {}, settings=settings))
    assert found.dispersion.displacement == pytest.approx(camera.dispersion.displacement)


def test_what_a_mask_was_not_known_to_leak_is_none_of_the_shutter():
    camera = SpectralCamera(WAVES, (8, 9), 2, shutter=torch.eye(2)[:, :, None].expand(2, 2, 11).repeat(1, 4, 1))
    late = timed(leakage=0.03)
    mask = registered((8, 9), (8, 11), leakage=0.01)
    own = with_parts(registration=mask).with_part("timing", late, {}, settings={"aperture_leakage": 0.0})
    assert float(calibrated(camera, own).codes()[1].min()) == pytest.approx(0.02)


def test_what_cannot_be_calibrated_is_said():
    dual = SpectralCamera(WAVES, (8, 9), 2, disperser="dual")
    with pytest.raises(DataError, match="wavefronts of 1 slots, expected 2"):
        calibrated(SpectralDepthCamera(4, (40, 41), 2), with_parts(wavefront0=PARTS["wavefront0"]))
    with pytest.raises(SettingError, match="a single disperser"):
        calibrated(dual, with_parts())
    camera = SpectralCamera(WAVES, (8, 9), 2)
    unknown = registered((8, 9), (8, 11), wavelength=None)
    with pytest.raises(DataError, match="unknown wavelength"):
        calibrated(camera, with_parts(registration=unknown))
    with pytest.raises(SettingError, match="over all bands"):
        calibrated(SpectralCamera((400e-9, 550e-9, 700e-9), (8, 9), 2), with_parts(dispersion=dispersed((0, 1, 2))))


def taken(bench, *scene):
    with torch.no_grad():
        return bench.recorded(Snapshot(bench.camera(*scene), bench.camera))


@pytest.mark.parametrize("size", [(7, 20), (8, 21)])
@pytest.mark.parametrize("shifts", [(-2.5, 0.0, 2.5), (-0.6, 0.0, 0.3)])
def test_the_same_calibration_leads_back_to_the_camera_that_took_it(tmp_path, size, shifts):
    camera = SpectralCamera(WAVES, size, 2, seed=3)
    place = registered(size, camera.snapshot_shape[1:], [[1, 0.01, 0.3], [0, 1, 0.6]])
    parts = {"registration": place, "dispersion": dispersed(shifts), "timing": timed(delay=0.2)}
    known = with_parts(**parts).save(tmp_path / "cam")
    found, scene = bench_of(camera, known.path), torch.rand(1, 3, *size)
    snapshot = taken(found, scene)
    assert snapshot.camera is camera
    back = calibrated_snapshot(snapshot, known)
    with torch.no_grad():
        assert torch.allclose(back.values, calibrated(camera, known).A(scene), atol=1e-6)
        assert not torch.allclose(snapshot.values, camera.A(scene), atol=0.1)
    with pytest.raises(DataError, match="was applied to"):
        calibrated_snapshot(back, known)
