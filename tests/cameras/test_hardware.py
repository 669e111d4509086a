"""Cameras on benches with faults, against slow models of the faults."""

import numpy as np
import pytest
import torch

from tmca.cameras import LIMITS, Hardware, LightFieldCamera, SpectralCamera, SpectralDepthCamera, imperfect
from tmca.cameras.faulty import ShutterFaults, in_turn
from tmca.codes import misplaced
from tmca.optics import gaussian_psf
from tmca.sensor import Sensor

SIZES = [(9, 12), (10, 13)]


def spectral(size=(9, 12), **settings):
    return SpectralCamera(bands=4, size=size, slots=3, seed=1, **settings)


def light_field(**settings):
    return LightFieldCamera(views=3, size=(9, 12), slots=3, seed=1, **settings)


def spectral_depth(**settings):
    return SpectralDepthCamera.from_preset("quick", size=(24, 25), slots=2, seed=1, **settings)


def taken(camera, seed=0):
    scene = torch.rand(1, *camera.scene_shape, generator=torch.Generator().manual_seed(seed))
    if isinstance(camera, SpectralDepthCamera):
        return camera(scene, torch.full((1, 1, *camera.size), 0.8), generator=5)
    return camera(scene, generator=5)


def slow(camera, aperture, shutter, scene):
    """Snapshot of a single disperser of whole pixels, slot by slot and band by band."""
    found = torch.zeros(1, 1, *camera.snapshot_shape[1:])
    for k in range(camera.slots):
        for band in range(camera.bands):
            left = int(camera.dispersion.displacement[band]) - camera.dispersion.origin
            window = slice(left, left + camera.size[1])
            found[0, 0, :, window] += shutter[k][:, window] * aperture[k] * scene[0, band] / camera.slots
    return found


@pytest.mark.parametrize("build", [spectral, light_field, spectral_depth])
def test_without_faults_it_is_the_camera(build):
    camera = build(sensor=Sensor(read_noise=0.01, bits=10))
    torch.testing.assert_close(taken(imperfect(camera, Hardware())), taken(camera), rtol=0, atol=1e-6)


def test_a_coloured_aperture_has_no_codes_to_be_at_fault():
    camera = spectral(coloured=torch.rand(4, 9, 12))
    assert imperfect(camera, Hardware(motion=1)) is camera


LATE = {"delay": 0.4, "hot_pixels": 0.1}


@pytest.mark.parametrize(
    ("build", "fault"),
    [
        (spectral, LATE), (light_field, LATE), (spectral_depth, LATE), (light_field, {"shear_error": 0.1}),
        (spectral_depth, {"height_error": 0.2}),
    ],
)  # fmt: skip
def test_the_camera_itself_stays_as_it_is(build, fault):
    camera = build()
    before = taken(camera)
    assert not torch.equal(taken(imperfect(camera, Hardware.of(fault))), before)
    assert torch.equal(taken(camera), before)


@pytest.mark.parametrize("size", SIZES)
def test_contrast_leakage_and_place_are_those_of_the_planes(size):
    camera, hardware = (
        spectral(size),
        Hardware(contrast_ratio=20, leakage=0.05, misregistration=(0.3, -0.6), rotation=2),
    )
    aperture, shutter = camera.codes()
    shown = misplaced(aperture + (1 - aperture) / 20, (0.3, -0.6), 1, 2)
    scene = torch.rand(1, *camera.scene_shape)
    wanted = slow(camera, shown, shutter + (1 - shutter) * 0.05, scene)
    torch.testing.assert_close(imperfect(camera, hardware)(scene), wanted, atol=1e-5, rtol=0)


@pytest.mark.parametrize("size", SIZES)
def test_rows_are_read_one_after_the_other(size):
    """The last row opens a whole slot late: there the shutter is that of the slot before."""
    camera = spectral(size)
    aperture, shutter = camera.codes()
    scene = torch.rand(1, *camera.scene_shape)
    found = imperfect(camera, Hardware(rolling=1))(scene)
    share = torch.linspace(0, 1, size[0])[None, :, None]
    mixed = (1 - share) * shutter + share * shutter.roll(1, 0)
    torch.testing.assert_close(found, slow(camera, aperture, mixed, scene), atol=1e-5, rtol=0)


def test_dead_time_takes_its_share_of_the_light():
    camera = spectral()
    torch.testing.assert_close(taken(imperfect(camera, Hardware(dead_time=0.25))), 0.75 * taken(camera))


@pytest.mark.parametrize("jitter", [0.1, 0.4, 1.0])
@pytest.mark.parametrize("seed", range(4))
def test_no_time_is_recorded_twice_or_lost_however_late_the_shutter_steps(jitter, seed):
    """Every aperture pattern is seen for one slot, also where steps are drawn out of order."""
    faults = ShutterFaults(Hardware(jitter=jitter, delay=-0.3, rolling=1.4, switching=0.6), 5, 4, seed)
    torch.testing.assert_close(faults.overlap.sum(-2), torch.ones(4, 5).double())
    assert float(faults.overlap.min()) > -1e-12


def test_a_pattern_whose_successor_is_due_is_left_out():
    steps = torch.tensor([[0.0, 2.1, 1.9, 3.0], [0.5, 1.0, 5.0, 3.0]])
    torch.testing.assert_close(in_turn(steps), torch.tensor([[0.0, 2.1, 2.1, 3.0], [0.5, 1.0, 4.5, 4.5]]))


def test_jitter_is_drawn_once_for_a_bench():
    camera = spectral()
    one, same, other = (taken(imperfect(camera, Hardware(jitter=0.2), seed)) for seed in (3, 3, 4))
    assert torch.equal(one, same)
    assert not torch.equal(one, other)


@pytest.mark.parametrize("error", [0.25, -0.25, 1.0])
@pytest.mark.parametrize("size", SIZES)
def test_another_dispersion_falls_elsewhere_on_the_same_sensor(error, size):
    camera = spectral(size, shutter="open", dispersion=[0.0, 2.0, 4.0, 8.0])
    scene = torch.rand(1, *camera.scene_shape)
    found = imperfect(camera, Hardware(dispersion_error=error))(scene)
    wanted = torch.zeros_like(found)
    coded = camera.codes()[0].mean(0) * scene[0]
    for band, d in enumerate((0.0, 2.0, 4.0, 8.0)):
        place = 4 + (d - 4) * (1 + error)
        for column in range(size[1]):
            for at, share in ((int(np.floor(place)), 1 - place % 1), (int(np.floor(place)) + 1, place % 1)):
                if 0 <= column + at < wanted.shape[-1]:
                    wanted[0, 0, :, column + at] += share * coded[band, :, column]
    torch.testing.assert_close(found, wanted, atol=1e-5, rtol=0)


@pytest.mark.parametrize("part", [(1, 2, 7, 8), (0, 3, 8, 9)])
@pytest.mark.parametrize(
    "faults", [{}, {"dispersion_error": 0.3}, {"blur": 0.4}, {"dispersion_error": -0.3, "blur": 0.4}]
)
def test_a_part_of_a_bench_is_the_bench_where_the_scene_is_dark_around(part, faults):
    """The light of the part's middle stays within the part: a margin of a pixel is as wide as the blur."""
    top, left, height, width = part
    bench = imperfect(spectral(dispersion=[0.0, 2.0, 4.0, 8.0]), Hardware.of(faults))
    scene = torch.zeros(2, *bench.scene_shape)
    scene[..., top + 1 : top + height - 1, left + 1 : left + width - 1] = torch.rand(2, 4, height - 2, width - 2)
    inside = scene[..., top : top + height, left : left + width]
    whole = bench.A(scene)[..., top : top + height, left : left + width + 8]
    torch.testing.assert_close(bench.window(*part).A(inside), whole, atol=1e-6, rtol=0)
    moving = bench.moving_window(*part).A(inside[:, None].expand(-1, 3, -1, -1, -1))
    torch.testing.assert_close(moving, whole, atol=1e-6, rtol=0)


def test_another_dispersion_has_an_adjoint():
    camera = imperfect(spectral(), Hardware(dispersion_error=0.2)).double()
    x, y = torch.rand(1, *camera.scene_shape).double(), torch.rand(1, *camera.snapshot_shape).double()
    torch.testing.assert_close((camera.A(x) * y).sum(), (x * camera.A_adjoint(y)).sum())


def test_a_coloured_aperture_can_be_displaced_behind_another_prism():
    code, scene = torch.rand(4, 9, 12), torch.rand(1, 4, 9, 12)
    camera = SpectralCamera(bands=4, size=(9, 12), coloured=code, dispersion=[0.0, 2.0, 4.0, 8.0])
    torch.testing.assert_close(imperfect(camera, Hardware())(scene), camera(scene))
    found = imperfect(camera, Hardware(misregistration=(0.4, -0.7), dispersion_error=0.5))(scene)
    wanted, moved = torch.zeros_like(found), misplaced(code, (0.4, -0.7))
    for band, left in enumerate((-2, 1, 4, 10)):
        for column in range(12):
            if 0 <= column + left < wanted.shape[-1]:
                wanted[0, 0, :, column + left] += moved[band, :, column] * scene[0, band, :, column]
    torch.testing.assert_close(found, wanted, atol=1e-5, rtol=0)
    assert torch.equal(camera.code_cube(), code)


@pytest.mark.parametrize("error", [0.3, -0.3])
def test_another_shear_sees_the_mask_elsewhere(error):
    camera = light_field()
    mask, shutter = camera.codes()
    scene = torch.rand(1, 3, 3, 9, 12)
    found, wanted = imperfect(camera, Hardware(shear_error=error))(scene), torch.zeros(1, 1, 9, 12)
    for v in (-1, 0, 1):
        for u in (-1, 0, 1):
            moved = misplaced(mask, (-(1 + error) * v, -(1 + error) * u))[:, 1:-1, 1:-1]
            wanted[0, 0] += (shutter * moved).mean(0) * scene[0, v + 1, u + 1]
    torch.testing.assert_close(found, wanted, atol=1e-5, rtol=0)


def test_a_blurred_mask_is_the_mean_of_its_neighbours():
    camera = light_field(shutter="open")
    seen = imperfect(camera, Hardware(blur=0.6)).codes()[0]
    kernel, mask = gaussian_psf(0.6, 1)[0], camera.codes()[0]
    reach = len(kernel) // 2
    at = mask[0, 5 - reach : 6 + reach, 6 - reach : 7 + reach]
    torch.testing.assert_close(seen[0, 5, 6], (at * kernel).sum(), atol=1e-6, rtol=0)


def test_a_relay_blurs_more():
    known, more = spectral(relay_blur=0.3), spectral(relay_blur=0.5)
    torch.testing.assert_close(taken(imperfect(known, Hardware(blur=0.4))), taken(more))


def test_heights_are_scaled():
    camera = spectral_depth()
    found = imperfect(camera, Hardware(height_error=0.1))
    torch.testing.assert_close(found.codes()[0], 1.1 * camera.codes()[0])
    assert not torch.allclose(taken(found), taken(camera), atol=1e-5)


def test_an_aberration_of_defocus_is_a_mask_of_its_path():
    """A wavefront error is a thickness: path over (n - 1) of the mask at each wavelength."""
    camera = spectral_depth()
    found = imperfect(camera, Hardware(wavefront_error=30e-9), seed=2)
    extra = torch.angle(
        found.point_spread.waves / camera.point_spread.waves.where(camera.point_spread.waves.abs() > 0, torch.ones(()))
    )
    path = extra[0] * torch.tensor(camera.wavelengths)[:, None, None] / (2 * np.pi)
    inside = camera.point_spread.waves[0, 0].abs() > 0
    torch.testing.assert_close(path[0][inside], path[-1][inside], atol=1e-10, rtol=0)
    assert float(path[0][inside].square().mean().sqrt()) == pytest.approx(30e-9, rel=0.1)


def test_masks_that_switch_slowly_share_their_light():
    camera = spectral_depth()
    found = imperfect(camera, Hardware(switching=0.5)).codes()[1]
    shutter = camera.codes()[1]
    torch.testing.assert_close(found, 0.75 * shutter + 0.25 * shutter.roll(-1, 0))


def test_stuck_pixels_are_at_the_same_places_in_every_snapshot():
    camera = imperfect(spectral((40, 41), sensor=Sensor(read_noise=0.01)), Hardware(hot_pixels=0.1, dead_pixels=0.05))
    one, other = taken(camera, 1), taken(camera, 2)
    assert torch.equal(one == camera.full_scale, other == camera.full_scale)
    assert float((one == camera.full_scale).float().mean()) == pytest.approx(0.1, abs=0.02)
    assert float((one == 0).float().mean()) == pytest.approx(0.05, abs=0.02)


def test_codes_learn_through_faults():
    camera = spectral(learnable=True, period=3)
    found = imperfect(camera, Hardware(contrast_ratio=10, switching=0.2, misregistration=0.3))
    found(torch.rand(1, *camera.scene_shape)).square().mean().backward()
    assert float(camera.codes.aperture.latent.grad.abs().sum()) > 0
    assert float(camera.codes.shutter.latent.grad.abs().sum()) > 0


def test_only_the_faults_there_are_are_told():
    told = Hardware.of({"contrast_ratio": 50, "misregistration": [0.1, 0.2]})
    assert told.faults() == {"contrast_ratio": 50.0, "misregistration": (0.1, 0.2)}
    assert set(LIMITS) == set(vars(Hardware()))


def test_pairs_may_be_text():
    assert Hardware.of({"misregistration": "0.5:-1", "delay": "0.1"}) == Hardware(misregistration=(0.5, -1), delay=0.1)
