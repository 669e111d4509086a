"""Faults of sensors with several buckets: what one of them loses is in another, unless no shutter is open."""

import pytest
import torch

from tests.operators.test_buckets import CAMERAS, rand, taken
from tmca.cameras.faulty import imperfect
from tmca.errors import SettingError
from tmca.specs import Hardware
from tmca.specs.hardware import BUCKETS

each = pytest.mark.parametrize("name", ["whole", "fractional", "light field", "spectral-depth"])


def buckets(camera, scene):
    return taken(camera, scene).unflatten(1, (camera.buckets, -1))


def recorded(camera, scene):
    depth = () if camera.kind != "spectral-depth" else (torch.full((1, 1, *camera.size), 0.8).double(),)
    return camera(scene, *depth, generator=1).unflatten(1, (camera.buckets, -1))


@each
@pytest.mark.parametrize("shutter", ["random", "burst"])
@pytest.mark.parametrize("faults", [{"leakage": 0.1}, {"delay": 0.3}, {"jitter": 0.1, "rolling": 0.2, "leakage": 0.05}])
def test_light_in_the_wrong_bucket_is_not_lost(name, shutter, faults):
    camera = CAMERAS[name](buckets=2, shutter=shutter).double()
    scene, bench = rand(1, *camera.scene_shape), imperfect(camera, Hardware(**faults)).double()
    exact, seen = buckets(camera, scene), buckets(bench, scene)
    assert not torch.allclose(seen, exact, atol=1e-4)
    torch.testing.assert_close(seen.sum(1), exact.sum(1), atol=1e-5, rtol=1e-5)


@each
def test_leakage_is_the_share_that_falls_into_the_other_bucket(name):
    camera = CAMERAS[name](buckets=2).double()
    scene, bench = rand(1, *camera.scene_shape), imperfect(camera, Hardware(leakage=0.1)).double()
    exact, seen = buckets(camera, scene), buckets(bench, scene)
    torch.testing.assert_close(seen[:, 0], 0.9 * exact[:, 0] + 0.1 * exact[:, 1], atol=1e-5, rtol=1e-5)


@each
def test_most_of_a_buckets_light_is_its_own(name):
    with pytest.raises(SettingError, match=r"leakage: found 0\.7, expected at most 0\.5 with 2 buckets"):
        imperfect(CAMERAS[name](buckets=2), Hardware(leakage=0.7))
    imperfect(CAMERAS[name](buckets=2), Hardware(leakage=0.5))
    imperfect(CAMERAS[name](buckets=1), Hardware(leakage=0.7))


@each
def test_no_bucket_collects_in_the_dead_time(name):
    camera = CAMERAS[name](buckets=2).double()
    scene, bench = rand(1, *camera.scene_shape), imperfect(camera, Hardware(dead_time=0.25)).double()
    torch.testing.assert_close(buckets(bench, scene), 0.75 * buckets(camera, scene), atol=1e-5, rtol=1e-5)


@each
def test_gain_and_offset_are_those_of_the_second_bucket(name):
    camera = CAMERAS[name](buckets=2).double()
    scene, bench = rand(1, *camera.scene_shape), imperfect(camera, Hardware(bucket_gain=0.1, bucket_offset=0.02))
    exact, seen = buckets(camera, scene), recorded(bench.double(), scene)
    torch.testing.assert_close(seen[:, 0], exact[:, 0], atol=1e-6, rtol=1e-6)
    torch.testing.assert_close(seen[:, 1], 1.1 * exact[:, 1] + 0.02 * camera.full_scale, atol=1e-5, rtol=1e-5)


@each
def test_light_is_lost_where_a_pixel_changes_its_bucket_and_nowhere_else(name):
    """A slow model: the first of every slot is lost unless the slot before was in the same bucket."""
    camera, share = CAMERAS[name](buckets=2, shutter="random").double(), 0.2
    shutters = camera.codes()[1]
    shutters = torch.stack((shutters, 1 - shutters))
    kept = shutters.clone()
    for bucket in range(2):
        for k in range(camera.slots):
            changes = (shutters[bucket, k] == 1) & (shutters[bucket, k - 1] == 0)
            kept[bucket, k][changes] = 1 - share
    bench = imperfect(camera, Hardware(transfer=share)).double()
    torch.testing.assert_close(bench.codes()[1].double(), kept.flatten(0, 1).double(), atol=1e-6, rtol=0)


def test_a_change_of_bucket_that_is_late_loses_the_light_of_its_own_time():
    """Of four parts of a slot: the shutter is late by one, and loses one."""
    camera = CAMERAS["whole"](buckets=2, shutter="random").double()
    shutters, parts = camera.codes()[1], 4
    shutters = torch.stack((shutters, 1 - shutters)).repeat_interleave(parts, 1)
    changes = shutters * (1 - shutters.roll(1, 1))
    met = (shutters - changes).roll(1, 1).unflatten(1, (-1, parts)).mean(2)
    bench = imperfect(camera, Hardware(transfer=1 / parts, delay=1 / parts)).double()
    torch.testing.assert_close(bench.codes()[1].double(), met.flatten(0, 1).double(), atol=1e-6, rtol=0)


@pytest.mark.parametrize("fault", BUCKETS)
def test_one_bucket_has_no_other(fault):
    with pytest.raises(SettingError, match="none of a sensor with one bucket"):
        imperfect(CAMERAS["whole"](), Hardware.of({fault: 0.1}))
