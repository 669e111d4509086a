"""Disparity of light fields whose geometry is known, and the errors of disparity maps worked by hand."""

from __future__ import annotations

import numpy as np
import pytest

from tmca.data import read_disparity, read_light_field
from tmca.errors import SettingError, ShapeError
from tmca.metrics import disparity, disparity_error, estimate_disparity, moved_view


def texture(y, x, seed=0):
    """A smooth random pattern that is known between pixels: forty plane waves of at least five pixels' length."""
    rng = np.random.default_rng(seed)
    angles, lengths, phases = rng.uniform(0, np.pi, 40), rng.uniform(5, 25, 40), rng.uniform(0, 2 * np.pi, 40)
    waves = zip(angles, lengths, phases, strict=True)
    return 0.5 + 0.05 * sum(np.sin(2 * np.pi * (y * np.sin(a) + x * np.cos(a)) / n + p) for a, n, p in waves)


def plane(slope, views=(3, 3), size=(41, 52), level=0.0):
    """A plane of disparity ``level + slope·x``: the ray of view (v, u) at x meets it at (x + u·level)/(1 - u·slope)."""
    y, x = np.mgrid[: size[0], : size[1]].astype(float)
    field = np.empty((*views, *size))
    for v, u in np.ndindex(*views):
        down, right = v - views[0] // 2, u - views[1] // 2
        there = (x + right * level) / (1 - right * slope)
        field[v, u] = texture(y + down * (level + slope * there), there)
    return field, level + slope * x


@pytest.mark.parametrize("level", [-1.3, 0.0, 0.41])
@pytest.mark.parametrize("views", [(3, 3), (1, 5), (5, 1)])
def test_a_fronto_parallel_plane_has_its_disparity(level, views):
    field, truth = plane(0.0, views, level=level)
    estimate = estimate_disparity(field, (-2, 1))
    assert np.abs(estimate - truth)[4:-4, 4:-4].max() < 0.05


def test_a_slanted_plane_is_followed():
    field, truth = plane(0.02, size=(40, 61), level=-0.6)
    assert disparity_error(estimate_disparity(field, (-1, 1)), truth)["mae"] < 0.03


def inside(y, x):
    return (np.abs(y - 30) < 12) & (np.abs(x - 35) < 14)


def test_a_near_patch_is_found_and_what_it_hides_does_not_widen_it():
    y, x = np.mgrid[:60, :70].astype(float)
    field = np.empty((5, 5, 60, 70))
    for v, u in np.ndindex(5, 5):
        down, right = v - 2, u - 2
        front = inside(y + down * 1.0, x + right * 1.0)
        field[v, u] = np.where(front, texture(y + down, x + right, 1), texture(y - down, x - right, 2))
    truth = np.where(inside(y, x), 1.0, -1.0)
    error = np.abs(estimate_disparity(field, (-2, 2)) - truth)
    assert np.median(error) < 0.02
    assert np.mean(error > 0.5) < 0.05


def test_strips_agree_with_the_whole(monkeypatch):
    field, _ = plane(0.01, size=(150, 20))
    whole = estimate_disparity(field, (-1, 1), window=3)
    monkeypatch.setattr(disparity, "_STRIP_BYTES", 1.0)
    np.testing.assert_allclose(estimate_disparity(field, (-1, 1), window=3), whole, atol=1e-3)


def test_colours_and_torch_are_read():
    import torch

    field, _ = plane(0.0, size=(16, 17), level=0.3)
    coloured = torch.tensor(np.stack([0.8 * field, field, 1.2 * field]))
    np.testing.assert_allclose(estimate_disparity(coloured, (0, 1)), estimate_disparity(field, (0, 1)), atol=1e-4)


def test_a_moved_view_is_the_centre():
    field, _ = plane(0.0, size=(31, 33), level=0.7)
    moved, place = moved_view(field[2, 0].astype(np.float32), (1, -1), 0.7)
    assert moved.shape == field[1, 1][place].shape == (30, 32)
    assert np.abs(moved - field[1, 1][place])[2:-2, 2:-2].max() < 0.02


def test_errors_of_a_hand_worked_map():
    truth = np.array([[0.0, 1.0, np.nan], [0.0, 0.0, 2.0]])
    estimate = np.array([[0.05, 1.5, 9.0], [0.0, -0.1, 7.0]])
    mask = np.array([[1, 1, 1], [1, 1, 0]])
    found = disparity_error(estimate, truth, mask)
    assert found["mae"] == pytest.approx(0.65 / 4)
    assert found["badpix"] == pytest.approx(2 / 4)
    assert found["mse_x100"] == pytest.approx(100 * (0.05**2 + 0.5**2 + 0.1**2) / 4)
    assert found["pixels"] == 4
    assert np.isnan(disparity_error(estimate, truth, np.zeros((2, 3)))["mae"])
    of_constant = disparity_error(estimate, np.array([[0.0, 1.0, 4.0], [np.nan, 1.0, 1.0]]))["mae_of_constant"]
    assert of_constant == pytest.approx((1 + 0 + 3 + 0 + 0) / 5)  # the median of the known ones is 1


def test_bad_input_is_refused():
    field = np.zeros((3, 3, 8, 8))
    for shape in ((3, 2, 8, 8), (1, 1, 8, 8), (3, 8, 8), (3, 3, 3, 8)):
        with pytest.raises(ShapeError, match="light_field"):
            estimate_disparity(np.zeros(shape))
    for setting in ({"limits": (1, 1)}, {"limits": (0, np.inf)}, {"labels": 0}, {"window": 0.5}):
        with pytest.raises(SettingError, match=next(iter(setting))):
            estimate_disparity(field, **setting)
    with pytest.raises(SettingError, match="not finite"):
        estimate_disparity(field * np.nan)
    with pytest.raises(ShapeError, match=r"\(2, 2\)"):
        disparity_error(np.zeros((2, 3)), np.zeros((2, 2)))


def test_the_hci_scene_has_its_ground_truth(real_data):
    folder = real_data / "lf" / "hci_antinous"
    truth, part = read_disparity(folder).values, (slice(100, 260), slice(140, 360))
    field = read_light_field(folder, views=3).values[:, :, *part]
    inner = np.zeros((160, 220))
    inner[8:-8, 8:-8] = 1
    found = disparity_error(estimate_disparity(field, (-3.5, 3.5)), truth[part], inner)
    assert found["mae"] < 0.15
    assert found["badpix"] < 0.25
