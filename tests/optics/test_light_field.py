"""View shear against rays drawn one by one."""

import numpy as np
import pytest

from tmca.errors import SettingError
from tmca.optics import MaskGeometry, ViewShear, view_coordinates

BENCH = {"aperture_distance": 0.05, "pixel_pitch": 6e-6, "aperture_width": 0.012}


@pytest.mark.parametrize("mask_pitch", [None, 6e-6, 5e-6])
@pytest.mark.parametrize("views", [1, 5, 7])
def test_rays_cross_the_mask_where_the_shear_says(views, mask_pitch):
    bench = MaskGeometry(mask_distance=1.3e-4, views=views, **BENCH)
    shear = bench.shear(mask_pitch)
    pitch = mask_pitch or bench.mask_pitch
    for pixel in (-120, 0, 77):
        x = pixel * bench.pixel_pitch
        for view in view_coordinates(views):
            u = view * bench.aperture_width / views
            crossing = x + bench.mask_distance / bench.aperture_distance * (u - x)
            assert crossing / pitch == pytest.approx(shear.scale * pixel + shear.step[0] * view, abs=1e-7)


def test_the_mask_for_a_wanted_shear_has_this_shear():
    for step in (0.5, 1.0, 2.25):
        assert MaskGeometry.for_shear(step, views=5, **BENCH).step == pytest.approx(step, rel=1e-12)


def test_the_mask_for_a_pitch_has_this_pitch():
    for pitch in (5.99e-6, 5e-6):
        bench = MaskGeometry.for_pitch(pitch, views=5, **BENCH)
        assert bench.mask_pitch == pytest.approx(pitch, rel=1e-12)
        assert bench.shear(pitch).scale == pytest.approx(1, rel=1e-9)
        again = MaskGeometry.for_shear(bench.step, views=5, **BENCH)
        assert again.mask_distance == pytest.approx(bench.mask_distance, rel=1e-9)


@pytest.mark.parametrize("size", [(5, 8), (7, 6), (1, 1)])
@pytest.mark.parametrize(
    ("step", "scale"), [((1.0, -2.0), 1.0), ((0.4, 1.7), 1.0), ((1.0, 1.0), 0.97), ((0.5, 1), 1.2)]
)
def test_no_ray_of_the_sensor_misses_the_mask(size, step, scale):
    shear = ViewShear((3, 5), step, scale)
    mask, border = shear.mask_size(size), shear.border(size)
    for axis in (0, 1):
        middle = (size[axis] - 1) / 2
        places = [
            scale * (m - middle) + middle + border[axis] + step[axis] * v
            for m in range(size[axis])
            for v in view_coordinates(shear.views[axis])
        ]
        assert min(places) >= -1e-9
        assert max(places) <= mask[axis] - 1 + 1e-9
        if scale == 1:
            assert mask[axis] == size[axis] + 2 * np.ceil(abs(step[axis]) * (shear.views[axis] - 1) / 2)


def bench(**changes):
    return MaskGeometry(**{"mask_distance": 1e-4, **BENCH, **changes})


def sheared(**changes):
    return MaskGeometry.for_shear(**{"step": 1.0, **BENCH, **changes})


@pytest.mark.parametrize(
    ("made", "where"),
    [
        (lambda: ViewShear((4, 5)), "views"), (lambda: ViewShear((11, 1)), "views"),
        (lambda: ViewShear("five"), "views"),
        (lambda: ViewShear((5, 5), (float("nan"), 1)), "shear"), (lambda: ViewShear((3, 3), scale=0.0), "mask_scale"),
        (lambda: bench(mask_distance=0.06), "mask_distance"), (lambda: bench(mask_distance=-1e-4), "mask_distance"),
        (lambda: bench(views=2), "views"), (lambda: bench(pixel_pitch=0.0), "pixel_pitch"),
        (lambda: sheared(views=0), "views"), (lambda: sheared(views=(5, 5)), "views"),
        (lambda: sheared(aperture_width=-0.1), "aperture_width"),
        (lambda: sheared(pixel_pitch=float("nan")), "pixel_pitch"), (lambda: sheared(step=float("nan")), "step"),
        (lambda: sheared(step="1"), "step"), (lambda: sheared(aperture_distance=None), "aperture_distance"),
        *((lambda q=q: MaskGeometry.for_pitch(q, **BENCH), "mask_pitch") for q in (6e-6, 7e-6, -1e-6, None)),
        *((lambda q=q: bench().shear(q), "mask_pitch") for q in (0, -6e-6, float("inf"), "6e-6")),
    ],
)  # fmt: skip
def test_what_is_impossible_names_the_argument_at_fault(made, where):
    with pytest.raises(SettingError) as caught:
        made()
    assert caught.value.where == where


def test_the_drift_of_a_mask_of_the_sensors_pitch_is_what_demagnification_leaves():
    bench = MaskGeometry.for_shear(1.0, views=5, **BENCH)
    shear = bench.shear(mask_pitch=bench.pixel_pitch)
    edge = 240
    crossing = edge * bench.pixel_pitch * (1 - bench.s) / bench.pixel_pitch
    assert shear.drift((2 * edge + 1, 1))[0] == pytest.approx(crossing - edge)
