"""Light fields that cannot be used, in every command that reads one: a line says why, exit code 2, nothing made."""

import shutil

import numpy as np
import pytest
from PIL import Image

from tests.cli.refusals import refused
from tests.data.light_field_files import hci_name, shifted_plane, write_folder, write_parameters, write_pfm
from tmca.cli import main
from tmca.data import write_split

SIDE, SIZE = 3, (96, 100)
VIEWS = shifted_plane(SIDE, SIZE)
LENSLET = np.random.default_rng(0).integers(0, 256, (14 * 24, 14 * 25), dtype=np.uint8)
TINY = """
camera: {views: 3, size: [24, 24], slots: 2, period: 8}
decoder: {kind: spatial-angular, stages: 1, width: 4, blocks: 1, start: dagger}
data: {patch: 16, batch: 1}
"""
TAKE = ["--views", "3", "--slots", "2", "--period", "6", "--no-figures"]
COMMANDS = {
    "simulate": ["simulate", "light-field", "SCENE", *TAKE, "--out", "out/s.nc"],
    "reconstruct": ["reconstruct", "STEM.nc", "-d", "dagger", "--truth", "SCENE", "--out", "out/e.nc"],
    "evaluate": ["evaluate", "STEM_dagger.nc", "SCENE", "--figure", "out/f.png"],
    "train": ["train", "light-field", "--config", "run.yaml", "--steps", "1", "--train", "SCENE", "--out", "out/run"],
    "sweep": ["sweep", "light-field", "SCENE", "--vary", "slots=2", "--set", "period=6", "--decoder", "dagger",
              "--views", "3", "--out", "out/s", "--work", "out/work"],
    "compare, test": ["compare", "light-field", "--train", "good.txt", "--test", "SCENE.txt", "--views", "3",
                      "--frame", "96x96", "--out", "out/c", "--work", "out/work"],
    "compare, train": ["compare", "light-field", "--train", "SCENE.txt", "--test", "good.txt", "--views", "3",
                       "--frame", "96x96", "--out", "out/c", "--work", "out/work"],
}  # fmt: skip


def good(folder):
    write_folder(folder, VIEWS, hci_name(SIDE))
    write_parameters(folder, SIDE, SIZE)


def missing(folder):
    (folder / "scene" / "input_Cam004.png").unlink()
    return "scene: found 8 views, none for number 4, expected one for each place of a 3×3 grid; add what is missing"


def lenslet(folder):
    Image.fromarray(LENSLET[1:]).save(folder / "scene_eslf.png")
    return "scene_eslf.png: found 335×350 pixels (height × width), expected a multiple of the 14×14 views under a lens"


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """Good light fields with snapshots and estimates of them."""
    folder = tmp_path_factory.mktemp("prepared")
    for name in ("scene", "good"):
        good(folder / name)
    Image.fromarray(LENSLET).save(folder / "scene_eslf.png")
    (folder / "run.yaml").write_text(TINY)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for name in ("scene", "scene_eslf.png"):
            stem = name.removesuffix(".png")
            main(["simulate", "light-field", name, *TAKE, "--out", f"{stem}.nc"])
            main(["reconstruct", f"{stem}.nc", "-d", "dagger", "--no-figures"])
    return folder


@pytest.fixture
def place(prepared, tmp_path):
    shutil.copytree(prepared, tmp_path, dirs_exist_ok=True)
    (tmp_path / "out").mkdir()
    return tmp_path


def words_of(command, scene):
    stem = scene.removesuffix(".png")
    return [word.replace("SCENE", scene).replace("STEM", stem) for word in COMMANDS[command]]


@pytest.mark.parametrize(("command", "spoil"), [(name, spoil) for name in COMMANDS for spoil in (missing, lenslet)])
def test_a_light_field_that_cannot_be_used_is_refused(place, capsys, command, spoil):
    said = spoil(place)
    scene = "scene_eslf.png" if spoil is lenslet else "scene"
    for name in (scene, "good"):
        write_split([place / name], place / f"{name}.txt")
    there = sorted(place.rglob("*"))
    line = refused(capsys, *words_of(command, scene))
    assert said in line
    assert "; " in line, "no remedy"
    assert sorted(place.rglob("*")) == there


def test_a_disparity_of_another_size_is_refused(place, capsys):
    write_pfm(place / "scene" / "gt_disp_lowres.pfm", np.zeros((95, 100)))
    line = refused(capsys, *words_of("evaluate", "scene"))
    assert "gt_disp_lowres.pfm: found a map of 95×100 pixels, expected 96×100 (height × width) as the views" in line
    assert not list((place / "out").iterdir())


@pytest.mark.parametrize(
    ("option", "shape", "said"),
    [
        ("--aperture", (2, 96, 100), "--aperture bad.npy: found patterns of 96×100 pixels, expected 98×102; make them"),
        ("--vignetting", (5, 5), "--vignetting bad.npy: found shape (5, 5), expected (3, 3)"),
    ],
)
def test_masks_and_vignetting_of_another_size_are_refused(place, capsys, option, shape, said):
    np.save("bad.npy", np.ones(shape, np.float32))
    line = refused(capsys, "simulate", "light-field", "scene", "--views", "3", option, "bad.npy", "--out", "out/s.nc")
    assert said in line
    assert not list((place / "out").iterdir())


@pytest.mark.filterwarnings("default::tmca.data.light_field_scenes.UnevenGrid")
@pytest.mark.parametrize("command", [name for name in COMMANDS if not name.startswith("compare")])
def test_a_grid_that_is_not_square_is_used_with_a_warning(place, capsys, command):
    shutil.rmtree(place / "scene")
    write_folder(place / "scene", shifted_plane(5, SIZE)[:3], lambda v, u: f"{v}_{u}.png")
    main(words_of(command, "scene"))
    told = (
        "tmca: warning: scene: 3×5 views are no square, some may be missing; taken are rows 0 to 2 and columns 1 to 3"
    )
    assert capsys.readouterr().err.count(told) == 1
    assert list((place / "out").iterdir()) or command == "evaluate"


def test_views_that_are_not_there_are_refused(place, capsys):
    said = "of the 3×3 views of scene, expected an odd number, at most 3; give views=3 (--views 3)"
    assert f"--views: found 5 {said}" in refused(capsys, "simulate", "light-field", "scene")
    assert f"--views: found 5 {said}" in refused(capsys, "simulate", "light-field", "scene", "--views", "5")


def test_a_decoder_without_its_dictionary_says_how_to_make_one(place, capsys):
    for how in ([], ["--dictionary", "scene.nc"]):
        line = refused(capsys, "reconstruct", "scene.nc", "-d", "dictionary", *how, "--out", "out/e.nc")
        assert "tmca prior learn-views … --dictionary --out …" in line
    assert not list((place / "out").iterdir())
