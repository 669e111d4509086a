"""The phase-mask bench: defocus as geometry and diffraction say, light budget, sampling, named masks."""

import numpy as np
import pytest
import torch
from scipy.special import j1

from tmca.cameras import SpectralDepthCamera
from tmca.errors import SettingError, ShapeError
from tmca.optics import (
    FAMILIES,
    DepthPlanes,
    FocalPlane,
    FreeForm,
    PhaseMaskBench,
    StrayLight,
    Stroke,
    Undersampled,
    check_mask,
    mask_heights,
    steep_share,
    stray_light,
)
from tmca.optics.phase import circular_aperture, mask_field, pixel_places, radians_per_metre
from tmca.optics.zernike import noll, pupil_coordinates

GREEN = 550e-9


def spread(bench, planes, family="flat", **settings):
    return bench.point_spread(mask_heights(family, 1, bench, **settings), [GREEN], planes, "aperture")


def test_a_sharp_point_is_an_airy_disk_summed_over_pixels():
    bench = PhaseMaskBench(diameter=2e-3, focus=1.0, mask_pixels=256, window=(15, 15), oversampling=12)
    found = spread(bench, DepthPlanes(1.0 - 1e-9, 1.0 + 1e-9, 1))()[0, 0, 0]
    fine = (np.arange(15 * 20) - (15 * 20 - 1) / 2) * bench.pitch / 20
    radius = np.hypot(*np.meshgrid(fine, fine)) * np.pi * bench.diameter / (GREEN * bench.distance)
    airy = (2 * j1(radius) / radius) ** 2 * np.pi / 4 * (bench.diameter / (GREEN * bench.distance)) ** 2
    expected = airy.reshape(15, 20, 15, 20).sum((1, 3)) * (bench.pitch / 20) ** 2
    np.testing.assert_allclose(found, expected, atol=5e-3 * expected.max())


def test_a_point_out_of_focus_is_as_wide_as_geometry_says():
    bench = PhaseMaskBench(diameter=4e-3, focus=1.0, mask_pixels=160, window=(63, 63))
    axis = torch.arange(63) - 31
    radius, order = (axis[:, None] ** 2 + axis**2).sqrt().flatten().sort()
    for depth in (0.4, 0.5, 0.55):
        found = spread(bench, DepthPlanes(depth - 1e-9, depth + 1e-9, 1))()[0, 0, 0].flatten()[order]
        half = radius[(found.cumsum(0) >= found.sum() / 2).nonzero()[0]]
        blur = bench.diameter * bench.distance * abs(1 / depth - 1 / bench.focus) / bench.pitch
        assert 2 * 2**0.5 * float(half) == pytest.approx(blur, rel=0.12)


@pytest.mark.parametrize("wavelength", [440e-9, 680e-9])
def test_the_light_of_a_pixel_is_that_of_its_area(wavelength):
    planes = DepthPlanes(0.4, 2.0, 3)
    benches = PhaseMaskBench(), PhaseMaskBench(oversampling=9)
    usual, fine = (
        bench.point_spread(mask_heights("zernike", 1, bench, rms=0.3e-6, seed=3), [wavelength], planes)()
        for bench in benches
    )
    assert float((usual - fine).abs().sum((-2, -1)).max()) < 0.003


@pytest.mark.parametrize("material", ["mirror", "PMMA"])
def test_a_mask_whose_rim_is_a_longer_path_is_sharp_farther_away(material):
    """Higher at the rim by c r² it is a diverging lens: ``1/z = 1/z_f - 2 c Δ``, Δ = 2 on a mirror, else n - 1."""
    bench, bend = PhaseMaskBench(material=material), 0.05
    y, x = pixel_places(bench.mask_size, bench.mask_pitch)
    planes = DepthPlanes(0.4, 5.0, 116)
    known = bench.phase_material()
    factor = 2.0 if known is None else float(known.index([GREEN])[0]) - 1
    heights = FreeForm(torch.stack([bend * (y**2 + x**2), -bend * (y**2 + x**2)]))
    peaks = bench.point_spread(heights, [GREEN], planes)()[:, :, 0].amax((-2, -1))
    sharp = planes.inverse[peaks.argmax(1)]
    expected = torch.tensor([1.5 - 2 * bend * factor, 1.5 + 2 * bend * factor]).double()
    torch.testing.assert_close(sharp, expected, atol=planes.step, rtol=0)


@pytest.mark.parametrize("material", ["fused-silica", "mirror"])
def test_a_fresnel_lens_focuses_its_wavelength(material):
    bench = PhaseMaskBench(
        diameter=1.6e-3, distance=100e-3, focus=None, pitch=1e-6, window=(1, 1), mask_pixels=200, material=material
    )
    heights = mask_heights("lens", 2, bench, wavelength=GREEN)()
    known = bench.phase_material()
    factor = 2 if known is None else known.index([GREEN])[0] - 1
    assert heights.shape == (2, 200, 200)
    assert 0 <= float(heights.min()) <= float(heights.max()) <= GREEN / factor + 1e-12
    aperture = circular_aperture(bench.mask_size)
    field = aperture * mask_field(heights[0], radians_per_metre([GREEN], known))
    plane = FocalPlane(bench.mask_size, bench.mask_pitch, [GREEN], bench.distance, (1, 1), bench.pitch)
    peak = float(plane(field.to(torch.complex64)).abs().squeeze() ** 2)
    best = (float(aperture.sum()) * bench.mask_pitch * bench.pitch / (GREEN * bench.distance)) ** 2
    assert peak == pytest.approx(best, rel=1e-2)


def test_stray_light_is_what_a_larger_window_finds():
    planes = DepthPlanes(0.4, 2.0, 3)
    with pytest.warns(StrayLight, match="window"):
        missed = stray_light(spread(PhaseMaskBench(window=(9, 9)), planes, "zernike", rms=0.2e-6))
    wide = spread(PhaseMaskBench(window=(63, 63)), planes, "zernike", rms=0.2e-6)()
    inner = wide[..., 27:36, 27:36].sum((-2, -1))
    torch.testing.assert_close(missed, 1 - inner, atol=1e-5, rtol=1e-4)


def test_coarse_mask_pixels_and_wide_windows_are_warned_of():
    planes = DepthPlanes(0.2, 5.0, 2)
    with pytest.warns(Undersampled, match="pitch"):
        PhaseMaskBench(diameter=10e-3, mask_pixels=16, window=(3, 3)).check_sampling([GREEN], planes)
    with pytest.warns(Undersampled, match=r"mask, focused.*20 µm is larger than 13\.8 µm.*550 nm.*finer pitch"):
        PhaseMaskBench(distance=50e-3, focus=None, mask_pixels=100).check_sampling([GREEN, 650e-9], planes)
    with pytest.warns(Undersampled, match=r"samples of 6 µm are coarser than 2\.75 µm"):
        PhaseMaskBench(oversampling=1).check_sampling([440e-9, 680e-9], DepthPlanes(0.4, 2.0, 8))
    with pytest.warns(Undersampled, match="repeats"):
        PhaseMaskBench(window=(255, 255), mask_pixels=64).check_sampling([GREEN], planes)


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_shows_maps_of_the_bench_within_the_stroke(family):
    bench = PhaseMaskBench(mask_pixels=32, focus=None if family == "lens" else 2 / 3)
    stroke = Stroke(-0.1e-6, 0.2e-6)
    maps = mask_heights(family, 3, bench, stroke=stroke, learnable=True)
    assert tuple(maps().shape) == (3, 32, 32)
    shown = maps().detach()
    assert float(shown.min()) >= -0.1e-6 - 1e-12
    assert float(shown.max()) <= 0.2e-6 + 1e-12
    assert any(True for _ in maps.parameters())
    again = mask_heights(family, 3, bench, stroke=stroke)
    torch.testing.assert_close(maps(), again())


@pytest.mark.parametrize(
    "wrong",
    [{"diameter": 0}, {"distance": -1.0}, {"pitch": float("nan")}, {"focus": 0.0}, {"window": (8, 9)},
     {"mask_pixels": 1}, {"oversampling": 0}, {"material": "jelly"}],
)  # fmt: skip
def test_an_impossible_bench_is_refused(wrong):
    with pytest.raises(SettingError):
        PhaseMaskBench(**wrong)


def test_impossible_masks_are_refused():
    bench = PhaseMaskBench()
    with pytest.raises(SettingError, match="a lens on a bench with a lens"):
        mask_heights("lens", 1, PhaseMaskBench())
    wrong = (("mask", "bumpy", {}), ("modes", "zernike", {"modes": 0}), ("rms", "zernike", {"rms": -1.0}))
    for where, family, settings in wrong:
        with pytest.raises(SettingError, match=f"^{where}: "):
            mask_heights(family, 2, bench, **settings)


@pytest.mark.parametrize("family", ["zernike", "free-form", "rotational"])
@pytest.mark.parametrize("pixels", [64, 65])
def test_random_masks_have_the_rms_that_is_asked_for(family, pixels):
    bench = PhaseMaskBench(mask_pixels=pixels)
    inside = pupil_coordinates(bench.mask_size)[0] <= 1
    for seed in range(4):
        heights = mask_heights(family, 3, bench, rms=0.2e-6, seed=seed)()[:, inside]
        torch.testing.assert_close(heights.std(1, correction=0), torch.full((3,), 0.2e-6), rtol=0.03, atol=0)
        assert not torch.allclose(heights[0], heights[1])


def test_a_camera_has_as_many_modes_as_are_asked_for():
    made = SpectralDepthCamera(2, (40, 40), slots=2, modes=33, learnable="mask")
    assert made.point_spread.heights.metres().shape == (2, 33)
    assert made.point_spread.heights.modes[-1] == noll(36)


def test_repeated_maps_are_those_of_their_family():
    bench = PhaseMaskBench(mask_pixels=17)
    for family in ("zernike", "free-form", "rotational"):
        maps = mask_heights(family, 1, bench, stroke=Stroke(-2e-7, 2e-7))
        again = maps.repeated(3, learnable=True)
        assert type(again) is type(maps)
        assert again.stroke == maps.stroke
        assert len(list(again.parameters())) == 1
        torch.testing.assert_close(again().detach(), maps().expand(3, -1, -1))
        with pytest.raises(ShapeError, match="as many as there are maps"):
            again.repeated(2)


def test_masks_steeper_than_their_pixels_are_warned_of():
    planes, wide = DepthPlanes(0.4, 2.0, 2), {"rms": 0.2e-6, "seed": 0}
    fine = spread(PhaseMaskBench(mask_pixels=192), planes, "zernike", **wide)
    coarse = spread(PhaseMaskBench(mask_pixels=48), planes, "zernike", **wide)
    error = (coarse() - fine()).abs().sum((-2, -1)).max()
    assert float(error) > 0.04
    with pytest.warns(Undersampled, match="half a wave") as told:
        check_mask(coarse)
    assert len([one for one in told if one.category is Undersampled]) == 1
    assert steep_share(fine.heights, fine.per_metre) < 0.01 < steep_share(coarse.heights, coarse.per_metre)


@pytest.mark.parametrize("pixels", [24, 25])
def test_the_steep_share_is_that_of_a_slow_count(pixels):
    made = spread(PhaseMaskBench(mask_pixels=pixels), DepthPlanes(0.4, 2.0, 2), "zernike", rms=0.3e-6)
    phase = made.heights()[0] * 4 * torch.pi / GREEN  # a mirror: there and back
    y, x = (torch.arange(pixels) + 0.5 - pixels / 2).expand(pixels, pixels).T, torch.arange(pixels) + 0.5 - pixels / 2
    inside = (y**2 + x**2).sqrt() <= pixels / 2
    steep = count = 0
    for i in range(pixels):
        for j in range(pixels):
            for k, m in ((i + 1, j), (i, j + 1)):
                if k < pixels and m < pixels and inside[i, j] and inside[k, m]:
                    count, steep = count + 1, steep + bool(abs(phase[i, j] - phase[k, m]) > torch.pi)
    assert steep_share(made.heights, made.per_metre) == pytest.approx(steep / count)


@pytest.mark.parametrize("height", [float("nan"), float("inf"), 1.0])
def test_heights_that_are_none_are_refused(height):
    with pytest.raises(SettingError, match="heights"):
        FreeForm(torch.full((1, 4, 4), height))
    with pytest.raises(SettingError, match="rms"):
        mask_heights("zernike", 1, PhaseMaskBench(), rms=height)
