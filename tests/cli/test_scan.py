"""``tmca scan`` from projected fringes to a scene that the spectral-depth camera takes, and what it refuses."""

import json
import shutil

import numpy as np
import pytest
import xarray as xr
from PIL import Image

from tests.cli.calls import answer, said
from tests.cli.refusals import refused
from tmca.cli import main
from tmca.data import read_spectral_depth

PLAN = ("--plan", "table/fringes", "--calibration", "table/calibration.json")
LIGHT = ("--dark", "table/dark", "--white", "table/white")


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    main(["scan", "render", str(folder / "table"), "--size", "60x90", "--picture", "chelsea"])
    return folder / "table"


@pytest.fixture
def table(bench, tmp_path):
    """The files of a table in a folder of the test's own."""
    shutil.copytree(bench, tmp_path / "table")
    return tmp_path / "table"


@pytest.mark.slow
def test_from_frames_to_a_scene_that_the_camera_takes(capsys):
    main(["scan", "render", "table", "--size", "100x150", "--picture", "chelsea"])
    outputs = ("--out", "depth.nc", "--figure", "depth.png", "--truth", "table/truth.nc", "--json")
    depth = ("scan", "depth", "table/captures", *PLAN, *outputs)
    about = json.loads(said(capsys, *depth))
    assert about["pixels"]["known"] > 0.6 * 100 * 150
    assert about["median_std"] < 2e-3
    assert about["rmse_percent"] < 0.2
    assert 0.8 < about["in_deviations"] < 1.6  # texture within a pixel moves its depth, which is no noise
    asked = ("--wavelengths", "400:700:31")
    spectra = ("scan", "spectra", "table/scene", *LIGHT, *asked, "--out", "spectra.nc", "--figure", "spectra.png")
    assert "31 bands, 400 to 700 nm, 100×150 pixels" in said(capsys, *spectra)
    points = ("--references", "table/references.csv", "--points", "P1=30,45", "P2=50,105", "--figure", "sam.png")
    rows = answer(capsys, "scan", "compare", "spectra.nc", *points)
    assert [row["point"] for row in rows] == ["P1", "P2"]
    assert max(row["sam"] for row in rows) < 1
    assert "SAM" in said(capsys, "scan", "compare", "table/truth.nc", *points[:5], "--filters", "table/references.csv")
    assert "31 bands" in said(capsys, "scan", "join", "spectra.nc", "depth.nc", "--out", "s.nc", "--figure", "s.png")
    scene, truth = read_spectral_depth("s.nc"), read_spectral_depth("table/truth.nc")
    error = scene["depth"].values - truth["depth"].values
    assert np.sqrt(np.nanmean(error**2)) < 0.002 * 1.2
    assert np.abs(scene["radiance"].values - truth["radiance"].values).mean() < 0.005
    assert "spectral-depth scene" in said(capsys, "inspect", "s.nc")
    for picture in ("depth", "spectra", "sam", "s"):
        assert Image.open(f"{picture}.png").width > 600


def test_what_is_said_of_a_scan_is_what_its_files_hold(capsys, table):
    text = said(capsys, "scan", "depth", "table/captures", *PLAN, "--out", "depth.nc", "--truth", "table/truth.nc")
    with xr.open_dataset("depth.nc") as depth, xr.open_dataset("table/truth.nc") as truth:
        error = depth["depth"].values - truth["depth"].values
        known, rmse = np.isfinite(error), 1e3 * np.sqrt(np.nanmean(error**2))
    assert f"{known.sum()} of 5400 pixels known" in text
    assert f"against the truth: RMSE {rmse:.3g} mm" in text
    about = answer(capsys, "scan", "spectra", "table/scene", *LIGHT, "--out", "spectra.nc")
    assert (about["bands"], about["first_nm"], about["last_nm"]) == (31, 400, 700)
    points = ("--references", "table/references.csv", "--points", "P1=18,27", "P2=30,63")
    rows = answer(capsys, "scan", "compare", "spectra.nc", *points)
    with xr.open_dataset("spectra.nc") as spectra:
        spectrum = spectra["reflectance"].values[:, 16:21, 25:30].mean((1, 2))
        assert about["median_std"] == pytest.approx(float(np.nanmedian(spectra["reflectance_std"])))
    nm, *references = np.loadtxt("table/references.csv", delimiter=",", skiprows=1).T
    assert nm == pytest.approx(np.linspace(400, 700, len(nm)))
    reference = np.interp(np.linspace(400, 700, 31), nm, references[0])
    cosine = spectrum @ reference / np.linalg.norm(spectrum) / np.linalg.norm(reference)
    assert [row["point"] for row in rows] == ["P1", "P2"]
    assert rows[0]["sam"] == pytest.approx(np.degrees(np.arccos(cosine)), rel=0.02)
    text = said(capsys, "scan", "compare", "spectra.nc", *points)
    assert f"{np.mean([row['sam'] for row in rows]):.3f}" in text.splitlines()[-1]
    text = said(capsys, "scan", "join", "spectra.nc", "depth.nc", "--out", "s.nc", "--wavelengths", "440:680:3")
    assert f"s.nc: 3 bands, 60×90 pixels, {(~known).sum()} of unknown depth" in text
    scene = read_spectral_depth("s.nc")
    np.testing.assert_array_equal(np.isfinite(scene["depth"].values), known)
    np.testing.assert_allclose(scene["wavelength"].values, [440e-9, 560e-9, 680e-9])


@pytest.mark.slow
def test_the_spectral_depth_camera_takes_a_snapshot_of_the_scene(capsys, table):
    said(capsys, "scan", "depth", "table/captures", *PLAN, "--out", "depth.nc")
    said(capsys, "scan", "spectra", "table/scene", *LIGHT, "--out", "spectra.nc")
    said(capsys, "scan", "join", "spectra.nc", "depth.nc", "--wavelengths", "440:680:8", "--out", "s.nc")
    said(capsys, "simulate", "spectral-depth", "s.nc", "--crop", "48x48", "--metric-depth", "--out", "snap.nc")
    assert "snapshot" in said(capsys, "inspect", "snap.nc")


def test_fringes_are_pictures_in_order(capsys, tmp_path):
    text = said(capsys, "scan", "fringes", "f", "--projector", "60x90", "--fringes", "1,5", "--steps", "3")
    assert "6 frames, fringe_0001_00.png … fringe_0005_02.png" in text
    assert Image.open("f/fringe_0005_02.png").size == (90, 60)
    assert json.loads((tmp_path / "f" / "fringes.json").read_text())["steps"] == 3


DEPTH = ("depth", "table/captures", *PLAN, "--out", "d.nc")
SPECTRA = ("spectra", "table/scene", *LIGHT, "--out", "s.nc")
COMPARE = ("compare", "table/truth.nc", "--references", "table/references.csv", "--points")


def without(name):
    return lambda table: (table / name).unlink()


@pytest.mark.parametrize(
    ("spoil", "arguments", "words"),
    [
        (None, (*DEPTH, "--figure", "d.xyz"), "found the suffix '.xyz'"),
        (None, (*DEPTH, "--neighbours", "12"), "0 to 8"),
        (None, (*DEPTH, "--far", "0.5"), "out of range"),
        (None, (*DEPTH, "--saturation", "3000"), "% of the pixels saturated"),
        (without("captures/fringe_0016_01.png"), DEPTH, "found no fringe_0016_01"),
        (lambda table: (table / "calibration.json").write_text("{}"), DEPTH, "found no entry camera"),
        (None, (*SPECTRA, "--wavelengths", "400:700:16"), "expected the 16 wavelengths asked for"),
        (None, (*SPECTRA, "--white-reflectance", "bright"), "a number or a file of its spectrum"),
        (None, (*SPECTRA, "--saturation", "3000"), "saturated in"),
        (None, (*SPECTRA, "--read-noise", "-1"), "--read-noise"),
        (without("white/white_500nm.png"), SPECTRA, "table/white: found no frame at 500 nm"),
        (None, (*COMPARE, "P1"), "NAME=ROW,COLUMN"),
        (None, (*COMPARE, "P1=18,27", "P1=30,30"), "--points: found P1 twice"),
        (None, ("join", "table/truth.nc", "table/truth.nc", "--out", "s.nc"), "expected a file of tmca scan spectra"),
    ],
)
def test_what_cannot_be_scanned_is_one_line_and_nothing_is_written(capsys, table, spoil, arguments, words):
    if spoil:
        spoil(table)
    assert words in refused(capsys, "scan", *arguments)
    assert sorted(entry.name for entry in table.parent.iterdir()) == ["table"]
