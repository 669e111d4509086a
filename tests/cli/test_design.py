"""``tmca design`` as a user meets it; codes and expected errors are tested with the search itself."""

import json
import shutil
import tempfile
from pathlib import Path

import numpy as np
import pytest
import tifffile
import torch
import xarray as xr

from tests.cli import refusals
from tests.cli.calls import answer, said
from tmca.cameras import Snapshot, SpectralCamera, SpectralDepthCamera
from tmca.cli import main
from tmca.codes import read_codes, write_codes
from tmca.data import rendered_light_field, rendered_scene, write_dataset
from tmca.decoders import Weights
from tmca.design import Effort, advise, measures
from tmca.priors import GaussianPrior, expected_psnr
from tmca.sensor import Sensor

SMALL = ["coffee.nc", "tissue.nc", "--bands", "4", "--slots", "2", "--period", "6"]


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenes")
    for name in ("coffee", "tissue"):
        scene = rendered_scene(name, wavelengths=np.linspace(4e-7, 7e-7, 4), size=(48, 60))
        write_dataset(scene[["radiance"]], folder / f"{name}.nc")
    for name in ("rocket", "retina"):
        write_dataset(rendered_light_field(name, views=3, size=(48, 60))[["light_field"]], folder / f"{name}.nc")
    return folder


@pytest.fixture(autouse=True)
def small(rendered, tmp_path, monkeypatch):
    """Small scenes in the folder, and searches of few steps."""
    for file in rendered.iterdir():
        shutil.copy(file, tmp_path)

    def hasty(*given, **how):
        return advise(*given, **{**how, "survey": Effort(1, 3, 0), "effort": Effort(1, 6, 20)})

    monkeypatch.setattr("tmca.reports.codes.advise", hasty)


def design(capsys, *arguments):
    return answer(capsys, "design", "spectral", *SMALL, *arguments)


def refused(capsys, *arguments):
    return refusals.refused(capsys, "design", "spectral", *arguments, lines=None)


def test_the_page_names_codes_that_were_left_out(capsys):
    left_out = "cannot let through 90% of the light: one-hot, K = 2."
    how = ("--kinds", "one-hot", "--throughput", "0.9", "--out", "d")
    assert left_out in said(capsys, "design", "spectral", *SMALL, *how)
    assert left_out in Path("d/design.html").read_text()


@pytest.mark.filterwarnings("always::tmca.sensor.SensorWarning")
@pytest.mark.slow
def test_the_answer_may_be_the_static_code(capsys):
    words = said(capsys, "design", "spectral", *SMALL, "--read-noise", "30", "--out", "d")
    assert "Do not multiplex" in words
    assert words.endswith("codes.nc holds K = 1 (static); the best of K = 2 is codes_k2.nc\n")
    assert read_codes("d/codes.nc").aperture.shape == (1, 6, 6)
    assert read_codes("d/codes_k2.nc").aperture.shape == (2, 6, 6)
    assert "shutter=open" in Path("d/design.html").read_text()
    single = ("--slots", "1", "--period", "6", "--out", "d", "--overwrite")
    words = said(capsys, "design", "spectral", *SMALL[:4], *single)
    assert "One slot" in words
    assert words.endswith("codes.nc holds K = 1 (static)\n")
    assert {file.name for file in Path("d").glob("*.nc")} == {"codes.nc", "codes_k1.nc"}


def test_a_folder_that_cannot_be_written_is_found_before_the_search(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("tmca.reports.codes.advise", None)
    (tmp_path / "file").touch()
    before = sorted(tmp_path.iterdir())
    assert "choose another" in refused(capsys, *SMALL, "--out", tmp_path / "file" / "d")
    real = tempfile.TemporaryFile

    def no_place(*given, dir, **named):
        if Path(dir) == tmp_path:
            raise PermissionError(13, "Permission denied")
        return real(*given, dir=dir, **named)

    monkeypatch.setattr("tempfile.TemporaryFile", no_place)
    assert "no permission to write" in refused(capsys, *SMALL, "--out", tmp_path / "a" / "d")
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.slow
def test_a_design_leaves_codes_that_can_be_taken_along(capsys):
    Path("sensor.yaml").write_text("full_well: 10000\nread_noise_electrons: 3\nexposure: 0.01\npattern_rate: 1e3\n")
    found = design(capsys, "--sensor", "sensor.yaml", "--bits", "12", "--out", "d")
    assert json.loads(Path("d/design.json").read_text())["advice"] == found["advice"]
    slots, every = found["best"]["slots"], {"codes.nc", "codes_k1.nc", "codes_k2.nc", "burst.nc"}
    assert {file.name for file in Path("d").glob("*.nc")} == set(found["files"]) == every
    assert [len(read_codes(f"d/codes{k}.nc").aperture) for k in ("", "_k1", "_k2")] == [slots, 1, 2]
    assert found["most_slots"] == 10
    assert found["sensor"]["bits"] == 12
    assert set(found["best"]["held_out"]) == {"coffee", "tissue"}
    assert found["chosen"]["expected_psnr"] >= found["static"]["expected_psnr"] - 1e-3
    with xr.open_dataset("d/codes.nc") as codes:
        for name in ("aperture", "shutter"):
            stack = tifffile.imread(f"d/{name}.tif")
            np.testing.assert_array_equal(np.squeeze(codes[name].values) * 255, np.squeeze(stack))
    assert Path("d/design.html").read_text().count(";base64,") == 2
    common = ["simulate", "spectral", "coffee.nc", "--bands", "4", "--crop", "24x30", "--no-figures", "--out"]
    take = ["--aperture", "d/aperture.tif", "--shutter", "d/shutter.tif", "--period", "6", "--slots", str(slots)]
    main([*common, "one.nc", *take])
    main([*common, "two.nc", "--codes", "d/codes.nc"])
    with xr.open_dataset("one.nc") as one, xr.open_dataset("two.nc") as two:
        for name in ("snapshot", "aperture", "shutter"):
            np.testing.assert_array_equal(one[name], two[name])
    settings = ("data.bands=4", "data.patch=16", f"camera={{size: [24, 30], period: 6, slots: {slots}}}",
                "codes.start=d/codes.nc",
                "decoder={kind: unrolled, start: dagger, widths: [4], blocks: 1}")  # fmt: skip
    told = [word for setting in settings for word in ("--set", setting)]
    main(["train", "spectral", "--train", "coffee.nc", "--steps", "1", "--out", "run", *told])
    kept = Weights.load("run")
    np.testing.assert_array_equal(kept.aperture, tifffile.imread("d/aperture.tif").reshape(kept.aperture.shape) > 0)
    assert "earlier results" in refused(capsys, *SMALL, "--out", "d")


@pytest.mark.slow
def test_codes_of_a_light_field_camera_are_designed_and_taken_along(capsys):
    small = ["--views", "3", "--slots", "2", "--period", "6", "--kinds", "free", "--read-noise", "0.02"]
    found = answer(capsys, "design", "light-field", "rocket.nc", "retina.nc", *small, "--out", "d")
    assert found["camera"] == "light-field"
    assert found["channels"] == 9
    assert found["chosen"]["expected_psnr"] >= found["static"]["expected_psnr"] - 1e-3
    assert "tmca train light-field" in Path("d/design.html").read_text()
    common = ["simulate", "light-field", "coffee", "--views", "3", "--crop", "24x30", "--no-figures"]
    main([*common, "--codes", "d/codes.nc", "--out", "s.nc"])
    with xr.open_dataset("s.nc") as taken, xr.open_dataset("d/codes.nc") as codes:
        np.testing.assert_array_equal(taken["shutter"][:, :6, :6], codes["shutter"])
        np.testing.assert_array_equal(taken["aperture"][:, :6, :6], codes["aperture"])


@pytest.mark.slow
@pytest.mark.parametrize("camera", ["spectral", "light-field"])
def test_codes_of_two_buckets_are_designed_and_taken_along(camera, capsys):
    scenes, own = (["coffee.nc", "tissue.nc"], ["--bands", "4"])
    if camera == "light-field":
        scenes, own = (["rocket.nc", "retina.nc"], ["--views", "3"])
    asked = ["--slots", "2", "--period", "4", "--buckets", "2", "--read-noise", "0.02", "--out", "d"]
    found = answer(capsys, "design", camera, *scenes, *own, *asked)
    assert (found["best"]["codes"], found["buckets"], found["sensor"]["buckets"]) == ("two-bucket", 2, 2)
    assert [row["codes"] for row in found["surveyed"]] == ["static", "one-hot", "free", "two-bucket", "burst"]
    assert [row["readings"] for row in found["designs"]] == [1, 1, 2, 2]
    assert "This sensor with two buckets: " in found["advice"]
    page = Path("d/design.html").read_text()
    assert found["advice"].split(";")[1] in page
    assert page.count(";base64,") == 2
    assert len(tifffile.imread("d/shutter.tif")) == 2
    take = ["simulate", camera, scenes[0], *own, "--crop", "24x30", "--no-figures"]
    for name, patterns in (("codes", 2), ("burst", 4)):
        main([*take, "--codes", f"d/{name}.nc", "--out", f"{name}.nc"])
        with xr.open_dataset(f"{name}.nc") as taken, xr.open_dataset(f"d/{name}.nc") as codes:
            assert taken["snapshot"].sizes["bucket"] == 2
            assert codes["shutter"].size == patterns * 4 * 4
    judged = answer(capsys, "design", "judge", "codes.nc", "--figure", "judge.png")
    assert judged["throughput"] == pytest.approx(found["best"]["throughput"], abs=0.02)
    assert judged["buckets"] == 2
    assert "--set camera.slots=2 --set camera.period=4 --set camera.learn=none --set camera.buckets=2" in page
    settings = ["camera={size: [24, 30], period: 4, slots: 2, buckets: 2}", "codes.start=d/codes.nc", "data.patch=16"]
    settings += ["decoder={kind: unet, widths: [4], blocks: 1}", "data.bands=4"]
    if camera == "spectral":
        told = [word for setting in settings for word in ("--set", setting)]
        main(["train", camera, "--train", scenes[0], "--steps", "1", "--out", "run", *told])
        assert Weights.load("run").camera.buckets == 2


def test_scenes_too_small_for_the_blocks_are_named(capsys):
    np.save("small.npy", np.random.default_rng(0).random((4, 6, 6)).astype(np.float32))
    line = refused(capsys, "small.npy", "--wavelengths", "400:700:4", "--bands", "4", "--out", "d")
    assert "small" in line
    assert "6×6 pixels" in line


def test_codes_files_that_do_not_fit_are_one_line(capsys):
    write_codes("codes.nc", torch.ones(2, 6, 6), torch.ones(2, 6, 6), (6, 6))
    codes = read_codes("codes.nc")
    assert (codes.period, codes.aperture.shape) == ((6, 6), (2, 6, 6))
    for options, words in (
        (["--codes", "none.nc"], "no such file"),
        (["--codes", "codes.nc", "--slots", "3"], "as the codes have"),
        (["--codes", "codes.nc", "--shutter", "open"], "--shutter beside it"),
    ):
        take = ("simulate", "spectral", "coffee.nc", "--bands", "4", "--crop", "24x30", "--out", "s.nc")
        assert words in refusals.refused(capsys, *take, *options)


@pytest.mark.slow
def test_dimmed_scenes_see_more_noise(capsys):
    common = ("--kinds", "one-hot, one-hot", "--read-noise", "0.01", "--out")
    bright, dim = design(capsys, *common, "bright"), design(capsys, *common, "dim", "--light", "0.02")
    assert [row["codes"] for row in dim["surveyed"]] == ["static", "one-hot", "burst"]
    assert dim["light"] == pytest.approx(0.02)
    assert dim["examples_light"] == bright["examples_light"] == bright["light"]
    assert "dimmed to a mean irradiance of 0.02" in Path("dim/design.html").read_text()
    # the error of a dimmed scene falls by the square of its light and less, for noise stays
    fall = dim["static"]["expected_psnr"] - bright["static"]["expected_psnr"]
    assert fall < -20 * np.log10(dim["light"] / bright["light"]) - 1
    assert "--light: found 0.9" in refused(capsys, *SMALL, "--light", "0.9", "--out", "d")


@pytest.mark.parametrize("name", ["quantum_efficiency", "QE", "pixel_size", "gain"])
def test_what_counts_no_electrons_does_not_enter(capsys, name):
    Path("s.yaml").write_text(f"full_well: 10000\n{name}: 0.62\n")
    said = refused(capsys, *SMALL, "--sensor", "s.yaml", "--out", "d")
    assert f"s.yaml: {name}: found an unknown name" in said
    assert "count electrons, so that quantum efficiency, pixel size and gain do not enter" in said


@pytest.mark.parametrize("text", ["full_wel: 3", "full_well: many", "- 3"])
def test_a_sheet_that_cannot_be_read_is_one_line(capsys, text):
    Path("s.yaml").write_text(text)
    assert "s.yaml" in refused(capsys, *SMALL, "--sensor", "s.yaml", "--out", "d")


@pytest.fixture
def camera():
    return SpectralCamera(bands=4, size=(128, 128), slots=3, period=8, seed=5, sensor=Sensor(read_noise=0.01))


@pytest.fixture
def codes(tmp_path, camera):
    planes = [plane.tile() for plane in (camera.codes.aperture, camera.codes.shutter)]
    return write_codes(tmp_path / "codes.nc", *planes, (8, 8))


def judged(capsys, *arguments):
    return answer(capsys, "design", "judge", *arguments)


def test_a_file_of_codes_is_judged_as_the_camera_that_shows_them(capsys, camera, codes, tmp_path):
    found, own = judged(capsys, codes, "--bands", 4, "--figure", tmp_path / "codes.png"), measures(camera)
    assert found["throughput"] == pytest.approx(own.throughput)
    assert found["singular_values"] == pytest.approx(own.singular_values.tolist())
    assert sum(found["levels"].values()) == pytest.approx(1)
    torch.testing.assert_close(torch.tensor(found["correlation"]).double(), own.band_correlation.double())
    assert (tmp_path / "codes.png").exists()
    assert "above a thousandth" in said(capsys, "design", "judge", codes, "--bands", "4")


def test_a_snapshot_is_judged_under_its_own_noise_and_prior(capsys, camera, tmp_path):
    snapshot = Snapshot(torch.zeros(1, *camera.snapshot_shape), camera)
    file, prior = snapshot.save(tmp_path / "taken.nc"), tmp_path / "prior.nc"
    cube = torch.rand(4, 40, 50, generator=torch.Generator().manual_seed(0))
    known = GaussianPrior.learn([cube], (4, 20), wavelengths=camera.wavelengths)
    known.save(prior)
    found = judged(capsys, file, "--prior", prior)
    noise = camera.noise
    assert found["expected_psnr"] == pytest.approx(expected_psnr(known, camera.taps(), noise), abs=1e-3)
    noisier = judged(capsys, file, "--prior", prior, "--read-noise", "0.1")
    assert noisier["expected_psnr"] < found["expected_psnr"] - 0.2


def test_what_holds_no_aperture_codes_is_refused(capsys, codes, tmp_path):
    depth = SpectralDepthCamera.from_preset("quick", size=(32, 32), slots=1, shutter="open", channels="monochrome")
    taken = Snapshot(torch.zeros(1, *depth.snapshot_shape), depth).save(tmp_path / "depth.nc")
    assert "spectral-depth snapshot" in refusals.refused(capsys, "design", "judge", taken)
    assert "--prior" in refusals.refused(capsys, "design", "judge", codes, "--read-noise", "0.1")
    prior = tmp_path / "prior.nc"
    GaussianPrior.learn([torch.rand(3, 30, 40)], (4, 20)).save(prior)
    assert "3 bands" in refusals.refused(capsys, "design", "judge", codes, "--bands", "4", "--prior", prior)
