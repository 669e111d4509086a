"""Light fields that cannot be used, in every command that reads one: a line says why, exit code 2, nothing made.

What is wrong with a folder of views is tested where it is read (`tests/data/test_bad_light_fields.py`).
"""

import shutil

import numpy as np
import pytest

from tests.cli.refusals import refused
from tests.data import rgbd_scenes
from tests.data.light_field_files import hci_name, shifted_plane, write_folder, write_parameters, write_pfm
from tmca.cli import main
from tmca.data import write_split

SIDE, SIZE = 3, (96, 100)
TINY = """
camera: {views: 3, size: [24, 24], slots: 2, period: 8}
decoder: {kind: spatial-angular, stages: 1, width: 4, blocks: 1, start: dagger}
data: {patch: 16, batch: 1}
"""
TAKE = ["--views", "3", "--slots", "2", "--period", "6", "--no-figures"]
COMPARE = ["compare", "light-field", "--views", "3", "--frame", "96x96", "--out", "out/c", "--work", "out/work"]
COMMANDS = {
    "simulate": ["simulate", "light-field", "scene", *TAKE, "--out", "out/s.nc"],
    "reconstruct": ["reconstruct", "scene.nc", "-d", "dagger", "--truth", "scene", "--out", "out/e.nc"],
    "evaluate": ["evaluate", "scene_dagger.nc", "scene", "--figure", "out/f.png"],
    "train": ["train", "light-field", "--config", "run.yaml", "--steps", "1", "--train", "scene", "--out", "out/run"],
    "sweep": ["sweep", "light-field", "scene", "--vary", "slots=2", "--set", "period=6", "--decoder", "dagger",
              "--views", "3", "--out", "out/s", "--work", "out/work"],
    "compare, test": [*COMPARE, "--train", "good.txt", "--test", "scene.txt"],
    "compare, train": [*COMPARE, "--train", "scene.txt", "--test", "good.txt"],
}  # fmt: skip


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """Good light fields with a snapshot and an estimate of one."""
    folder = tmp_path_factory.mktemp("prepared")
    for name in ("scene", "good"):
        write_folder(folder / name, shifted_plane(SIDE, SIZE), hci_name(SIDE))
        write_parameters(folder / name, SIDE, SIZE)
    (folder / "run.yaml").write_text(TINY)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        main(["simulate", "light-field", "scene", *TAKE, "--out", "scene.nc"])
        main(["reconstruct", "scene.nc", "-d", "dagger", "--no-figures"])
    return folder


@pytest.fixture
def place(prepared, tmp_path):
    shutil.copytree(prepared, tmp_path, dirs_exist_ok=True)
    (tmp_path / "out").mkdir()
    return tmp_path


@pytest.mark.parametrize("command", COMMANDS)
def test_a_light_field_without_a_view_is_refused(place, capsys, command):
    (place / "scene" / "input_Cam004.png").unlink()
    for name in ("scene", "good"):
        write_split([place / name], place / f"{name}.txt")
    there = sorted(place.rglob("*"))
    line = refused(capsys, *COMMANDS[command])
    assert "scene: found 8 views, none for number 4" in line
    assert "; " in line, "no remedy"
    assert sorted(place.rglob("*")) == there


def test_a_disparity_of_another_size_is_refused(place, capsys):
    write_pfm(place / "scene" / "gt_disp_lowres.pfm", np.zeros((95, 100)))
    assert "gt_disp_lowres.pfm: found a map of 95×100 pixels" in refused(capsys, *COMMANDS["evaluate"])
    assert not list((place / "out").iterdir())


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--aperture", "bad.npy"], "--aperture bad.npy: found patterns of 96×100 pixels, expected 98×102"),
        (["--vignetting", "bad.npy"], "--vignetting bad.npy: found shape (2, 96, 100), expected (3, 3)"),
        (["--views", "5"], "--views: found 5 of the 3×3 views of scene"),
    ],
)
def test_what_does_not_fit_the_views_is_refused(place, capsys, more, said):
    np.save("bad.npy", np.ones((2, *SIZE), np.float32))
    how = more if "--views" in more else ["--views", "3", *more]
    assert said in refused(capsys, "simulate", "light-field", "scene", *how, "--out", "out/s.nc")
    assert not list((place / "out").iterdir())


@pytest.mark.filterwarnings("default::tmca.data.light_field_scenes.UnevenGrid")
@pytest.mark.parametrize(
    "command",
    [
        "simulate",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("reconstruct", "evaluate", "train", "sweep")),
    ],
)
def test_a_grid_that_is_not_square_is_used_with_a_warning(place, capsys, command):
    shutil.rmtree(place / "scene")
    write_folder(place / "scene", shifted_plane(5, SIZE)[:3], lambda v, u: f"{v}_{u}.png")
    main(COMMANDS[command])
    assert capsys.readouterr().err.count("tmca: warning: scene: 3×5 views are no square") == 1
    assert list((place / "out").iterdir()) or command == "evaluate"


def test_a_picture_with_depth_is_named_as_what_it_is(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    stem = str(rgbd_scenes.nyuv2(tmp_path))
    line = refused(capsys, "simulate", "light-field", stem)
    assert f"{stem}: found an RGB picture with depth, expected a light field; take it for spectral-depth" in line
