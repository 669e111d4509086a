"""``tmca design`` as a user meets it."""

import json
import tempfile
from pathlib import Path

import numpy as np
import pytest
import tifffile
import torch
import xarray as xr

from tmca.cli import main
from tmca.codes import read_codes, write_codes
from tmca.decoders import Weights
from tmca.design import Effort, SensorSheet
from tmca.reports import design_light_field, design_spectral

SMALL = ["coffee", "tissue", "--bands", "4", "--slots", "2", "--period", "6"]


def refused(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        main(["design", "spectral", *map(str, arguments)])
    assert stop.value.code == 2
    lines = [line for line in capsys.readouterr().err.strip().splitlines() if line.startswith("tmca:")]
    assert len(lines) == 1, lines
    return lines[0]


def test_codes_hold_the_light_that_is_asked_for(tmp_path, capsys):
    common = ["design", "spectral", *SMALL, "--kinds", "free", "--json"]
    main([*common, "--throughput", "0.3", "--read-noise", "0.05", "--out", str(tmp_path / "d")])
    found = json.loads(capsys.readouterr().out)
    for row in (found["static"], found["chosen"], *found["surveyed"]):
        assert row["throughput"] == pytest.approx(0.3, abs=0.03)
    assert "at most 1" in refused(capsys, *SMALL, "--throughput", "1.5", "--out", tmp_path / "e")


def test_the_page_names_codes_that_were_left_out(tmp_path, capsys):
    main(["design", "spectral", *SMALL, "--kinds", "one-hot", "--throughput", "0.9", "--out", str(tmp_path / "d")])
    said = "cannot let through 90% of the light: one-hot, K = 2."
    assert said in capsys.readouterr().out
    assert said in (tmp_path / "d" / "design.html").read_text()


def test_the_answer_may_be_the_static_code(tmp_path, capsys):
    main(["design", "spectral", *SMALL, "--read-noise", "30", "--out", str(tmp_path / "d")])
    assert "Do not multiplex" in capsys.readouterr().out
    assert read_codes(tmp_path / "d" / "codes.nc").aperture.shape == (1, 6, 6)
    assert "shutter=open" in (tmp_path / "d" / "design.html").read_text()
    main(["design", "spectral", *SMALL[:4], "--slots", "1", "--period", "6", "--out", str(tmp_path / "e")])
    assert "One slot" in capsys.readouterr().out


def test_dimmed_scenes_see_more_noise(tmp_path, capsys):
    found = {}
    for light in ("", "0.02"):
        told = ["--light", light] if light else []
        out = str(tmp_path / f"d{light}")
        main(["design", "spectral", *SMALL, "--kinds", "free", "--read-noise", "0.01", *told, "--out", out, "--json"])
        found[light] = json.loads(capsys.readouterr().out)
    bright, dim = found[""], found["0.02"]
    assert dim["light"] == pytest.approx(0.02)
    assert dim["examples_light"] == bright["examples_light"] == bright["light"]
    page, as_given = ((tmp_path / name / "design.html").read_text() for name in ("d0.02", "d"))
    assert "dimmed to a mean irradiance of 0.02" in page
    assert "compare gains, not PSNR" in page
    assert "as given" in as_given
    # the error of a dimmed scene falls by the square of its light and less, for noise stays
    fall = dim["static"]["expected_psnr"] - bright["static"]["expected_psnr"]
    assert fall < -20 * np.log10(dim["light"] / bright["light"]) - 1


def test_a_folder_that_cannot_be_written_is_found_before_the_search(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("tmca.reports.codes.advise", None)
    (tmp_path / "file").touch()
    assert "choose another" in refused(capsys, *SMALL, "--out", tmp_path / "file" / "d")
    real = tempfile.TemporaryFile

    def no_place(*given, dir, **named):
        if Path(dir) == tmp_path:
            raise PermissionError(13, "Permission denied")
        return real(*given, dir=dir, **named)

    monkeypatch.setattr("tempfile.TemporaryFile", no_place)
    assert "Permission denied" in refused(capsys, *SMALL, "--out", tmp_path / "a" / "d")
    assert sorted(tmp_path.iterdir()) == [tmp_path / "file"]


def test_progress_never_runs_backwards(tmp_path):
    told = []
    spectral = {"scenes": [*SMALL[:2], "rocket", "chelsea"], "bands": 4}
    for name, design, own in (("s", design_spectral, spectral), ("l", design_light_field, {"views": 3})):
        design(
            SensorSheet(), tmp_path / name, slots=[2], kinds=["free"], period=6, effort=Effort(1, 2, 0), **own,
            progress=lambda share, step: told.append(share),
        )  # fmt: skip
        assert told == sorted(told)
        assert 0.3 < told[-1] <= 1
        told.clear()


def test_one_scene_leaves_the_spread_unknown(tmp_path, capsys):
    main(["design", "spectral", *SMALL[:1], *SMALL[2:], "--kinds", "free", "--out", str(tmp_path / "d"), "--json"])
    found = json.loads(capsys.readouterr().out)
    assert found["best"]["spread"] is None
    assert "one example scene" in found["advice"]


def test_sensor_files_may_leave_values_empty(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.yaml").write_text("read_noise:\nfull_well: yes\n")
    assert "full_well = True" in refused(capsys, *SMALL, "--sensor", "s.yaml", "--out", "d")
    (tmp_path / "s.yaml").write_text("read_noise:\nfull_well: 1e4\n")
    main(["design", "spectral", *SMALL, "--sensor", "s.yaml", "--out", "d", "--json"])
    assert json.loads(capsys.readouterr().out)["sensor"]["read_noise"] == 0


def test_a_design_leaves_codes_that_can_be_taken_along(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sensor.yaml").write_text(
        "full_well: 10000\nread_noise_electrons: 3\nexposure: 0.01\npattern_rate: 1e3\n"
    )
    main(["design", "spectral", *SMALL, "--sensor", "sensor.yaml", "--bits", "12", "--out", "d", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert json.loads((tmp_path / "d" / "design.json").read_text())["advice"] == found["advice"]
    assert found["most_slots"] == 10
    assert found["sensor"]["bits"] == 12
    assert set(found["best"]["held_out"]) == {"coffee", "tissue"}
    assert found["chosen"]["expected_psnr"] >= found["static"]["expected_psnr"] - 1e-3
    with xr.open_dataset(tmp_path / "d" / "codes.nc") as codes:
        for name in ("aperture", "shutter"):
            stack = tifffile.imread(tmp_path / "d" / f"{name}.tif")
            np.testing.assert_array_equal(np.squeeze(codes[name].values) * 255, np.squeeze(stack))
    assert (tmp_path / "d" / "design.html").read_text().count("data:image/png") == 2
    common = ["simulate", "spectral", "coffee", "--bands", "4", "--crop", "24x30", "--no-figures", "--out"]
    slots = str(found["best"]["slots"])
    take = ["--aperture", "d/aperture.tif", "--shutter", "d/shutter.tif", "--period", "6", "--slots", slots]
    main([*common, "one.nc", *take])
    main([*common, "two.nc", "--codes", "d/codes.nc"])
    with xr.open_dataset("one.nc") as one, xr.open_dataset("two.nc") as two:
        for name in ("snapshot", "aperture", "shutter"):
            np.testing.assert_array_equal(one[name], two[name])
    tune = ["train", "spectral", "--train", "rocket", "--steps", "1", "--out", "run", "--set", "data.bands=4"]
    tune += ["--set", f"camera={{size: [24, 30], period: 6, slots: {slots}}}", "--set", "data.patch=16"]
    tune += [
        "--set",
        "codes.start=d/codes.nc",
        "--set",
        "decoder={kind: unrolled, start: dagger, widths: [4], blocks: 1}",
    ]
    main(tune)
    kept = Weights.load("run")
    np.testing.assert_array_equal(kept.aperture, tifffile.imread("d/aperture.tif").reshape(kept.aperture.shape) > 0)
    assert "earlier results" in refused(capsys, *SMALL, "--out", "d")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--sensor", "none.yaml"], "no such file"),
        (["--full-well", "-1"], "--full-well: found -1, expected a number above 0"),
        (["--bits", "0"], "--bits: found 0, expected 1 or more"),
        (["--exposure", "0.01", "--pattern-rate", "300", "--slots", "8"], "at most 3"),
        (["--pattern-rate", "300"], "exposure"),
        (["--kinds", "pretty"], "--kinds: found 'pretty', expected some of free, one-hot"),
        (["--kinds", "static"], "always searched"),
        (["--period", "5000"], "GB"),
        (["--period", "1000000"], "1000000×1000000 pixels"),
        (
            ["tissue", "rocket", "retina", "chelsea", "astronaut", "motorcycle", "--bands", "31"],
            "found 7 of 31 bands, 11.6 GB for what they say of blocks, expected at most 10 GB; name fewer scenes",
        ),
        (["--slots", "2000"], "code pixels"),
        (["--slots", "two"], "--slots: found two, expected a whole number"),
        (["--bands", "3", "--dispersion", "200"], "GB"),
        (["--period", "0"], "1 pixel"),
        (["--seed", "-1"], "0 or more"),
        (["--light", "1"], "a share above 0 and below 1"),
        (["--light", "0.9"], "tmca: --light: found 0.9, which brings the brightest value to"),
        (["--exposure", "1", "--slot-time", "0"], "tmca: --slot-time: found 0"),
        (["--exposure", "1", "--pattern-rate", "-1"], "tmca: --pattern-rate: found -1"),
        (["--exposure", "0.001", "--pattern-rate", "300"], "shorter than one pattern"),
        (["coffee"], "the same scene twice"),
    ],
)
def test_what_cannot_be_designed_is_one_line(tmp_path, capsys, options, words):
    assert words in refused(capsys, "coffee", "--out", tmp_path / "d", *options)
    assert not (tmp_path / "d").exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [("full_wel: 3", "full_wel"), ("full_well: many", "a number"), ("- 3", "names and values"), ("bits: 2.5", "whole"),
     ("{", "readable")],
)  # fmt: skip
def test_a_sheet_that_cannot_be_read_is_one_line(tmp_path, capsys, text, words):
    (tmp_path / "s.yaml").write_text(text)
    assert words in refused(capsys, "coffee", "--out", tmp_path / "d", "--sensor", tmp_path / "s.yaml")


def test_kinds_that_are_named_twice_are_searched_once(tmp_path, capsys):
    main(["design", "spectral", *SMALL, "--kinds", "one-hot, one-hot", "--out", str(tmp_path / "d"), "--json"])
    surveyed = json.loads(capsys.readouterr().out)["surveyed"]
    assert [row["codes"] for row in surveyed] == ["static", "one-hot"]


def test_scenes_too_small_for_the_blocks_are_named(tmp_path, capsys):
    np.save(tmp_path / "small.npy", np.random.default_rng(0).random((4, 6, 6)).astype(np.float32))
    line = refused(
        capsys, tmp_path / "small.npy", "--wavelengths", "400:700:4", "--bands", "4", "--out", tmp_path / "d"
    )
    assert "small" in line
    assert "6×6 pixels" in line


@pytest.mark.parametrize("light", [[], ["--light", "0.1"]])
def test_scenes_without_light_are_named(tmp_path, capsys, light):
    lit = np.random.default_rng(0).random((4, 24, 40)).astype(np.float32)
    for name, scene in {"black": 0 * lit, "night": 0 * lit, "day": lit}.items():
        np.save(tmp_path / f"{name}.npy", scene)
    how = ["--wavelengths", "400:700:4", "--bands", "4", "--slots", "2", "--period", "6", *light]
    for names in (["black", "night"], ["day", "black", "night"]):
        files = [tmp_path / f"{name}.npy" for name in names]
        line = refused(capsys, *files, *how, "--out", tmp_path / "d")
        assert "tmca: black, night: found no light, mean irradiance 0" in line
    assert not (tmp_path / "d").exists()


def test_codes_files_that_do_not_fit_are_one_line(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_codes("codes.nc", torch.ones(2, 6, 6), torch.ones(2, 6, 6), (6, 6))
    found = read_codes("codes.nc")
    assert (found.period, found.aperture.shape) == ((6, 6), (2, 6, 6))
    for options, words in (
        (["--codes", "none.nc"], "no such file"),
        (["--codes", "codes.nc", "--slots", "3"], "as the codes have"),
        (["--codes", "codes.nc", "--shutter", "open"], "--shutter beside it"),
    ):
        with pytest.raises(SystemExit) as stop:
            main(["simulate", "spectral", "coffee", "--bands", "4", "--crop", "24x30", "--out", "s.nc", *options])
        assert stop.value.code == 2
        assert words in capsys.readouterr().err


def test_codes_of_a_light_field_camera_are_designed_and_taken_along(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    small = ["--views", "3", "--slots", "2", "--period", "6", "--kinds", "free", "--read-noise", "0.02"]
    main(["design", "light-field", "rocket", "retina", *small, "--out", "d", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert found["camera"] == "light-field"
    assert found["channels"] == 9
    assert found["chosen"]["expected_psnr"] >= found["static"]["expected_psnr"] - 1e-3
    assert "tmca train light-field" in (tmp_path / "d" / "design.html").read_text()
    common = ["simulate", "light-field", "coffee", "--views", "3", "--crop", "24x30", "--no-figures"]
    main([*common, "--codes", "d/codes.nc", "--out", "s.nc"])
    with xr.open_dataset("s.nc") as taken, xr.open_dataset("d/codes.nc") as codes:
        np.testing.assert_array_equal(taken["shutter"][:, :6, :6], codes["shutter"])
        np.testing.assert_array_equal(taken["aperture"][:, :6, :6], codes["aperture"])
