"""Every real RGB-D scene is read, aligned and in metres."""

from __future__ import annotations

import numpy as np
import pytest

from tmca.data import fitted_depth, read_rgbd, read_split

SCENES = {
    "rgbd/middlebury/art": ((1088, 1376), False, 0),
    "rgbd/middlebury/moebius": ((1088, 1376), False, 0),
    "rgbd/motorcycle": ((500, 741), True, 27226),
    "rgbd/nyuv2/00000": ((464, 624), True, None),
    "rgbd/nyuv2/00050": ((464, 624), True, None),
    **{f"rgbd/redwood/{frame}": ((480, 640), True, None) for frame in range(5)},
    "lf/hci_antinous": ((512, 512), False, 0),
}


@pytest.mark.parametrize("name", SCENES)
def test_a_real_scene_is_read(real_data, name):
    size, metric, unknown = SCENES[name]
    scene = read_rgbd(real_data / name)
    assert scene["rgb"].shape == (3, *size)
    assert scene["depth"].shape == size
    assert scene.attrs["metric"] is metric
    depth = scene["depth"].values
    assert 0.5 < np.nanmin(depth) < np.nanmax(depth) < 10
    assert scene["depth"].attrs["unknown_pixels"] == np.sum(np.isnan(depth))
    if unknown is not None:
        assert np.sum(np.isnan(depth)) == unknown
    fitted, about = fitted_depth(scene["depth"], 0.4, 2.0)
    assert float(fitted.min()) == pytest.approx(0.4, rel=1e-6)
    assert float(fitted.max()) == pytest.approx(2.0, rel=1e-6)
    assert about["unknown_pixels"] == np.sum(np.isnan(depth))


@pytest.mark.parametrize("split", ["spectral_depth_train", "spectral_depth_test"])
def test_every_entry_of_the_splits_is_known(real_data, split):
    for path in read_split(real_data / "splits" / f"{split}.txt"):
        assert path.relative_to(real_data.resolve()).as_posix() in SCENES


@pytest.mark.parametrize("name", ["rgbd/middlebury/art", "rgbd/middlebury/moebius"])
def test_edges_of_picture_and_depth_fall_together(real_data, name):
    """Shifted against each other by a few pixels, depth and picture agree less."""
    scene = read_rgbd(real_data / name)
    grey = scene["rgb"].values.mean(axis=0) ** 0.45
    edge = np.abs(np.diff(grey, axis=1)) > 0.03
    step = np.abs(np.diff(1 / scene["depth"].values, axis=1)) > 0.01
    together = [np.mean(edge[:, 12:-12] & np.roll(step, shift, axis=1)[:, 12:-12]) for shift in range(-10, 11)]
    assert abs(int(np.argmax(together)) - 10) <= 1


def test_nothing_of_the_white_border_is_left(real_data):
    for frame in ("00000", "00050"):
        rgb = read_rgbd(real_data / "rgbd/nyuv2" / frame)["rgb"].values.min(axis=0)
        for line in (rgb[0], rgb[-1], rgb[:, 0], rgb[:, -1]):
            assert np.mean(line > 0.9) < 0.2
