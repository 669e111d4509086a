"""Faults of sensors with several buckets: what one of them loses is in another, unless no shutter is open."""

import pytest
import torch

from tests.operators.test_buckets import CAMERAS, rand, taken
from tmca.cameras.faulty import imperfect
from tmca.specs import Hardware

each = pytest.mark.parametrize("name", ["whole", "fractional", "light field", "spectral-depth"])


def buckets(camera, scene):
    return taken(camera, scene).unflatten(1, (camera.buckets, -1))


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
def test_no_bucket_collects_in_the_dead_time(name):
    camera = CAMERAS[name](buckets=2).double()
    scene, bench = rand(1, *camera.scene_shape), imperfect(camera, Hardware(dead_time=0.25)).double()
    torch.testing.assert_close(buckets(bench, scene), 0.75 * buckets(camera, scene), atol=1e-5, rtol=1e-5)
