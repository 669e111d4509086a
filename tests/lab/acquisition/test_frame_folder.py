"""Frames of other software, in the place of a bench."""

import json
import shutil

import numpy as np
import pytest
import tifffile
import torch
from PIL import Image

from tests.lab.acquisition.test_capture import bench_of, exported
from tests.lab.display.test_export import spectral
from tmca.errors import DataError, DeviceError, SettingError
from tmca.lab.acquisition.drivers import find_device
from tmca.lab.acquisition.frame_folder import named_frames
from tmca.lab.acquisition.session import capture, joined
from tmca.sensor import Sensor


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder, camera = tmp_path_factory.mktemp("made"), spectral(sensor=Sensor(read_noise=0.002))
    export = exported(folder, camera)
    return camera, export, capture(export, bench_of(camera), folder / "own", repeats=2)


@pytest.fixture(scope="module")
def of_a_bench(made, tmp_path_factory):
    """Snapshots of a bench's own frames by the number of repeats."""
    camera, export, own = made
    once = capture(export, bench_of(camera), tmp_path_factory.mktemp("once") / "own", repeats=1)
    return {repeats: joined(folder, export, camera).values for repeats, folder in ((1, once), (2, own))}


@pytest.fixture
def taken(made, tmp_path):
    """A camera, its export, and the folder of a capture by the package itself, with a repeat."""
    camera, *folders = made
    return camera, *(shutil.copytree(folder, tmp_path / folder.name) for folder in folders)


def theirs(folder, own, names):
    """Frames of a capture under other names."""
    folder.mkdir()
    for name, known in names.items():
        tifffile.imwrite(folder / name, tifffile.imread(own / f"{known}.tif"))
    return folder


DARKS = {"Dark_9.tif": "dark", "Dark_10.tif": "dark_r1", "Dark_11.tif": "dark_r2", "Dark_12.tif": "dark_r3"}
OTHER_DARKS = {"dark.tif": "dark", "dark_1.tif": "dark_r1", "dark_2.tif": "dark_r2", "dark_3.tif": "dark_r3"}
ORDER = ["slot_000", "slot_001", "slot_002", "slot_000_r1", "slot_001_r1", "slot_002_r1"]
NUMBERED = {f"img_{8 + n}.tif": name for n, name in enumerate(ORDER)}  # 8, 9, 10, …: by number, not by letter
NAMED = {f"{name}.tif": name for name in ("dark", "dark_r1", "dark_r2", "dark_r3", *ORDER)}
SLOTS = [(slot, repeat, f"slot_00{slot}" + ("_r1" if repeat else "")) for slot in range(3) for repeat in range(2)]
SLOT_MAJOR = {f"slot{slot}_rep{repeat}.tif": name for slot, repeat, name in SLOTS}
FROM_ONE = {f"Repeat-{repeat + 1} Slot {slot + 1}.tif": name for slot, repeat, name in SLOTS}
TIMED = {f"2026-04-0{1 + n // 4}_10-{n:02}.tif": name for n, name in enumerate(ORDER)}


def once(names):
    return {file: name for file, name in names.items() if name.startswith("dark") or not name.endswith("_r1")}


@pytest.mark.parametrize(
    ("names", "repeats"),
    [(DARKS | NUMBERED, 2), (NAMED, 2), (OTHER_DARKS | NUMBERED, 2), (DARKS | SLOT_MAJOR, 2), (DARKS | FROM_ONE, 2),
     (DARKS | TIMED, 2), (DARKS | NUMBERED, 1), (NAMED, 1)],
    ids=["in order", "by name", "a dark one like a step", "slot by slot", "from one", "by time", "in order, once",
         "by name, once"],
)  # fmt: skip
def test_frames_in_order_or_by_name_join_as_those_of_a_bench(tmp_path, taken, of_a_bench, names, repeats):
    camera, export, own = taken
    names = names if repeats == 2 else once(names)
    bench = find_device("folder", path=str(theirs(tmp_path / "theirs", own, names)), snapshot_units_per_dn="0.5")
    found = joined(capture(export, bench, tmp_path / "f", gain=None, camera=camera, repeats=repeats), export, camera)
    assert found.notes["gain_per_digital_number"] == 0.5
    torch.testing.assert_close(found.values, 0.5 * of_a_bench[repeats])
    kept = json.loads((tmp_path / "f" / "captures.json").read_text())["frames"]
    darks = {name for name in kept if name.startswith("dark")}
    wanted = {name: file for file, name in names.items()}
    assert {name: kept[name]["source"]["file"] for name in kept.keys() - darks} == {
        name: wanted[name] for name in kept.keys() - darks
    }
    assert darks == {"dark", "dark_r1", "dark_r2", "dark_r3"}


def test_further_dark_frames_are_taken_too(tmp_path, taken):
    camera, export, own = taken
    folder = theirs(tmp_path / "theirs", own, once(NAMED))
    for n, file in enumerate(sorted(own.glob("slot_*.tif"))):
        dark = tifffile.imread(own / "dark.tif")
        tifffile.imwrite(folder / f"dark_z{n}.tif", np.roll(dark, n + 1, 1))
        assert file.exists()
    bench = find_device("folder", path=str(folder))
    capture(export, bench, tmp_path / "f", camera=camera)
    assert len([*(tmp_path / "f").glob("dark*.tif")]) == 4 + 6


@pytest.mark.parametrize("name", ["scene_r2_slot_{}.tif", "slot{}_rep3.tif"])
def test_a_repeat_that_is_the_same_in_all_names_is_none(tmp_path, taken, name):
    _, _, own = taken
    folder = theirs(tmp_path / "theirs", own, {name.format(k): f"slot_00{k}" for k in range(3)})
    found = named_frames(sorted(folder.iterdir()), {"slots": 3, "planes": []}, folder)
    assert {key: file.name for key, file in found.items()} == {f"slot_00{k}": name.format(k) for k in range(3)}


def without(names, *gone):
    return {file: name for file, name in names.items() if file not in gone}


@pytest.mark.parametrize(
    ("names", "repeats"),
    [
        (DARKS | NUMBERED, 1), (NAMED, 1), (DARKS | NUMBERED, 3), (NAMED | {"preview.tif": "slot_000"}, 2),
        (DARKS | SLOT_MAJOR | {"slot00_rep0.tif": "slot_000"}, 2), (NUMBERED, 2), (DARKS, 1), ({}, 1),
        (DARKS | {f"slot_{k}.tif": f"slot_00{k}" for k in (1, 2)}, 1), (without(NAMED, "slot_001.tif"), 2),
        (DARKS | {f"slot{s + 3 * r}.tif": n for s, r, n in SLOTS}, 2), (without(DARKS | NUMBERED, "img_9.tif"), 2),
        (DARKS | {f"slot{s}_{r}.tif": n for s, r, n in SLOTS}, 2), (without(DARKS | NUMBERED, "Dark_9.tif"), 2),
    ],
    ids=[
        "order", "names", "repeats", "stray", "twice", "dark", "light", "none", "first", "a name", "another export",
        "one of light", "no repeats", "one dark",
    ],
)  # fmt: skip
def test_frames_are_never_left_out(tmp_path, taken, names, repeats):
    camera, export, own = taken
    folder = theirs(tmp_path / "theirs", own, names)
    with pytest.raises(DataError) as found:
        capture(export, find_device("folder", path=str(folder)), tmp_path / "f", camera=camera, repeats=repeats)
    assert found.value.where.startswith(str(folder))
    assert not (tmp_path / "f").exists()


def test_two_files_of_one_name_are_refused(tmp_path, taken):
    folder = theirs(tmp_path / "theirs", taken[2], NAMED)
    np.save(folder / "slot_001.npy", np.ones((12, 18), np.uint16))
    with pytest.raises(DataError, match=r"slot_001"):
        find_device("folder", path=str(folder))


@pytest.mark.parametrize(("buckets", "device"), [(1, "coded-exposure"), (2, "coded-exposure-two-bucket")])
def test_whole_exposures_are_named_as_such(tmp_path, buckets, device):
    camera = spectral(sensor=Sensor(read_noise=0.002), buckets=buckets)
    export = exported(tmp_path, camera, "dli4120", device)
    own = capture(export, bench_of(camera), tmp_path / "own", repeats=2)
    names = DARKS | {"exposure.tif": "exposure", "exposure_r1.tif": "exposure_r1"}
    bench = find_device("folder", path=str(theirs(tmp_path / "a", own, names)))
    found = joined(capture(export, bench, tmp_path / "f", repeats=2), export, camera)
    torch.testing.assert_close(found.values, joined(own, export, camera).values)
    slots = DARKS | {"slot_000.tif": "exposure", "slot_001.tif": "exposure_r1"}
    with pytest.raises(DataError, match="the name slot_000"):
        capture(export, find_device("folder", path=str(theirs(tmp_path / "b", own, slots))), tmp_path / "g", repeats=2)


def test_frames_whose_files_changed_are_taken_again(tmp_path, taken):
    """And only those; the snapshot is that of the files as they are."""
    camera, export, own = taken
    folder = theirs(tmp_path / "theirs", own, NAMED)
    how = {"camera": camera, "repeats": 2}
    capture(export, find_device("folder", path=str(folder)), tmp_path / "f", **how)
    before = {file.name: file.read_bytes() for file in (tmp_path / "f").glob("*.tif")}
    changed = tifffile.imread(folder / "slot_001.tif") // 2 + 700
    tifffile.imwrite(folder / "slot_001.tif", changed)
    capture(export, find_device("folder", path=str(folder)), tmp_path / "f", **how)
    np.testing.assert_array_equal(tifffile.imread(tmp_path / "f" / "slot_001.tif"), changed)
    after = {file.name: file.read_bytes() for file in (tmp_path / "f").glob("*.tif")}
    assert {name for name in before if before[name] != after[name]} == {"slot_001.tif"}
    capture(export, find_device("folder", path=str(folder)), tmp_path / "g", **how)
    one, other = joined(tmp_path / "f", export, camera), joined(tmp_path / "g", export, camera)
    torch.testing.assert_close(one.values, other.values, rtol=0, atol=0)


@pytest.mark.parametrize(
    ("frame", "words"),
    [
        (np.full((13, 18), 900, np.uint16), "a frame of 13×18"), (np.full((12, 18), 4095, np.uint16), "saturated"),
        (np.full((12, 18), 0.5), "float64"),
        (np.full((12, 18, 3), 900, np.uint16), "a frame of 3×12×18, expected 12×18 pixels"),
    ],
)  # fmt: skip
def test_frames_of_another_size_kind_or_light_are_refused(tmp_path, taken, frame, words):
    camera, export, own = taken
    folder = theirs(tmp_path / "theirs", own, once(NAMED))
    np.save(folder / "slot_001.npy", frame)
    (folder / "slot_001.tif").unlink()
    for file in folder.glob("*.tif"):
        tifffile.imwrite(file, tifffile.imread(file) // 32)
    bench = find_device("folder", path=str(folder), saturation="4095")
    with pytest.raises((DataError, DeviceError), match=f"{words}"):
        capture(export, bench, tmp_path / "f", camera=camera)
    assert not (tmp_path / "f").exists()


def test_a_bucket_that_is_missing_leaves_no_folder(tmp_path):
    camera = spectral(sensor=Sensor(read_noise=0.002), buckets=2)
    export = exported(tmp_path, camera, "dli4120", "coded-exposure-two-bucket")
    own = capture(export, bench_of(camera), tmp_path / "own")
    folder = theirs(tmp_path / "theirs", own, once(DARKS) | {"exposure.tif": "exposure"})
    tifffile.imwrite(folder / "exposure.tif", tifffile.imread(folder / "exposure.tif")[0])
    with pytest.raises(DataError, match=r"theirs/exposure.tif: found a frame of 12×18, expected 2×12×18"):
        capture(export, find_device("folder", path=str(folder)), tmp_path / "f", camera=camera)
    assert not (tmp_path / "f").exists()


def test_saturation_is_the_largest_number_of_the_files_unless_it_is_told(tmp_path):
    (tmp_path / "eight").mkdir()
    Image.fromarray(np.full((4, 5), 30, np.uint8)).save(tmp_path / "eight" / "dark.png")
    assert find_device("folder", path=str(tmp_path / "eight")).saturation == 255
    assert find_device("folder", path=str(tmp_path / "eight"), saturation="200").saturation == 200
    with pytest.raises(SettingError, match=r"--set saturation: found 30, expected above 30; dark.png has 30"):
        find_device("folder", path=str(tmp_path / "eight"), saturation="30")
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
