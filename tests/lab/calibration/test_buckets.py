"""How buckets share light is found from known codes; maps of every bucket are kept, and fit their sensor alone."""

import itertools

import numpy as np
import pytest
import torch

from tests.lab.acquisition.test_capture import exported
from tests.lab.calibration.test_capturing import Driver
from tests.lab.calibration.test_file import PARTS
from tests.lab.calibration.test_one_bench import taken
from tmca.cameras import LightFieldCamera
from tmca.errors import DataError
from tmca.lab.acquisition.session import capture
from tmca.lab.calibration.apply import check_fits, from_digital_numbers
from tmca.lab.calibration.buckets import measure_buckets
from tmca.lab.calibration.file import Calibration, load_calibration
from tmca.lab.calibration.sensor import DarkField, FlatField
from tmca.lab.calibration.steps import measure
from tmca.lab.calibration.timing import measure_timing
from tmca.lab.quality import Doubtful

DEVICES = ("dli4120", "coded-exposure-two-bucket")


def light_field(buckets=2):
    return LightFieldCamera(views=3, size=(32, 35), slots=3, buckets=buckets)


def slow_levels(slots, buckets, leakage, transfer, turns=True):
    """Light of every bucket, slot by slot."""
    levels = np.zeros((buckets + turns, buckets))
    for shown in range(buckets + turns):
        for k in range(slots):
            owner, before = (shown, shown) if shown < buckets else (k % buckets, (k - 1) % slots % buckets)
            light = (1 - transfer * (owner != before)) / slots
            for bucket in range(buckets):
                levels[shown, bucket] += light * (1 - leakage if bucket == owner else leakage / (buckets - 1))
    return levels


@pytest.mark.parametrize("buckets", [2, 3])
@pytest.mark.parametrize("slots", [3, 4])
def test_leakage_and_the_time_of_a_change_follow_from_known_codes(slots, buckets):
    found = measure_buckets(700 * slow_levels(slots, buckets, 0.04, 0.15), slots)
    assert found.leakage == pytest.approx(0.04, abs=1e-6)
    assert found.transfer == pytest.approx(0.15, abs=1e-6)
    assert found.residual < 1e-9
    light = np.eye(buckets)[[0, 1]]
    np.testing.assert_allclose(found.unmixed(slow_levels(slots, buckets, 0.04, 0.0, turns=False)[:2]), light, atol=1e-6)


def test_one_slot_tells_the_leakage_alone():
    found = measure_buckets(slow_levels(1, 2, 0.04, 0.15, turns=False), 1)
    assert found.leakage == pytest.approx(0.04, abs=1e-6)
    assert found.transfer == 0
    assert np.isnan(found.std[1])


@pytest.mark.parametrize("delay", [-0.03, 0.0, 0.2])
def test_a_delay_within_the_time_of_a_change_is_told_by_both_buckets(delay):
    """Against exposures in 500 steps a slot; pixels are in the second bucket but for slot j."""
    slots, transfer, steps = 4, 0.08, 500
    levels = np.zeros((2, slots, slots))
    for j, n in itertools.product(range(slots), range(slots * steps)):
        at = ((n + 0.5) / steps - delay) % slots
        bucket, before = (int(slot % slots != j) for slot in (int(at), int(at) - 1))
        if bucket == before or at % 1 >= transfer:
            levels[bucket, n // steps, j] += 1 / steps
    found = measure_timing(levels[0], others=levels[1], transfer=transfer)
    assert found.delay == pytest.approx(delay, abs=2e-3)
    assert found.ratio == pytest.approx(1, abs=2e-3)


@pytest.mark.parametrize(("harm", "words"), [(lambda x: x[:, ::-1], "exchanged"), (lambda x: 0 * x, "no light")])
def test_buckets_that_are_exchanged_or_dark_are_refused(harm, words):
    with pytest.raises(DataError, match=words):
        measure_buckets(harm(slow_levels(4, 2, 0.02, 0.1)), 4)


def test_light_that_no_leak_explains_is_told():
    levels = slow_levels(4, 2, 0.02, 0.1)
    levels[0] *= 0.8
    assert measure_buckets(levels, 4).residual > 0.05


def two_buckets():
    """A calibration of a sensor of 5×7 pixels with two buckets."""
    maps = [np.stack((one, one + 1)) for one in (PARTS["dark"].mean, PARTS["dark"].read_noise)]
    none, gain = np.zeros((2, 5, 7), np.uint8), np.stack((np.full((5, 7), 0.9), np.full((5, 7), 1.1)))
    none[1, 2, 3] = 1
    parts = {"dark": DarkField(*maps, none, 8), "flat": FlatField(gain, 900.0, 0.01, 1e-4, 0 * none, 8)}
    found = Calibration.empty("bench")
    for name, part in parts.items():
        found = found.with_part(name, part, {}, sensor=(2, 5, 7))
    return found


def test_maps_of_every_bucket_come_back_from_a_file(tmp_path):
    found = two_buckets()
    again = load_calibration(found.save(tmp_path / "bench").path)
    for name in ("mean", "read_noise", "defects"):
        np.testing.assert_array_equal(getattr(again.part("dark"), name), getattr(found.part("dark"), name))
    assert again.about["camera"]["sensor"] == (2, 5, 7)


def frames_of_other_software(folder, known, exchanged=False, names=("bucket_0_0", "bucket_1_0", "in_turn_4_0")):
    """Frames of even light, with a page for each bucket, of a sensor without leaks; and no list of captures."""
    folder.mkdir()
    shares = {"bucket_0_0": (1, 0), "bucket_1_0": (0, 1), "in_turn_4_0": (0.5, 0.5), "in_turn_1_0": (1, 0)}
    gain = known.part("flat").gain[::-1] if exchanged else known.part("flat").gain
    for name in names:
        pages = known.part("dark").mean + 900 * gain * np.array(shares[name])[:, None, None]
        np.save(folder / f"{name}.npy", pages.clip(0).round().astype(np.uint16))
    return folder


@pytest.mark.parametrize("gone", ["bucket_0_0", "bucket_1_0", "in_turn_4_0"])
def test_frames_of_other_software_that_are_missing_are_refused(tmp_path, gone):
    left = [name for name in ("bucket_0_0", "bucket_1_0", "in_turn_4_0") if name != gone]
    folder = frames_of_other_software(tmp_path / "buckets", two_buckets(), names=left)
    with pytest.raises(DataError, match=f"found no frame {gone.replace('4', 'K')}, .*capture it"):
        measure("buckets", two_buckets(), folder)


def test_a_camera_of_one_slot_says_so_by_the_name_of_a_frame(tmp_path):
    names = ("bucket_0_0", "bucket_1_0", "in_turn_1_0")
    folder = frames_of_other_software(tmp_path / "buckets", two_buckets(), names=names)
    assert measure("buckets", two_buckets(), folder).part("buckets").transfer == 0


def test_pages_that_are_exchanged_in_the_flat_alone_are_a_possible_cause(tmp_path):
    folder = frames_of_other_software(tmp_path / "buckets", two_buckets(), exchanged=True)
    with pytest.warns(Doubtful, match="residual of light .* usually 0.01 at most; are the pages .* exchanged"):
        measure("buckets", two_buckets(), folder)


@pytest.mark.parametrize("channels", [1, 3])
def test_digital_numbers_of_every_bucket_have_their_own_offset_and_gain(channels):
    found, light = two_buckets(), torch.rand(2, 2, channels, 5, 7).double()
    dark, flat = (torch.from_numpy(part[:, None]) for part in (found.part("dark").mean, found.part("flat").gain))
    seen = from_digital_numbers((dark + 900 * flat * light).flatten(1, 2), found, 3.0).unflatten(1, (2, channels))
    good = torch.from_numpy(found.defects() == 0)[:, None].expand_as(light)
    torch.testing.assert_close(seen[good], 3 * light[good])


@pytest.mark.parametrize("buckets", [1, 3])
def test_a_calibration_of_other_buckets_is_refused(buckets):
    shutter = "burst" if buckets > 1 else "random"
    camera = LightFieldCamera(views=3, size=(5, 7), slots=3, buckets=buckets, shutter=shutter)
    with pytest.raises(DataError, match="found sensor of 2×5×7 pixels"):
        check_fits(camera, two_buckets())


def test_a_capture_without_one_of_the_buckets_is_refused_and_not_kept(tmp_path):
    camera = light_field()
    export = exported(tmp_path, camera, *DEVICES)
    with pytest.raises(DataError, match="a frame of 32×35, expected 2×32×35"):
        capture(export, Driver((32, 35)), tmp_path / "frames", camera=camera)
    assert not (tmp_path / "frames").exists()


def test_a_sensor_with_other_buckets_than_the_camera_is_refused(tmp_path):
    camera = light_field()
    with pytest.raises(DataError, match="buckets of a sensor: 1, expected the camera's 2"):
        taken(tmp_path / "frames", exported(tmp_path, camera, "dli4120"), camera)
