"""Photographs of one's own through `tmca render`: one, a folder, the split that other commands learn from."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.cli.calls import run, said
from tests.cli.refusals import refused
from tmca.data import read_dataset, read_light_field


def picture(path, seed=0, size=(45, 61)):
    Path(path).parent.mkdir(exist_ok=True)
    patches = np.random.default_rng(seed).integers(30, 250, (9, 13, 3)).repeat(5, 0).repeat(5, 1)
    Image.fromarray(patches[: size[0], : size[1]].astype(np.uint8)).save(path)


def test_a_photograph_becomes_a_scene_in_the_folder_at_hand(capsys):
    picture("album/cup.png")
    assert said(capsys, "render", "album/cup.png", "--size", "20x27", "--illuminant", "A") == (
        "cup.nc: 20×27 pixels, illuminant A\n"
    )
    assert read_dataset("cup.nc")["radiance"].shape == (31, 20, 27)


@pytest.fixture
def album():
    for index in range(3):
        picture(f"album/{index}.png", index)


@pytest.mark.usefixtures("album")
def test_a_prior_learns_from_the_split_of_a_folder(capsys):
    how = ("render", "--from", "album", "--number", "2", "--size", "32x40", "--out", "scenes")
    assert said(capsys, *how) == "scenes: 2 scenes, listed in scenes/scenes.txt\n"
    files = sorted(Path("scenes").glob("*.nc"))
    assert all(read_dataset(file).attrs["light"] == "drawn" for file in files)
    before = [file.stat().st_mtime_ns for file in files]
    said(capsys, *how)
    assert [file.stat().st_mtime_ns for file in files] == before
    assert "Gaussian prior" in said(
        capsys, "prior", "learn", "--split", "scenes/scenes.txt", "--bands", "3", "--out", "p.nc"
    )


@pytest.mark.usefixtures("album")
def test_light_fields_of_a_folder(capsys):
    said(capsys, "render", "--from", "album", "--views", "3", "--size", "32x40", "--seed", "2")
    assert read_light_field("album_scenes/0.nc").shape == (3, 3, 32, 40)
    learn = ("prior", "learn-views", "--split", "album_scenes/scenes.txt", "--views", "3", "--out", "p.nc")
    assert "(views, rows, columns)" in said(capsys, *learn)


@pytest.mark.filterwarnings("default::tmca.data.in_memory.SceneWarning")
def test_grey_is_said(capsys):
    Image.fromarray(np.arange(1600, dtype=np.uint8).reshape(40, 40)).save("grey.png")
    assert "grey.png: a picture without colours" in run(capsys, "render", "grey.png", "--size", "16x16").err
    assert Path("grey.nc").exists()


REFUSED = {
    "render": "SCENE: found none",
    "render cofee": "the path of a photograph",
    "render gone.png": "no such file",
    "render album": "--from renders a folder",
    "render broken.png": "broken.png: found an unreadable or truncated PNG",
    "render tiny.png": "a picture of 20×45 pixels, expected 32×32 or more",
    "render coffee --number 2": "--from FOLDER beside it",
    "render coffee --views 3 --light drawn": "none beside --views",
    "render coffee --from album": "SCENE: found coffee",
    "render --from album --figure a.png": "--figure: found a.png",
    "render --from album --number 4": "number: found 4",
    "render --from album --size 50x50": "expected 50×50 or more",
    "render --from empty": "no photographs",
    "render --from gone": "no such folder",
    "render --from album --out full": "other scenes, mine.nc",
    "render --from album --illuminant sun": "one that colour-science knows",
}


@pytest.mark.usefixtures("album")
@pytest.mark.parametrize("command", REFUSED)
def test_what_cannot_be_rendered_is_named_and_nothing_is_left(capsys, command):
    Path("broken.png").write_text("no picture")
    picture("tiny.png", size=(20, 45))
    Path("empty").mkdir()
    Path("full").mkdir()
    Path("full/mine.nc").write_text("")
    before = {*Path().rglob("*")}
    assert REFUSED[command] in refused(capsys, *command.split())
    assert {*Path().rglob("*")} == before
