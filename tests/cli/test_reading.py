"""What a file does not say is never made up in silence, an estimate is never rescaled, and options say how to read."""

import numpy as np
import pytest

from tests.cli.calls import answer, run
from tests.cli.small_files import good, labelled
from tmca.cli import main


def simulate(capsys, *arguments):
    return run(capsys, "simulate", "spectral", *arguments, "--no-figures")


def psnr_of(capsys, *arguments):
    return answer(capsys, "evaluate", *arguments)["psnr"]


def test_an_estimate_above_one_is_measured_as_it_is(capsys):
    truth, estimate = good() * 0.9, good() * 0.9
    estimate[3, 4, 5] = 2.0
    np.save("truth.npy", truth)
    np.save("estimate.npy", estimate)
    error = np.mean((truth.astype("f4") - estimate.astype("f4")) ** 2)
    assert psnr_of(capsys, "estimate.npy", "truth.npy") == pytest.approx(-10 * np.log10(error), abs=1e-3)
    np.save("bright.npy", truth * 4)
    assert "divided by its maximum" in run(capsys, "evaluate", "estimate.npy", "bright.npy").err


def test_what_was_taken_for_granted_is_said(capsys):
    np.save("bright.npy", good() * 3)
    assumed = simulate(capsys, "bright.npy", "--out", "s.nc").err
    assert "known set CAVE" in assumed
    assert "divided by its maximum, 2.99" in assumed
    assert simulate(capsys, "bright.npy", "--scale", "3", "--wavelengths", "400:700:31").err == ""


def test_wavelengths_of_the_command_line_reach_an_estimate_without_its_own(capsys):
    np.save("five.npy", good()[..., :5])
    labelled("truth.nc", good()[..., :5], [400.0, 450.0, 500.0, 600.0, 700.0])
    assert psnr_of(capsys, "five.npy", "truth.nc", "--wavelengths", "400,450,500,600,700") > 60


@pytest.mark.filterwarnings("default::tmca.cameras.CodesWarning")
def test_patterns_from_a_file_set_the_slots_and_give_their_middle(capsys):
    np.save("patterns.npy", (np.random.default_rng(0).random((3, 40, 40)) < 0.5).astype(np.uint8))
    printed = simulate(capsys, "coffee", "--crop", "24x24", "--aperture", "patterns.npy")
    assert "K = 3" in printed.out
    assert "middle 24×24 of 40×40" in printed.err


def test_a_coloured_aperture_and_a_moving_scene_come_from_the_command_line(tmp_path, capsys):
    np.save("colours.npy", np.random.default_rng(0).random((12, 24, 24)).astype(np.float32))
    simulate(capsys, "coffee", "--crop", "24x24", "--coloured", "colours.npy", "--out", "c.nc")
    simulate(capsys, "coffee", "--crop", "24x24", "--motion", "0,2.5", "--out", "m.nc")
    simulate(capsys, "coffee", "chelsea", "--crop", "24x24", "--slots", "2", "--out", "two.nc")
    main(["reconstruct", "c.nc", "-d", "dagger", "--no-figures"])
    assert (tmp_path / "c_dagger.nc").exists()


@pytest.mark.filterwarnings("default::tmca.data.scenes.DarkScene")
def test_negative_pixels_are_clipped_where_asked(capsys):
    reading = ("--wavelengths", "400:700:31")
    np.save("negative.npy", np.random.default_rng(0).random((31, 24, 24), dtype=np.float32) - 0.1)
    np.save("dark.npy", np.zeros((31, 24, 24), dtype=np.float32))
    simulate(capsys, "negative.npy", *reading, "--negative", "clip")
    assert "every pixel is zero" in simulate(capsys, "dark.npy", *reading).err


def test_a_picture_is_drawn_by_its_suffix(tmp_path, capsys):
    simulate(capsys, "coffee", "--crop", "24x24", "--out", "s.nc")
    assert run(capsys, "inspect", "s.nc", "--figure", "s.svg").out.startswith("s.nc: snapshot")
    assert (tmp_path / "s.svg").read_text().startswith("<?xml")
