"""What views show together, on scenes whose geometry is known."""

import numpy as np
import pytest

from tests.metrics.test_disparity import inside, plane, texture
from tmca.errors import SettingError, ShapeError
from tmca.metrics import all_in_focus, disparity_range, view_geometry
from tmca.metrics import psnr as psnr_of
from tmca.metrics.refocusing import has_parallax


def psnr(image, truth):
    return psnr_of(image[None], truth[None])


def two_surfaces(noise=0.0):
    """A near patch before a far plane, its true disparity, and its centre view without noise."""
    y, x = np.mgrid[:60, :70].astype(float)
    field = np.empty((5, 5, 60, 70))
    for v, u in np.ndindex(5, 5):
        front = inside(y + v - 2, x + u - 2)
        field[v, u] = np.where(front, texture(y + v - 2, x + u - 2, 1), texture(y - v + 2, x - u + 2, 2))
    noisy = field + noise * np.random.default_rng(0).normal(size=field.shape)
    return noisy, np.where(inside(y, x), 1.0, -1.0), field[2, 2]


def test_a_plane_has_its_disparity_and_is_sure():
    field, truth = plane(0.0, (3, 3), level=0.4)
    seen = view_geometry(field)
    assert np.abs(seen.disparity - truth)[4:-4, 4:-4].max() < 0.06
    assert np.median(seen.confidence) > 0.5
    assert disparity_range(field) == pytest.approx((0.4, 0.4), abs=0.03)


def test_nothing_is_sure_where_there_is_nothing_to_match():
    flat = np.full((3, 3, 48, 50), 0.5)
    assert view_geometry(flat).confidence[20:-20, 20:-20].max() == 0  # views that end there make borders differ
    assert disparity_range(flat) is None


def test_what_is_sure_is_more_often_right():
    field, truth, _ = two_surfaces(0.05)
    seen = view_geometry(field)
    wrong, sure = np.abs(seen.disparity - truth) > 0.25, seen.confidence > np.median(seen.confidence)
    assert wrong[sure].mean() < 0.5 * wrong[~sure].mean()


def test_the_photograph_in_focus_has_less_noise_than_a_view():
    field, truth, clean = two_surfaces(0.05)
    of_view, of_all = psnr(field[2, 2], clean), psnr(all_in_focus(field, truth), clean)
    assert of_all > of_view + 5
    assert psnr(view_geometry(field).all_in_focus, clean) > of_view + 4


def test_where_views_do_not_agree_the_centre_one_stays():
    field, truth, clean = two_surfaces()
    shifted = np.where(inside(*np.mgrid[:60, :70]), 2.0, truth)  # wrong on the patch alone
    assert np.abs(all_in_focus(field, shifted) - clean)[inside(*np.mgrid[:60, :70])].max() < 0.1
    assert psnr(all_in_focus(field, truth), clean) > 40


def test_colours_have_the_disparity_of_all():
    field, truth, _ = two_surfaces()
    coloured = np.stack([field, 0.5 * field, 0.2 * field])
    sharp = all_in_focus(coloured, truth)
    np.testing.assert_allclose(sharp[0], 2 * sharp[1], rtol=1e-4)
    np.testing.assert_allclose(sharp[0], all_in_focus(field, truth), atol=1e-4)


def test_what_cannot_be_matched_is_refused():
    assert not has_parallax(np.zeros((1, 1, 8, 8)))
    assert not has_parallax(np.zeros((3, 3, 3, 8)))
    assert not has_parallax(np.full((3, 3, 8, 8), np.nan))
    with pytest.raises(ShapeError):
        all_in_focus(np.zeros((3, 3, 8, 8)), np.zeros((8, 9)))
    with pytest.raises(SettingError):
        view_geometry(np.full((3, 3, 8, 8), np.inf))
