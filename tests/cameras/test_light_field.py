"""The light-field camera as its users meet it."""

import pytest
import torch

from tmca.cameras import LightFieldCamera
from tmca.errors import SettingError, ShapeError, TmcaError
from tmca.optics import MaskGeometry
from tmca.sensor import Sensor


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


def test_a_scene_that_stands_still_may_be_given_slot_by_slot():
    camera = LightFieldCamera(3, (5, 6), 4)
    light = scene(camera)
    torch.testing.assert_close(camera(light[:, None].expand(-1, 4, -1, -1, -1, -1)), camera(light))


def test_light_of_a_slot_meets_the_codes_of_that_slot():
    camera = LightFieldCamera(3, (5, 6), 4)
    light = torch.zeros(1, 4, *camera.scene_shape)
    light[:, 2] = scene(camera, 1)
    aperture, shutter = camera.codes()
    alone = LightFieldCamera(3, (5, 6), 1, aperture=aperture[2:3], shutter=shutter[2:3])
    torch.testing.assert_close(camera(light), alone.A(light[:, 2]) / 4)


def test_adjoint_and_pseudo_inverse_answer_with_light_fields():
    camera = LightFieldCamera(3, (5, 6), 4, vignetting=torch.rand(3, 3) + 0.2).double()
    light, snapshot = scene(camera).double(), torch.rand(2, 1, 5, 6).double()
    inner = (camera.A(light) * snapshot).sum(), (light * camera.A_adjoint(snapshot)).sum()
    assert float(inner[0]) == pytest.approx(float(inner[1]))
    exact = camera.A(light)
    torch.testing.assert_close(camera.A(camera.A_dagger(exact)), exact)


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


def test_every_preset_takes_a_snapshot_of_its_size():
    for name, slots in (("thesis", 8), ("clfp", 1), ("one-hot", 4), ("quick", 4)):
        camera = LightFieldCamera.from_preset(name, size=(20, 24))
        assert camera.slots == slots
        assert camera(scene(camera, 1)).shape == (1, 1, 20, 24)
    assert LightFieldCamera.from_preset("thesis").size == (270, 480)


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


def test_fixed_codes_that_are_changed_change_the_operator():
    camera = LightFieldCamera(3, (8, 9), 2)
    before = camera.operator()
    assert camera.operator() is before
    camera.codes.shutter.latent.neg_()
    assert camera.operator() is not before


def test_noise_is_in_units_of_one_white_view():
    camera = LightFieldCamera(3, (40, 50), 1, sensor=Sensor(read_noise=0.1), aperture="open", shutter="open")
    noise = camera(torch.full((1, *camera.scene_shape), 0.5), generator=0) - 4.5
    assert float(noise.std()) == pytest.approx(0.1, rel=0.05)


@pytest.mark.parametrize(
    "wrong",
    [
        {"views": 4}, {"views": 11}, {"vignetting": torch.ones(3, 3)}, {"shear": float("inf")}, {"slots": 0},
        {"aperture": torch.ones(8, 8, 9)}, {"shutter": "half"}, {"exposure": "long"}, {"mask_scale": -1.0},
        {"vignetting": -torch.ones(5, 5)}, {"learnable": "mask"},
    ],
)  # fmt: skip
def test_impossible_cameras_are_refused(wrong):
    with pytest.raises(TmcaError):
        LightFieldCamera(**{"views": 5, "size": (8, 9), **wrong})


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"shear": (1,)}, "shear"), ({"shear": "a"}, "shear"), ({"shear": (1, 2, 3)}, "shear"),
        ({"shear": (1, None)}, "shear"), ({"mask_scale": "wide"}, "mask_scale"),
        ({"vignetting": [[1.0], [1.0, 2.0]]}, "vignetting"), ({"vignetting": "dark"}, "vignetting"),
    ],
)  # fmt: skip
def test_what_is_no_number_is_refused_by_its_name(wrong, named):
    with pytest.raises(TmcaError, match=f"^{named}: "):
        LightFieldCamera(**{"views": 5, "size": (8, 9), **wrong})


def test_a_light_field_of_other_views_is_refused():
    camera = LightFieldCamera(5, (8, 9))
    with pytest.raises(ShapeError, match="5, 5, 8, 9"):
        camera(torch.rand(1, 3, 3, 8, 9))
    with pytest.raises(SettingError):
        LightFieldCamera.from_preset("lytro")
