"""Depth of rendered captures of known geometry: right within 0.2 % of the range at 30 dB, and honest about the rest."""

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from studies.rendered_table import bench, render_fringes, scene_depth
from tmca.errors import DataError, SettingError, ShapeError
from tmca.lab.ground_truth.depth import REASONS, measure_depth
from tmca.lab.ground_truth.fringes import Capture, FringePlan
from tmca.lab.ground_truth.geometry import ProjectorCalibration

SIZE, RANGE, RAYS = (72, 95), 1.2, 3
FINE = tuple(n * RAYS for n in SIZE)
PLAN = FringePlan()


@lru_cache
def rendered(shape, plan, snr, exposure, seed):
    depth = scene_depth(shape, FINE)
    albedo = 0.35 + 0.6 * np.kron(np.random.default_rng(1).random((20, 27)), np.ones((12, 12)))[: FINE[0], : FINE[1]]
    seen = render_fringes(plan, bench(SIZE), depth, albedo, snr_db=snr, exposure=exposure, seed=seed)
    values = seen.frames.astype(np.float32).reshape(len(plan.fringes), plan.steps, *SIZE)
    capture = Capture(Path("captures"), values, (seen.frames >= 4095).any(axis=0), 1.0)
    parts = depth.reshape(SIZE[0], RAYS, SIZE[1], RAYS).transpose(0, 2, 1, 3).reshape(*SIZE, -1)
    return capture, depth[1::RAYS, 1::RAYS], parts, seen.lit


def captured(shape, plan=PLAN, snr=30.0, exposure=1.0, seed=0):
    """The capture, the truth in the middle of the pixels, the depths in each pixel, and where light falls."""
    return rendered(shape, plan, snr, exposure, seed)


@lru_cache
def measured(shape, fringes=(1, 4, 16, 64), steps=4, **how):
    plan = FringePlan(fringes=fringes, steps=steps)
    capture, truth, parts, lit = captured(shape, plan)
    return measure_depth(capture, plan, bench(SIZE), **how), truth, parts, lit


def percent(error):
    return 100 * np.sqrt(np.nanmean(error**2)) / RANGE


@pytest.mark.parametrize("shape", ["plane", "smooth"])
@pytest.mark.parametrize(("fringes", "steps"), [((1, 4, 16, 64), 4), ((1, 4, 16, 64), 3), ((20, 23, 27), 5)])
def test_smooth_scenes_at_30_db_are_right_within_0_2_percent_of_the_range(shape, fringes, steps):
    found, truth, _, lit = measured(shape, fringes, steps)
    assert percent(found["depth"].values - truth) < 0.2
    assert np.isfinite(found["depth"].values[lit]).mean() > 0.8


def test_scenes_of_steps_are_right_within_0_2_percent_over_all_pixels_that_have_a_depth():
    found, truth, parts, lit = measured("steps")
    assert percent(found["depth"].values - truth) < 0.2
    assert np.isfinite(found["depth"].values[lit & (np.ptp(parts, axis=-1) < 0.03)]).mean() > 0.85


def test_kept_edges_have_a_depth_of_a_surface_that_they_see():
    found, _, parts, _ = measured("steps", neighbours=3)
    nearest = np.abs(found["depth"].values[..., None] - parts).min(axis=-1)
    assert percent(nearest) < 0.3
    assert np.nanmax(nearest) < 0.05


def test_shadows_have_no_depth_but_for_their_edge():
    from scipy.ndimage import binary_erosion

    found, _, _, lit = measured("steps")
    assert (~lit).sum() > 300
    assert not np.isfinite(found["depth"].values[binary_erosion(~lit)]).any()
    assert (found["confidence"].values[binary_erosion(~lit)] == REASONS.index("dark")).mean() > 0.95


@pytest.mark.parametrize("shape", ["plane", "smooth", "steps"])
def test_the_standard_deviation_is_that_of_the_error(shape):
    found, truth, _, _ = measured(shape)
    ratio = (found["depth"].values - truth) / found["depth_std"].values
    assert np.nanmedian(np.abs(ratio)) == pytest.approx(0.6745, rel=0.08)


@pytest.mark.parametrize("how", ["spatial", "graph-cut"])
def test_neighbours_tell_a_smooth_scene_from_two_frequencies(how):
    found, truth, _, lit = measured("plane", (1, 12), 4, unwrap=how)
    assert percent(found["depth"].values - truth) < 0.3
    assert np.isfinite(found["depth"].values[lit]).mean() > 0.9


def test_without_noise_only_rounding_is_left():
    capture, truth, _, _ = captured("smooth", snr=None)
    found = measure_depth(capture, PLAN, bench(SIZE))
    assert np.nanmedian(np.abs(found["depth"].values - truth)) < 2e-4


def test_level_fringes_serve_a_projector_above():

    plan, table = FringePlan(size=(1280, 800), across="y"), bench(SIZE, (1280, 800))
    above = ProjectorCalibration(table.camera, table.projector, np.eye(3), np.array([0.0, -0.2, 0.0]))
    depth = scene_depth("plane", SIZE)
    seen = render_fringes(plan, above, depth, np.ones(SIZE))
    values = seen.frames.astype(np.float32).reshape(4, 4, *SIZE)
    found = measure_depth(Capture(Path("c"), values, np.zeros(SIZE, bool), 1.0), plan, above)
    assert percent(found["depth"].values - depth) < 0.2


def test_saturated_pixels_are_left_out():
    capture, truth, _, _ = captured("plane", exposure=1.3)
    found = measure_depth(capture, PLAN, bench(SIZE))
    assert 0.01 < capture.saturated.mean() < 0.5
    assert (found["confidence"].values[capture.saturated] == REASONS.index("saturated")).all()
    assert not np.isfinite(found["depth"].values[capture.saturated]).any()
    assert percent(found["depth"].values - truth) < 0.2


def test_depths_out_of_range_are_left_out_and_a_scene_of_them_is_refused():
    capture, *_ = captured("smooth")
    found = measure_depth(capture, PLAN, bench(SIZE), far=1.2)
    assert np.nanmax(found["depth"].values) <= 1.2
    with pytest.raises(DataError, match=r"no pixel with a depth .*out of range"):
        measure_depth(capture, PLAN, bench(SIZE), far=0.5)


@pytest.mark.parametrize(
    ("settings", "said"),
    [({"near": 2.0, "far": 1.0}, "near < far"), ({"noise": 0.0}, "above 0"), ({"neighbours": 9}, "0 to 8")],
)
def test_impossible_settings_are_refused(settings, said):
    with pytest.raises(SettingError, match=said):
        measure_depth(captured("plane")[0], PLAN, bench(SIZE), **settings)


def test_a_calibration_of_another_size_is_refused():
    capture, *_ = captured("plane")
    for table, said in ((bench((60, 80)), "60×80"), (bench(SIZE, (400, 640)), "800×1280")):
        with pytest.raises(DataError, match=said):
            measure_depth(capture, PLAN, table)


def test_rendering_refuses_scenes_of_another_size_or_kind():
    with pytest.raises(ShapeError, match="multiples of"):
        render_fringes(FringePlan(), bench(SIZE), np.ones((81, 107)), np.ones((81, 107)))
    with pytest.raises(SettingError, match="'steps'"):
        scene_depth("cliffs", SIZE)
