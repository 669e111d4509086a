"""The light-field camera as its users meet it."""

import pytest
import torch

from tmca.cameras import LightFieldCamera
from tmca.optics import MaskGeometry


def scene(camera, batch=2, seed=0):
    return torch.rand(batch, *camera.scene_shape, generator=torch.Generator().manual_seed(seed))


@pytest.mark.parametrize("exposure", ["equal", "per-slot"])
@pytest.mark.parametrize("size", [(5, 8), (7, 6)])
def test_it_is_the_mean_of_its_slots_taken_one_by_one(size, exposure):
    camera = LightFieldCamera((3, 5), size, 4, shear=(0.5, 1.0), exposure=exposure, vignetting=torch.rand(3, 5) + 0.1)
    light = scene(camera)
    aperture, shutter = camera.codes()
    slots = [
        LightFieldCamera(
            (3, 5), size, 1, shear=(0.5, 1.0), vignetting=camera.vignetting,
            aperture=aperture[k : k + 1], shutter=shutter[k : k + 1],
        ).A(light)
        for k in range(4)
    ]  # fmt: skip
    together = torch.stack(slots).sum(0) / (4 if exposure == "equal" else 1)
    torch.testing.assert_close(camera.A(light), together)
    assert camera.full_scale == pytest.approx(float(camera.vignetting.sum()) * (1 if exposure == "equal" else 4))


def test_light_of_a_slot_meets_the_codes_of_that_slot():
    camera = LightFieldCamera(3, (5, 6), 4)
    light = torch.zeros(1, 4, *camera.scene_shape)
    light[:, 2] = scene(camera, 1)
    aperture, shutter = camera.codes()
    alone = LightFieldCamera(3, (5, 6), 1, aperture=aperture[2:3], shutter=shutter[2:3])
    torch.testing.assert_close(camera(light), alone.A(light[:, 2]) / 4)


def test_throughput_is_the_share_of_light_of_a_white_scene():
    camera = LightFieldCamera(5, (16, 18), 8, transmittance=0.25)
    white = camera.A(torch.ones(1, *camera.scene_shape)).mean() / camera.full_scale
    assert camera.throughput() == pytest.approx(float(white), rel=1e-5)


@pytest.mark.parametrize("exposure", ["equal", "per-slot"])
def test_the_code_seen_from_the_mask_is_that_of_the_sensor_ray_by_ray(exposure):
    camera = LightFieldCamera(3, (7, 8), 4, exposure=exposure)
    cube, seen = camera.code_cube(), camera.code_through_mask()
    for v in range(3):
        for u in range(3):
            torch.testing.assert_close(seen[v, u, v : v + 7, u : u + 8], cube[v, u])


@pytest.mark.parametrize("shear", [1.0, (2.0, -1.0)])
def test_a_static_mask_answers_alike_to_all_angles(shear):
    camera = LightFieldCamera((3, 5), (12, 14), 1, aperture="static", shutter="open", shear=shear)
    seen = camera.code_through_mask()
    top, left = (2 * border for border in camera.shear.border(camera.size))
    inside = seen[:, :, top:-top, left:-left]
    torch.testing.assert_close(inside, camera.codes()[0][0, top:-top, left:-left].expand_as(inside))


def test_thesis_preset():
    camera = LightFieldCamera.from_preset("thesis")
    assert (camera.views, camera.size, camera.slots) == ((5, 5), (270, 480), 8)


def test_a_bench_becomes_a_camera():
    bench = MaskGeometry.for_shear(1.0, aperture_distance=0.05, pixel_pitch=6e-6, aperture_width=0.012)
    assert LightFieldCamera.from_geometry(bench, (9, 12), slots=2).mask_size == (13, 16)
    ignored = LightFieldCamera.from_geometry(bench, (9, 12), mask_pitch=6e-6, slots=2)
    assert ignored.shear.scale == pytest.approx(1 - bench.s)


def test_codes_that_are_learned_get_gradients_and_the_operator_follows_them():
    camera = LightFieldCamera(3, (8, 9), 2, learnable=True, period=4)
    light = scene(camera)
    before = camera.A(light).detach()
    camera.A(light).square().mean().backward()
    for parameter in camera.parameters():
        assert parameter.grad is not None
        assert parameter.grad.abs().sum() > 0
        with torch.no_grad():
            parameter.neg_()
    assert not torch.equal(camera.A(light), before)
