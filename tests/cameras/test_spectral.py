"""The spectral camera as a whole."""

import pytest
import torch

from tmca.cameras import SpectralCamera
from tmca.optics import Dispersion


def test_thesis_preset():
    camera = SpectralCamera.from_preset("thesis")
    assert (camera.bands, camera.size, camera.slots) == (12, (256, 256), 8)
    assert camera.snapshot_shape == (1, 256, 267)
    assert camera.wavelengths[0] == pytest.approx(400e-9)
    assert camera.wavelengths[-1] == pytest.approx(700e-9)
    assert camera.full_scale == 12


def test_a_white_scene_through_an_open_camera_is_full_scale():
    camera = SpectralCamera(bands=5, size=(6, 20), slots=3, aperture="open", shutter="open")
    snapshot = camera(torch.ones(1, 5, 6, 20))
    assert snapshot.max().item() == pytest.approx(camera.full_scale)
    assert snapshot[..., 4:20].min().item() == pytest.approx(5)


def test_exposures_differ_by_the_number_of_slots():
    scene = torch.rand(1, 5, 6, 9)
    equal, per_slot = (SpectralCamera(bands=5, size=(6, 9), slots=4, exposure=e) for e in ("equal", "per-slot"))
    assert torch.allclose(4 * equal(scene), per_slot(scene))
    assert per_slot.full_scale == 4 * equal.full_scale
    assert per_slot.throughput() == pytest.approx(equal.throughput())


@pytest.mark.parametrize(("slots", "shutter", "share"), [(1, "open", 0.5), (8, "random", 0.25), (4, "one-hot", 0.125)])
def test_throughput_is_transmittance_times_duty(slots, shutter, share):
    camera = SpectralCamera(size=(100, 100), slots=slots, shutter=shutter)
    assert camera.throughput() == pytest.approx(share, rel=0.03)


@pytest.mark.parametrize("disperser", ["single", "dual"])
@pytest.mark.parametrize("dispersion", [1.0, -0.6])
def test_codes_code_cube_and_operator_agree(disperser, dispersion):
    camera = SpectralCamera(
        bands=4, size=(5, 8), slots=3, dispersion=dispersion, disperser=disperser, response=[1, 2, 3, 4.0]
    )
    camera.double()
    aperture, shutter = camera.codes()
    wide = 8 + camera.dispersion.extent
    assert (aperture.shape[2], shutter.shape[2]) == ((8, wide) if disperser == "single" else (wide, 8))
    light = camera.A_adjoint(torch.ones(1, *camera.snapshot_shape, dtype=torch.float64))[0]
    assert torch.allclose(light, camera.code_cube() * camera.response[:, None, None])


def test_relay_blur_spreads_light_without_making_any():
    sharp, soft = (
        SpectralCamera(bands=3, size=(30, 31), slots=2, relay_blur=b, aperture="open", shutter="open") for b in (0, 1)
    )
    scene = torch.zeros(1, 3, 30, 31)
    scene[:, 1, 15, 15] = 1
    assert soft.A(scene).sum().item() == pytest.approx(sharp.A(scene).sum().item(), rel=1e-5)
    assert soft.A(scene).max().item() == pytest.approx(1 / (2 * torch.pi), rel=0.02)


def test_codes_and_response_learn_when_they_are_parameters():
    kappa = torch.nn.Parameter(torch.ones(3))
    camera = SpectralCamera(bands=3, size=(6, 7), slots=2, learnable=True, response=kappa)
    camera(torch.rand(1, 3, 6, 7)).square().sum().backward()
    moved = [name for name, p in camera.named_parameters() if p.grad is not None and p.grad.abs().sum() > 0]
    assert sorted(moved) == ["codes.aperture.latent", "codes.shutter.latent", "response"]
    assert not list(SpectralCamera(bands=3, size=(6, 7)).parameters())


def test_non_monotone_bands_keep_their_order():
    camera = SpectralCamera(
        bands=3, size=(2, 4), dispersion=Dispersion((2.0, 0.0, 1.0)), aperture="open", shutter="open"
    )
    scene = torch.zeros(1, 3, 2, 4)
    scene[:, 0, :, 0] = 1
    assert camera.A(scene)[0, 0, 0].tolist() == [0, 0, 1, 0, 0, 0]


def coloured_camera(**changes):
    code = torch.rand(4, 6, 7, generator=torch.Generator().manual_seed(0))
    return SpectralCamera(bands=4, size=(6, 7), coloured=code, **changes), code


def test_a_coloured_aperture_weighs_every_band_by_itself():
    camera, code = coloured_camera(dispersion=2)
    scene = torch.rand(2, 4, 6, 7)
    expected = torch.zeros(2, 1, 6, 13)
    for band in range(4):
        expected[:, 0, :, 2 * band : 2 * band + 7] += code[band] * scene[:, band]
    assert torch.allclose(camera.A(scene), expected, atol=1e-6)
    assert camera.throughput() == pytest.approx(float(code.mean()))


def test_a_time_multiplexed_code_is_a_coloured_aperture_that_nobody_made():
    multiplexed = SpectralCamera(bands=4, size=(6, 7), slots=5)
    coloured = SpectralCamera(bands=4, size=(6, 7), coloured=multiplexed.code_cube())
    scene = torch.rand(1, 4, 6, 7)
    assert torch.allclose(coloured.A(scene), multiplexed.A(scene), atol=1e-6)


def test_sizes_that_the_scene_gives_are_not_stated():
    said = repr(SpectralCamera(slots=1))
    assert "bands and size: those of the first scene" in said
    assert not any(text in said for text in ("256", "400 to 700"))
    assert "size: 8×12" in repr(SpectralCamera(size=(8, 12), slots=1))
    assert "scene: 3×8×12" in repr(SpectralCamera(3, (8, 12), slots=1))


@pytest.mark.parametrize(("side", "said"), [(16, "16 × 16 pixels, "), (40, "first 32 × 32 of 40 × 40 pixels, ")])
def test_a_picture_of_codes_names_a_corner_where_it_is_one(side, said):
    figure = SpectralCamera(2, (side, side), slots=1).plot(corner=32)
    assert figure.get_suptitle().startswith(said)
