"""Frames as they lie on disk: all there, in order, neither saturated nor dark."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from studies.rendered_table import bench, render_fringes, scene_depth
from tmca.errors import DataError, SettingError
from tmca.lab.frames import read_frames
from tmca.lab.ground_truth.depth import measure_depth
from tmca.lab.ground_truth.fringes import Capture, FringePlan, load_plan, read_capture, write_fringes

SIZE = (48, 65)
PLAN = FringePlan()


@pytest.fixture(scope="module")
def frames():
    return render_fringes(PLAN, bench(SIZE), scene_depth("smooth", SIZE), np.ones(SIZE), bits=16).frames


def depth_of(path):
    return measure_depth(read_capture(path, PLAN), PLAN, bench(SIZE))


def folder_of(path, frames, names=PLAN.names):
    path.mkdir(exist_ok=True)
    for name, frame in zip(names, frames, strict=False):
        Image.fromarray(frame).save(path / f"{name}.png")
    return path


def test_folders_stacks_and_own_names_are_the_same_capture(tmp_path, frames):
    import tifffile

    np.save(tmp_path / "stack.npy", frames)
    tifffile.imwrite(tmp_path / "stack.tif", frames, photometric="minisblack")
    kept = [
        folder_of(tmp_path / "named", frames),
        folder_of(tmp_path / "counted", frames, [f"IMG_{i}" for i in range(len(frames))]),
        tmp_path / "stack.npy",
        tmp_path / "stack.tif",
    ]
    for path in kept:
        assert np.array_equal(read_capture(path, PLAN).values.reshape(frames.shape), frames), path


def test_colour_frames_become_grey_and_are_saturated_in_one_channel(tmp_path):
    colour = np.zeros((3, 4, 3), np.uint8)
    colour[1, 2] = (255, 0, 30)
    Image.fromarray(colour).save(tmp_path / "a.png")
    found = read_frames(tmp_path)
    assert found.values[0, 1, 2] == pytest.approx(95)
    assert found.saturated.sum() == 1
    assert found.saturated[0, 1, 2]


def test_missing_frames_are_named(tmp_path, frames):
    folder = folder_of(tmp_path / "c", frames)
    (folder / f"{PLAN.names[5]}.png").unlink()
    with pytest.raises(DataError, match=rf"no {PLAN.names[5]} \(1 of 16 missing\)"):
        read_capture(folder, PLAN)
    np.save(tmp_path / "s.npy", frames[:-1])
    with pytest.raises(DataError, match="found 15 frames, expected 16: 4 frequencies of 4 steps"):
        read_capture(tmp_path / "s.npy", PLAN)


@pytest.mark.parametrize(("gamma", "doubtful"), [(2.2, False), (4.0, True)])
def test_steps_that_are_no_cosine_are_doubted(frames, recwarn, gamma, doubtful):
    values = (65535 * (frames / frames.max()) ** gamma).reshape(4, 4, *SIZE).astype(np.float32)
    found = measure_depth(Capture(Path("c"), values, np.zeros(SIZE, bool), 1.0), PLAN, bench(SIZE), noise=1000.0)
    assert (found.attrs["quality"] > 1) == doubtful
    assert any("no cosine" in str(one.message) for one in recwarn) == doubtful


@pytest.mark.parametrize("fault", ["steps that all run back", "a mirrored camera"])
def test_a_phase_that_runs_the_wrong_way_gives_hardly_a_depth(frames, fault):
    steps = frames.reshape(4, 4, *SIZE).astype(np.float32)
    wrong = steps[..., ::-1] if fault == "a mirrored camera" else steps[:, [0, 3, 2, 1]]
    try:
        found = measure_depth(Capture(Path("c"), wrong, np.zeros(SIZE, bool), 1.0), PLAN, bench(SIZE))
    except DataError:
        return
    assert np.isfinite(found["depth"].values).mean() < 0.5


def test_saturated_and_dark_captures_are_refused(tmp_path, frames):
    bright = np.clip(frames.astype(np.int64) * 4, 0, 65535).astype(np.uint16)
    with pytest.raises(DataError, match=r"% of the pixels saturated .* expose for less time"):
        read_capture(folder_of(tmp_path / "bright", bright), PLAN)
    noise = np.random.default_rng(0).normal(300, 20, frames.shape).astype(np.uint16)
    with pytest.raises(DataError, match=r"no pixel with a depth .*check the light"):
        depth_of(folder_of(tmp_path / "dark", noise))


def test_broken_frames_are_refused(tmp_path, frames):
    folder = folder_of(tmp_path / "c", frames)
    Image.fromarray(frames[0][:-1]).save(folder / f"{PLAN.names[3]}.png")
    with pytest.raises(DataError, match=f"frame {PLAN.names[3]} of 47×65 pixels"):
        read_capture(folder, PLAN)
    whole = (folder / f"{PLAN.names[2]}.png").read_bytes()
    (folder / f"{PLAN.names[2]}.png").write_bytes(whole[:100])
    with pytest.raises(DataError, match="unreadable"):
        read_capture(folder, PLAN)
    with pytest.raises(DataError, match="no such file or folder"):
        read_frames(tmp_path / "gone")
    (tmp_path / "empty").mkdir()
    with pytest.raises(DataError, match="a folder without frames"):
        read_frames(tmp_path / "empty")
    np.save(tmp_path / "nan.npy", np.full((2, 3, 4), np.nan))
    with pytest.raises(DataError, match="not finite"):
        read_frames(tmp_path / "nan.npy")
    with pytest.raises(SettingError, match="saturation"):
        read_frames(folder, saturation=-1)


def test_the_projected_pictures_are_the_plan(tmp_path):
    plan = FringePlan(size=(30, 64), fringes=(1, 5), steps=3)
    write_fringes(plan, tmp_path / "f")
    assert load_plan(tmp_path / "f") == load_plan(tmp_path / "f" / "fringes.json") == plan
    for name, profile in zip(plan.names, plan.profiles().reshape(-1, 64), strict=True):
        picture = np.asarray(Image.open(tmp_path / "f" / f"{name}.png"))
        assert picture.shape == (30, 64)
        assert (picture == np.round(255 * profile)).all()
    u = np.arange(64)
    assert np.abs(plan.profiles()[1, 2] - (0.5 + 0.5 * np.cos(2 * np.pi * (5 * (u + 0.5) / 64 - 2 / 3)))).max() < 0.002


@pytest.mark.parametrize(
    "bad",
    [{"steps": 2}, {"fringes": (4, 1)}, {"fringes": (0, 1)}, {"fringes": (1, 500)}, {"size": (2, 2)}, {"across": "z"}],
)
def test_impossible_plans_are_refused(bad):
    with pytest.raises(SettingError):
        FringePlan(**bad)


@pytest.mark.parametrize("change", [{"format": "other"}, {"steps": "many"}, {"size": None}])
def test_impossible_manifests_are_refused(tmp_path, change):
    write_fringes(FringePlan(size=(8, 16), fringes=(1,)), tmp_path / "f")
    file = tmp_path / "f" / "fringes.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | change))
    with pytest.raises(DataError, match=r"fringes\.json"):
        load_plan(file)


@pytest.mark.parametrize("share", [0.95, 1.05])
def test_a_lamp_that_drifts_between_frequencies_is_no_wrong_order(tmp_path, frames, share):
    drifting = frames.astype(np.float64)
    drifting[8:12] *= share
    np.save(tmp_path / "s.npy", np.clip(drifting, 0, 65535).astype(np.uint16))
    assert (depth_of(tmp_path / "s.npy")["confidence"].values == 0).mean() > 0.5
