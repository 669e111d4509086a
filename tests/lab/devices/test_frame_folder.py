"""Frames of other software, in the place of a bench."""

import numpy as np
import pytest
import tifffile
import torch
from PIL import Image

from tests.lab.devices.test_capture import bench_of, exported
from tests.lab.devices.test_export import spectral
from tmca.errors import DataError, DeviceError, SettingError
from tmca.lab.devices import capture, find_device, joined


@pytest.fixture
def taken(tmp_path):
    """A camera, its export, and the folder of a capture by the package itself, with a repeat."""
    camera = spectral()
    export = exported(tmp_path, camera)
    return camera, export, capture(export, bench_of(camera), tmp_path / "own", repeats=2)


def theirs(folder, own, names):
    """Frames of a capture under other names."""
    folder.mkdir()
    for name, known in names.items():
        tifffile.imwrite(folder / name, tifffile.imread(own / f"{known}.tif"))
    return folder


DARKS = {"Dark_9.tif": "dark", "Dark_10.tif": "dark_r1", "Dark_11.tif": "dark_r2", "Dark_12.tif": "dark_r3"}
ORDER = ["slot_000", "slot_001", "slot_002", "slot_000_r1", "slot_001_r1", "slot_002_r1"]
NUMBERED = {f"img_{8 + n}.tif": name for n, name in enumerate(ORDER)}  # 8, 9, 10, …: by number, not by letter
NAMED = {f"{name}.tif": name for name in ("dark", "dark_r1", "dark_r2", "dark_r3", *ORDER)}


@pytest.mark.parametrize("names", [DARKS | NUMBERED, NAMED], ids=["in order", "by name"])
@pytest.mark.parametrize("repeats", [1, 2])
def test_frames_in_order_or_by_name_join_as_those_of_a_bench(tmp_path, taken, names, repeats):
    camera, export, own = taken
    bench = find_device("folder", path=str(theirs(tmp_path / "theirs", own, names)), snapshot_units_per_dn="0.5")
    found = joined(capture(export, bench, tmp_path / "f", gain=None, camera=camera, repeats=repeats), export, camera)
    wanted = joined(own, export, camera)
    assert found.notes["gain_per_digital_number"] == 0.5
    torch.testing.assert_close(found.values, 0.5 * wanted.values)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ({}, "a folder without frames"),
        ({k: v for k, v in (DARKS | NUMBERED).items() if k != "img_9.tif"}, "5 frames whose names do"),
        ({k: v for k, v in (DARKS | NUMBERED).items() if k != "Dark_9.tif"}, "no frame dark_r3"),
        ({k: v for k, v in NAMED.items() if k != "slot_001.tif"}, "no frame slot_001"),
        (NUMBERED, "no frame dark"), (DARKS, "0 frames whose names"),
    ],
    ids=["none", "one of light", "one dark", "a name", "all dark", "all light"],
)  # fmt: skip
def test_frames_that_are_missing_are_one_line(tmp_path, taken, names, words):
    _, export, own = taken
    folder = theirs(tmp_path / "theirs", own, names)
    with pytest.raises(DataError, match=words):
        capture(export, find_device("folder", path=str(folder)), tmp_path / "f")
    assert not (tmp_path / "f").exists()


def test_more_repeats_than_there_are_frames_are_one_line(tmp_path, taken):
    camera, export, own = taken
    bench = find_device("folder", path=str(theirs(tmp_path / "theirs", own, DARKS | NUMBERED)))
    with pytest.raises(DataError, match=r"no frame slot_000_r2.*--repeat"):
        capture(export, bench, tmp_path / "f", repeats=3, camera=camera)


@pytest.mark.parametrize(
    ("frame", "words"),
    [
        (np.full((13, 18), 900, np.uint16), "a frame of 13×18"), (np.full((12, 18), 4095, np.uint16), "saturated"),
        (np.full((12, 18), 0.5), "float64"), (np.full((12, 18, 3), 900, np.uint16), "a frame of 3×12×18"),
    ],
)  # fmt: skip
def test_frames_of_another_size_kind_or_light_are_refused(tmp_path, taken, frame, words):
    camera, export, own = taken
    folder = theirs(tmp_path / "theirs", own, NAMED)
    np.save(folder / "slot_001.npy", frame)
    (folder / "slot_001.tif").unlink()
    for file in folder.glob("*.tif"):
        tifffile.imwrite(file, tifffile.imread(file) // 32)
    bench = find_device("folder", path=str(folder), saturation="4095")
    with pytest.raises((DataError, DeviceError), match=f"{words}"):
        capture(export, bench, tmp_path / "f", camera=camera)


def test_saturation_is_the_largest_number_of_the_files_unless_it_is_told(tmp_path):
    (tmp_path / "eight").mkdir()
    Image.fromarray(np.zeros((4, 5), np.uint8)).save(tmp_path / "eight" / "dark.png")
    assert find_device("folder", path=str(tmp_path / "eight")).saturation == 255
    assert find_device("folder", path=str(tmp_path / "eight"), saturation="200").saturation == 200
    with pytest.raises(SettingError, match="--set saturation: found 'much'"):
        find_device("folder", path=str(tmp_path / "eight"), saturation="much")


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({}, "--set path: found none, expected path"),
        ({"path": "there", "foo": "1"}, "--set foo: found a setting .*path, saturation, snapshot_units_per_dn"),
    ],
)
def test_settings_that_are_missing_or_unknown_are_named(settings, words):
    with pytest.raises(SettingError, match=words):
        find_device("folder", **settings)
