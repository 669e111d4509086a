"""Sweeps of the spectral-depth camera: texture and depth, files of codes, refusals."""

import json

import numpy as np
import pytest
import xarray as xr

from tests.cli.refusals import refused
from tests.evaluation.test_compare_spectral_depth import scene
from tmca.cameras import SpectralDepthCamera
from tmca.cameras.phase_codes import write_phase_codes
from tmca.cli import main
from tmca.evaluation.spectral_depth import of_contrast

pytestmark = [  # strong masks on a narrow window, of few pixels
    pytest.mark.filterwarnings("ignore::tmca.optics.StrayLight"),
    pytest.mark.filterwarnings("ignore::tmca.optics.Undersampled"),
]
SMALL = {"channels": "monochrome", "filters": "clear", "planes": 3, "rms": 1.5e-7}


@pytest.fixture
def scenes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    made = [scene(tmp_path / f"{name}.nc", seed) for seed, name in enumerate(("learned", "measured"))]
    (tmp_path / "train.txt").write_text("learned.nc\n")
    return made


def sweep(*more, crop="36x40"):
    fixed = [part for name, value in SMALL.items() for part in ("--set", f"{name}={value}")]
    return ["sweep", "spectral-depth", "measured.nc", "--train", "train.txt", "--crop", crop, *fixed, *more]


def test_contrast_squeezes_texture_and_keeps_means_and_depth(scenes):
    with xr.open_dataset(scenes[1]) as whole:
        for contrast in (0.0, 0.3, 1.0):
            found = of_contrast(whole, contrast)
            mean, deviation = (np.asarray(v["radiance"].mean(("y", "x"))) for v in (found, whole))
            np.testing.assert_allclose(mean, deviation, rtol=1e-5)
            spread = np.asarray(found["radiance"].std(("y", "x")) / whole["radiance"].std(("y", "x")))
            np.testing.assert_allclose(spread, contrast, atol=1e-5)
            assert found["radiance"].dims == whole["radiance"].dims
            assert found["depth"].equals(whole["depth"])


@pytest.mark.slow
@pytest.mark.usefixtures("scenes")
def test_depth_needs_texture(capsys, tmp_path):
    fixed = ("--set", "slots=4", "--set", "noise=0.002", "--set", "shutter=one-hot")
    main(sweep("--vary", "contrast=0.01,1", *fixed, "--json", crop="56x60"))
    found = json.loads(capsys.readouterr().out)
    poor, rich = found["rows"]
    assert rich["depth_mae"] < 0.8 * poor["depth_mae"]
    assert {file.name for file in tmp_path.glob("sweep.*")} == {"sweep.json", "sweep.csv", "sweep.md", "sweep.png"}
    assert "depth MAE (m)" in (tmp_path / "sweep.md").read_text()


@pytest.mark.usefixtures("scenes")
def test_files_of_codes_are_swept_and_say_their_own_settings(capsys, tmp_path):
    camera = SpectralDepthCamera.from_preset("quick", size=(32, 32), slots=2, shutter="one-hot", filters="clear",
                                             channels="monochrome", planes=3)  # fmt: skip
    write_phase_codes(camera, tmp_path / "codes.nc", "clear", "monochrome")
    base = ["sweep", "spectral-depth", "measured.nc", "--train", "train.txt", "--crop", "36x40"]
    main([*base, "--vary", "noise=0.01", "--set", "codes=codes.nc", "--json"])
    assert json.loads(capsys.readouterr().out)["rows"][0]["throughput"] == pytest.approx(0.5)
    said = refused(capsys, *base, "--vary", "noise=0.02", "--set", "codes=codes.nc", "--set", "slots=2", "--overwrite")
    assert "beside slots" in said


@pytest.mark.usefixtures("scenes")
@pytest.mark.parametrize(
    ("more", "said"),
    [
        (("--vary", "contrast=2"), "contrast"),
        (("--vary", "lens=1,2"), "lens"),
        (("--vary", "slots=0"), "slots"),
        (("--vary", "mask=spiral"), "mask"),
        (("--vary", "slots=1,2", "--set", "codes=none.nc"), "codes"),
        (("--vary", "period=4,40"), "--crop: found 36×40 pixels, expected at least the 40 of the tile of the codes"),
    ],
)
def test_what_makes_no_camera_is_refused(capsys, tmp_path, more, said):
    assert said in refused(capsys, *sweep(*more))
    assert not list(tmp_path.glob("sweep.*"))


@pytest.mark.usefixtures("scenes")
def test_scenes_that_cannot_be_read_so_are_refused_before_anything_is_measured(capsys, tmp_path):
    with xr.open_dataset("measured.nc") as whole:
        whole[["radiance"]].to_netcdf("bare.nc")
    for name, remedy in (("bare.nc", "--placed random"), ("none.nc", "no such")):
        assert remedy in refused(capsys, "sweep", "spectral-depth", name, "--vary", "slots=1,2", "--out", "found")
    assert "--placed random" in refused(capsys, "simulate", "spectral-depth", "bare.nc")
    assert not list(tmp_path.glob("found*"))


@pytest.mark.slow
@pytest.mark.usefixtures("scenes")
def test_tiles_larger_than_the_usual_window_are_swept(capsys):
    main(sweep("--vary", "period=2,14", "--set", "slots=2", "--set", "noise=0.01", "--json"))
    assert [row["period"] for row in json.loads(capsys.readouterr().out)["rows"]] == [2, 14]
