"""What a file does not say is never made up in silence, and an estimate is never rescaled."""

import json

import numpy as np
import pytest
import xarray as xr

from tests.cli.test_bad_input import cube, good, refused, small_snapshot
from tmca.cli import main
from tmca.data import read_dataset


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def labelled(name, values, nanometres):
    coords = {"wavelength": ("wavelength", nanometres, {"units": "nm"})}
    xr.DataArray(values, dims=("y", "x", "wavelength"), coords=coords, name="cube").to_netcdf(name)


def psnr_of(capsys, *arguments):
    main(["evaluate", *arguments, "--json"])
    return json.loads(capsys.readouterr().out)["psnr"]


def test_an_estimate_above_one_is_measured_as_it_is(capsys):
    truth, estimate = good() * 0.9, good() * 0.9
    estimate[3, 4, 5] = 2.0
    np.save("truth.npy", truth)
    np.save("estimate.npy", estimate)
    error = np.mean((truth.astype("f4") - estimate.astype("f4")) ** 2)
    assert psnr_of(capsys, "estimate.npy", "truth.npy") == pytest.approx(-10 * np.log10(error), abs=1e-3)
    np.save("bright.npy", truth * 4)
    main(["evaluate", "estimate.npy", "bright.npy"])
    assert "divided by its maximum" in capsys.readouterr().err


def test_what_was_taken_for_granted_is_said(capsys):
    np.save("bright.npy", good() * 3)
    main(["simulate", "spectral", "bright.npy", "--no-figures", "--out", "s.nc"])
    said = capsys.readouterr().err
    assert "known set CAVE" in said
    assert "divided by its maximum, 2.99" in said
    main(["simulate", "spectral", "bright.npy", "--scale", "3", "--wavelengths", "400:700:31", "--no-figures"])
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("bands", [31, 20])
@pytest.mark.parametrize("bad", [np.nan, 0.0])
def test_broken_wavelengths_are_refused_and_not_replaced(capsys, bands, bad):
    nanometres = np.linspace(400, 700, bands)
    nanometres[2 if np.isnan(bad) else slice(None)] = bad
    labelled("broken.nc", good()[..., :bands], nanometres)
    line = refused(capsys, "simulate", "spectral", "broken.nc", "--bands", "3")
    assert "a wavelength from the file that is not a positive number" in line


def test_wavelengths_of_the_command_line_reach_an_estimate_without_its_own(capsys):
    np.save("five.npy", good()[..., :5])
    labelled("truth.nc", good()[..., :5], [400.0, 450.0, 500.0, 600.0, 700.0])
    assert "--wavelengths in nm" in refused(capsys, "evaluate", "five.npy", "truth.nc")
    assert psnr_of(capsys, "five.npy", "truth.nc", "--wavelengths", "400,450,500,600,700") > 60


def test_swapped_files_are_named(capsys):
    cube("many.mat", good())
    labelled("few.nc", good()[..., ::3], np.linspace(400, 700, 31)[::3])
    assert "few.nc: found 31 wavelengths for which only 11" in refused(capsys, "evaluate", "many.mat", "few.nc")
    cube("small.mat", good()[:6])
    assert "small.mat: found 6×14 (y, x)" in refused(capsys, "evaluate", "many.mat", "small.mat")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--slots", "1.5"], "--slots: found 1.5, expected a whole number"),
        (["--bits", "8.7"], "--bits: found 8.7"),
        (["--seed", "-1"], "--seed: found -1"),
        (["--seed", "99999999999"], "--seed: found 99999999999"),
        (["--duty", "-1"], "--duty: found -1"),
        (["--bands", "0"], "--bands: found 0"),
        (["--slots", "1000000000"], "GiB"),
        (["--motion", "100,100"], "--motion: found 100,100"),
        (["--full-well", "0"], "leave it out"),
        (["--period", "0"], "leave it out"),
        (["--relay-blur", "-1"], "--relay-blur"),
    ],
)
def test_impossible_numbers_are_named_as_they_were_given(capsys, options, words):
    assert words in refused(capsys, "simulate", "spectral", "coffee", "--crop", "12x14", *options)


@pytest.mark.parametrize("name", ["sensor", "exposure", "disperser", "full_scale", "origin"])
def test_a_snapshot_that_does_not_say_what_its_values_mean_is_refused(capsys, name):
    whole = read_dataset(small_snapshot())
    del whole.attrs[name]
    whole.to_netcdf("silent.nc")
    line = refused(capsys, "reconstruct", "silent.nc", "--decoder", "dagger")
    assert f"silent.nc: found no attribute {name}" in line
    whole = read_dataset("s_snapshot.nc").assign_attrs(full_scale=3.0)
    whole.to_netcdf("wrong.nc")
    assert "full_scale 3, expected 12" in refused(capsys, "reconstruct", "wrong.nc", "--decoder", "dagger")
