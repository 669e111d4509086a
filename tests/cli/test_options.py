"""What the command line accepts beside the plain case, and how it speaks."""

import numpy as np
import pytest

from tests.cli.refusals import refused
from tmca.cli import main


def run(capsys, *arguments):
    main(["simulate", "spectral", *map(str, arguments), "--no-figures"])
    return capsys.readouterr()


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    np.save("patterns.npy", (rng.random((3, 40, 40)) < 0.5).astype(np.uint8))
    np.save("colours.npy", rng.random((12, 24, 24)).astype(np.float32))
    np.save("negative.npy", rng.random((31, 24, 24), dtype=np.float32) - 0.1)
    np.save("dark.npy", np.zeros((31, 24, 24), dtype=np.float32))
    return tmp_path


@pytest.mark.filterwarnings("default::tmca.cameras.CodesWarning")
def test_patterns_from_a_file_set_the_slots_and_give_their_middle(folder, capsys):
    said = run(capsys, "coffee", "--crop", "24x24", "--aperture", "patterns.npy")
    assert "K = 3" in said.out
    assert "middle 24×24 of 40×40" in said.err
    given = ("--crop", "40x40", "--aperture", "patterns.npy", "--slots", "5", "--overwrite")
    assert "--slots 3" in refused(capsys, "simulate", "spectral", "coffee", *given)


def test_a_coloured_aperture_and_a_moving_scene_come_from_the_command_line(folder, capsys):
    run(capsys, "coffee", "--crop", "24x24", "--coloured", "colours.npy", "--out", "c.nc")
    run(capsys, "coffee", "--crop", "24x24", "--motion", "0,2.5", "--out", "m.nc")
    run(capsys, "coffee", "chelsea", "--crop", "24x24", "--slots", "2", "--out", "two.nc")
    main(["reconstruct", "c.nc", "-d", "dagger", "--no-figures"])
    assert (folder / "c_dagger.nc").exists()
    assert "slots" in refused(capsys, "simulate", "spectral", "coffee", "chelsea", "--crop", "24x24")


@pytest.mark.filterwarnings("default::tmca.data.scenes.DarkScene")
def test_negative_pixels_are_clipped_where_asked(folder, capsys):
    reading = ("--wavelengths", "400:700:31")
    assert "--negative clip" in refused(capsys, "simulate", "spectral", "negative.npy", *reading)
    run(capsys, "negative.npy", *reading, "--negative", "clip")
    assert "every pixel is zero" in run(capsys, "dark.npy", *reading).err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--read-noise", "-1"], ["--read-noise"]),
        (["--dispersion", "1,2"], ["--dispersion", "12 bands"]),
        (["--aperture", "nope"], ["--aperture", "one-hot"]),
        (["--motion", "3"], ["--motion", "ROWS,COLUMNS"]),
        (["--coloured", "colours.npy"], ["--coloured", "(12, 16, 16)"]),
    ],
)
def test_messages_name_the_option(folder, capsys, arguments, words):
    line = refused(capsys, "simulate", "spectral", "coffee", "--crop", "16x16", *arguments)
    for word in words:
        assert word in line


def test_a_picture_has_a_suffix_that_is_drawn(folder, capsys):
    run(capsys, "coffee", "--crop", "24x24", "--out", "s.nc")
    assert ".png .pdf .svg" in refused(capsys, "inspect", "s.nc", "--figure", "s.foo")
    main(["inspect", "s.nc", "--figure", "s.svg"])
    assert (folder / "s.svg").read_text().startswith("<?xml")
    assert capsys.readouterr().out.startswith("s.nc: snapshot")
