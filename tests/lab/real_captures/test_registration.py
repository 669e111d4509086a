"""A mask is found where it lies in a capture, and brought there."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from tests.lab.real_captures.bench import captured, mask_of, smooth_scene
from tmca.errors import DataError, SettingError
from tmca.lab.registering import MaskImage, explained, fine_part, register_mask, registered


@pytest.mark.parametrize("size", [(64, 51), (63, 50)])
def test_a_registered_mask_is_scaled_about_its_middle_and_moved(size):
    """Against a picture whose values between the pixels are known."""
    scale, shift = (1.02, 0.99), (0.3, -0.7)
    y, x = np.mgrid[: size[0], : size[1]].astype(float)
    middle = (np.array(size) - 1) / 2

    def picture(rows, columns):
        return 0.5 + 0.2 * np.cos(rows / 4) + 0.2 * np.sin(columns / 5)

    found = registered(picture(y, x), MaskImage(scale=scale, shift=shift))
    wanted = picture(
        (y - middle[0] - shift[0]) / scale[0] + middle[0], (x - middle[1] - shift[1]) / scale[1] + middle[1]
    )
    np.testing.assert_allclose(found[5:-5, 5:-5], wanted[5:-5, 5:-5], atol=1e-3)


def test_without_a_registration_the_mask_stays_and_blur_is_gaussian():
    mask = mask_of(30, 31)
    np.testing.assert_array_equal(registered(mask, MaskImage()), mask)
    np.testing.assert_allclose(registered(mask, MaskImage(blur=1.2)), gaussian_filter(mask, 1.2))


def test_copies_explain_what_was_made_of_them_with_its_weights():
    mask, weights = fine_part(mask_of(60, 80)), np.array([0.2, 0.7, 0.1, 0.4])
    whole = captured(weights[:, None, None] * np.ones((4, 60, 80)), mask)
    share, found = explained(whole[10:50, 15:65], mask, 10, 15, range(0, 8, 2))
    assert share == pytest.approx(1, abs=1e-9)
    np.testing.assert_allclose(found, weights, atol=1e-9)
    other, _ = explained(whole[10:50, 15:65], mask[:, ::-1], 10, 15, range(0, 8, 2))
    assert other < 0.2


def test_scale_and_shift_are_found_in_a_noisy_capture():
    truth = MaskImage(scale=(1.006, 1.0), shift=(0.35, 0.0))
    mask = mask_of(240, 200)
    scene = smooth_scene(4, 240, 200)
    capture = 0.05 + captured(scene, registered(mask, truth))
    capture += 0.01 * np.random.default_rng(3).standard_normal(capture.shape)
    found, deviation = register_mask([capture], mask, range(0, 8, 2), black=0.05, side=60)
    assert found.scale[0] == pytest.approx(truth.scale[0], abs=5e-4)
    assert found.shift[0] == pytest.approx(truth.shift[0], abs=0.04)
    assert deviation < 0.1


def test_a_capture_of_another_mask_is_refused():
    capture = captured(smooth_scene(4, 150, 150), mask_of(150, 150, seed=5))
    with pytest.raises(DataError, match="blocks that show the mask"):
        register_mask([capture], mask_of(150, 150), range(0, 8, 2), side=60)
    with pytest.raises(SettingError, match="captures"):
        register_mask([], mask_of(20, 20), range(0, 8, 2))
