"""RGB-D scenes from every layout: linear colours, metres by the calibration, unknown pixels counted, never clamped."""

from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image

from tests.data import rgbd_scenes as scenes
from tests.data.light_field_files import hci_name, shifted_plane, write_folder, write_parameters, write_pfm
from tmca.data import describe, fitted_depth, read, read_rgbd, read_split
from tmca.errors import DataError, SettingError


def curve(stored):
    """IEC 61966-2-1, value by value."""
    values = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in (stored / 255).ravel()]
    return np.array(values).reshape(stored.shape)


@pytest.mark.parametrize("size", [(37, 52), (36, 51)])
def test_a_middlebury_2014_folder_follows_its_calibration(tmp_path, size):
    scene = read_rgbd(scenes.middlebury_2014(tmp_path / "bike", size))
    assert scene["rgb"].dims == ("colour", "y", "x")
    assert scene["rgb"].dtype == scene["depth"].dtype == np.float32
    np.testing.assert_allclose(scene["rgb"], np.moveaxis(curve(scenes.picture(size)), -1, 0), atol=1e-6)
    disparity = scenes.disparities(size)
    known = np.isfinite(disparity)
    truth = scenes.FOCAL * scenes.BASELINE_MM / 1000 / (disparity[known] + scenes.OFFSET)
    np.testing.assert_allclose(scene["depth"].values[known], truth, rtol=1e-6)
    assert np.isnan(scene["depth"].values[3, 4])
    assert scene["depth"].attrs["unknown_pixels"] == scene["depth"].attrs["unknown_not_finite"] == 1
    about = scene.attrs
    assert (about["name"], about["metric"], about["focal_px"], about["offset_px"]) == ("bike", True, 1234.5, 23.75)
    assert about["baseline_m"] == pytest.approx(0.17825)


@pytest.mark.parametrize("size", [(110, 141), (97, 130)])
def test_a_hole_filled_map_lies_in_the_middle_of_its_picture(tmp_path, size):
    stem, disparity = scenes.hole_filled(tmp_path, size)
    whole = curve(scenes.picture(size))
    top, left = ((n - n // 32 * 32) // 2 for n in size)
    inner = whole[top : top + disparity.shape[0], left : left + disparity.shape[1]]
    for path in (stem, tmp_path / "art_rgb.png", tmp_path / "art_disp.png"):
        scene = read_rgbd(path)
        np.testing.assert_allclose(np.moveaxis(scene["rgb"].values, 0, -1), inner, atol=1e-6)
        assert np.isnan(scene["depth"].values[-1, -1])
        assert scene.attrs["metric"] is False
    # The share of focal length at this height; the offset is not in the files.
    truth = 3740 * size[0] / 1110 * 0.16 / disparity[0, 0]
    assert scene["depth"].values[0, 0] == pytest.approx(truth, rel=1e-6)


def test_the_original_folder_of_2005_is_read(tmp_path):
    folder = tmp_path / "Dolls"
    scenes.write_picture(folder / "view1.png", scenes.picture((37, 52)))
    scenes.write_picture(folder / "disp1.png", np.full((37, 52), 100, np.uint8))
    (folder / "dmin.txt").write_text("50")
    assert read_rgbd(folder)["depth"].values[0, 0] == pytest.approx(3740 * 37 / 1110 * 0.16 / 150, rel=1e-6)


def test_scikit_images_motorcycle_has_its_known_calibration_at_any_width(tmp_path):
    for width in (741, 52):
        folder = tmp_path / str(width) / "motorcycle"
        scenes.write_picture(folder / "motorcycle_left.png", scenes.picture((10, width)))
        np.savez(folder / "motorcycle_disp.npz", np.full((10, width), 30.0 * width / 741, np.float32))
        scene = read_rgbd(folder)
        assert scene["depth"].values[4, 4] == pytest.approx(994.978 * 0.193001 / (30 + 31.086), rel=1e-6)
        assert scene.attrs["metric"] is True


def test_disparity_without_calibration_keeps_the_order_and_says_so(tmp_path):
    scenes.write_picture(tmp_path / "chair_left.png", scenes.picture())
    np.savez(tmp_path / "chair_disp.npz", scenes.disparities())
    scene = read_rgbd(tmp_path / "chair")
    assert scene.attrs["metric"] is False
    assert float(scene["depth"].min()) == 1
    assert float(scene["depth"].max()) == 2
    disparity = scenes.disparities()
    known = np.isfinite(disparity)
    ratio = np.polyfit(disparity[known], 1 / scene["depth"].values[known], 1)
    np.testing.assert_allclose(np.polyval(ratio, disparity[known]), 1 / scene["depth"].values[known], rtol=1e-5)


@pytest.mark.parametrize("border", [0, 6])
def test_nyu_frames_lose_a_white_border_and_zeros_are_holes(tmp_path, border):
    scene = read_rgbd(scenes.nyuv2(tmp_path / "nyu", border=border))
    cut = slice(8, -8) if border else slice(None)
    truth = scenes.millimetres()[cut, cut] / 1000
    np.testing.assert_allclose(scene["depth"].values, np.where(truth == 0, np.nan, truth), rtol=1e-6)
    assert scene["depth"].attrs["unknown_zero"] == (0 if border else 5)
    assert scene["rgb"].shape[1:] == truth.shape
    assert scene.attrs["name"] == "nyu_00007"
    assert scene.attrs["focal_px"] == pytest.approx(518.858, abs=1e-3)


def test_annotations_beside_nyu_frames_are_used(tmp_path):
    stem = scenes.nyuv2(tmp_path)
    entry = {"cam_in": [500.5, 501, 1, 1], "rgb": "some/where/rgb_00007.png", "depth_scale": 2000.0}
    (tmp_path / "metric3d_annotations.json").write_text(json.dumps({"files": [entry]}))
    scene = read_rgbd(stem)
    assert scene.attrs["focal_px"] == 500.5
    assert float(scene["depth"].max()) == pytest.approx(scenes.millimetres().max() / 2000)


def test_open3d_frames_are_millimetres(tmp_path):
    scene = read_rgbd(scenes.open3d(tmp_path))
    assert float(scene["depth"].max()) == pytest.approx(scenes.millimetres().max() / 1000)
    assert scene["depth"].attrs["unknown_zero"] == 5
    assert scene.attrs["focal_px"] == 525.5
    for place in (tmp_path / "room_color_3.png", tmp_path / "room_3", tmp_path):
        assert read_rgbd(place)["depth"].identical(scene["depth"])
    assert "focal_px" not in read_rgbd(scenes.open3d(tmp_path / "other", camera=False)).attrs


@pytest.mark.parametrize("step", [-0.5, 2])
def test_the_disparity_of_a_light_field_gives_metres_by_its_parameters(tmp_path, step):
    views = np.repeat(shifted_plane(3, (40, 48))[..., None], 3, axis=-1)
    folder = write_folder(tmp_path / "plane", views, hci_name(3))
    write_parameters(folder, side=3)
    write_pfm(folder / "gt_disp_lowres.pfm", np.full((40, 48), float(step)))
    scene = read_rgbd(folder)
    # Similar triangles with parallel cameras whose sensors are shifted to meet at 10 m; 35 mm is the longer side.
    focal = 100 / 35 * 48
    np.testing.assert_allclose(scene["depth"], 1 / (step / (focal * 0.05) + 1 / 10), rtol=1e-6)
    assert (float(scene["depth"][0, 0]) < 10) == (step > 0)
    assert scene.attrs["metric"] is True
    np.testing.assert_allclose(np.moveaxis(scene["rgb"].values, 0, -1), curve(views[1, 1]), atol=1e-6)
    (folder / "parameters.cfg").unlink()
    assert read_rgbd(folder).attrs["metric"] is False


def test_scale_averages_light_and_samples_depth(tmp_path):
    stem = scenes.open3d(tmp_path)
    whole, small = read_rgbd(stem), read_rgbd(stem, scale=4, crop=(6, 8))
    assert small["rgb"].shape == (3, 6, 8)
    means = whole["rgb"].values.reshape(3, 10, 4, 15, 4).mean(axis=(2, 4))[:, 2:8, 3:11]
    np.testing.assert_allclose(small["rgb"], means, atol=1e-6)
    assert np.isin(small["depth"].values, whole["depth"].values).all()
    with pytest.raises(SettingError, match="crop"):
        read_rgbd(stem, crop=(99, 9))


def test_describe_tells_depth_and_what_is_unknown(tmp_path):
    about = describe(scenes.open3d(tmp_path))
    assert (about["kind"], about["format"]) == ("RGB-D scene", "Open3D")
    assert about["variables"]["rgb"]["shape"] == [3, 40, 60]
    facts = about["depth"]
    assert (facts["pixels"], facts["unknown_pixels"], facts["unknown_zero"], facts["metric"]) == (2400, 5, 5, True)
    known = scenes.millimetres()[scenes.millimetres() > 0]
    assert facts["near"] == pytest.approx(known.min() / 1000)
    assert facts["far"] == pytest.approx(known.max() / 1000)
    json.dumps(about, allow_nan=False)


# Bad input


def two_frames(folder):
    scenes.nyuv2(folder, "00007")
    scenes.nyuv2(folder, "00008")


def two_rooms(folder):
    scenes.open3d(folder)
    for kind in ("color", "depth"):
        (folder / f"hall_{kind}_3.png").write_bytes((folder / f"room_{kind}_3.png").read_bytes())


def nyu_without_depth(folder):
    scenes.nyuv2(folder)
    (folder / "sync_depth_00007.png").unlink()


def bike_without(name, *keys):
    def write(folder):
        scenes.middlebury_2014(folder, without=keys)
        (folder / name).unlink() if name else None

    return write


def room_with(name, pixels):
    def write(folder):
        scenes.open3d(folder)
        scenes.write_picture(folder / name, pixels)

    return write


def room_cut(name):
    def write(folder):
        scenes.open3d(folder)
        (folder / name).write_bytes((folder / name).read_bytes()[:900])

    return write


def room_camera(text):
    def write(folder):
        scenes.open3d(folder)
        (folder / "camera_primesense.json").write_text(text)

    return write


def art_cut(folder):
    _, disparity = scenes.hole_filled(folder)
    scenes.write_picture(folder / "art_disp.png", disparity[:-1])


COLOUR, DEPTH = "room_color_3.png", "room_depth_3.png"
FLAT = np.full((40, 60), 9, np.uint8)
UNUSABLE = {
    "no depth map": (nyu_without_depth, "00007", "rgb_00007.png", "sync_depth_00007.png"),
    "no depth map beside the picture": (nyu_without_depth, "rgb_00007.png", "rgb_00007.png", "sync_depth_00007.png"),
    "no picture": (bike_without("im0.png"), "", "disp0.pfm", "im0.png"),
    "no calibration": (bike_without("calib.txt"), "", "calib.txt", "no such file"),
    **{f"no {key}": (bike_without("", key), "", "calib.txt", key) for key in ("cam0", "baseline", "doffs")},
    "another size": (room_with(DEPTH, scenes.millimetres((40, 59))), "3", "3", "40×59"),
    "another size in the middle": (art_cut, "art", "art", "95×128"),
    **{f"camera {text}": (room_camera(text), "3", "camera_primesense.json", "")
       for text in ("{", "[]", '{"intrinsic_matrix": [0]}')},
    "two frames": (two_frames, "", "", "00008"),
    "two rooms": (two_rooms, "3", "3", "hall_3"),
    "another frame": (two_frames, "00009", "00009", "rgb_00007.png"),
    "no folder": (two_frames, "no/00009", "no/00009", "no such folder"),
    "a text": (lambda folder: (folder / "notes.txt").write_text("hello"), "notes.txt", "notes.txt", "no known RGB-D"),
    "an empty folder": (lambda folder: None, "", "", "no picture with depth"),
    **{f"{name} cut short": (room_cut(name), "3", name, "truncated PNG") for name in (COLOUR, DEPTH)},
    "depth of 8 bits": (room_with(DEPTH, FLAT), "3", DEPTH, "16 bits in millimetres"),
    "grey for colours": (room_with(COLOUR, FLAT), "3", COLOUR, "red, green and blue"),
    "no known depth": (room_with(DEPTH, FLAT.astype(np.uint16) * 0), "3", "3", "2400 pixels"),
}  # fmt: skip


@pytest.mark.parametrize("name", UNUSABLE)
def test_what_is_no_scene_with_depth_is_named(tmp_path, name):
    write, path, where, said = UNUSABLE[name]
    write(tmp_path)
    with pytest.raises(DataError) as caught:
        read_rgbd(tmp_path / path)
    assert caught.value.where == str(tmp_path / where)
    assert said in str(caught.value)


def test_rgb_is_never_taken_for_a_spectrum(tmp_path):
    stem = scenes.open3d(tmp_path)
    Image.fromarray(scenes.picture()).save(tmp_path / "alone.png")
    for path in (stem, tmp_path, tmp_path / COLOUR, tmp_path / "alone.png"):
        with pytest.raises(DataError, match="from_rgb"):
            read(path)
    assert read(tmp_path / "alone.png", wavelengths=[4e-7, 5e-7, 6e-7]).shape == (3, 37, 52)


# Real scenes


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
