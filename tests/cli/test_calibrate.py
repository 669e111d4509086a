"""``tmca calibrate`` from captures to a reconstruction with the camera as it was measured, and what it refuses."""

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from studies.calibration_proof import Proof, table_of
from tests.cli.calls import answer, run, said
from tests.cli.refusals import refused
from tmca.cli import main
from tmca.cli.lab.calibrate_steps import residual_lines
from tmca.lab.calibration.file import load_calibration

SHOWN = ("--patterns", "bench/patterns")
AGAINST = ("--truth", "bench/scene.nc", "--no-figures", "--json")
ON = ("--onto", "rendered", "--no-figures")


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    """A bench's captures, and the calibration of all its steps."""
    folder = tmp_path_factory.mktemp("bench")
    main(["calibrate", "render", str(folder / "bench"), "--size", "40x45", "--slots", "2", "--seed", "3"])
    return folder


@pytest.fixture
def bench(rendered, tmp_path):
    """The files of a bench in a folder of the test's own."""
    shutil.copytree(rendered, tmp_path, dirs_exist_ok=True)
    return tmp_path / "bench"


def step(capsys, name, *more):
    return answer(capsys, "calibrate", name, *more)


@pytest.mark.slow
def test_from_captures_to_a_reconstruction(capsys, bench):
    truth = json.loads((bench / "truth.json").read_text())
    step(capsys, "dark", "bench/dark", "--out", "rendered", "--no-figures")
    flat = step(capsys, "flat", "bench/flat", "--white", "bench/white", *ON)
    assert flat["white_level_dn"] == pytest.approx(truth["white_level"], rel=2e-3)
    sensor = step(capsys, "linearity", "bench/linearity", *ON)
    assert sensor["electrons_per_dn"] == pytest.approx(truth["gain"], rel=0.05)
    found = step(capsys, "registration", "bench/registration", *SHOWN, "--wavelength", "550", "--device", "40x45", *ON)
    assert found["corner_std_pixels"] < 0.02
    assert found["mirrored"] == 0
    assert 1 / found["contrast_ratio"] == pytest.approx(1 / truth["contrast_ratio"], abs=1e-3)
    power = ("--power", "bench/source.csv")
    assert step(capsys, "dispersion", "bench/dispersion", *SHOWN, *power, *ON)["x_residual_pixels"] < 0.05
    timing = step(capsys, "timing", "bench/timing", "--onto", "rendered")
    assert timing["delay_slots"] == pytest.approx(truth["delay"], abs=0.002)
    assert timing["leakage"] == pytest.approx(truth["leakage"], abs=1.5e-3)
    measured = load_calibration("rendered")
    assert measured.part("registration").offset(truth["matrix"]) < 0.05
    assert np.abs(measured.part("dispersion").at(truth["wavelengths"]) - truth["shifts"]).max() < 0.1
    picture = Image.open(timing["calibration"].replace(".nc", ".png"))
    assert picture.width > 600
    assert len(list(bench.parent.glob("rendered_*.nc"))) == 6
    assert "registration (measured" in said(capsys, "calibrate", "show", "rendered")
    steps = answer(capsys, "calibrate", "show", "rendered")["steps"]
    assert list(steps) == ["dark", "flat", "linearity", "registration", "dispersion", "timing"]
    how = ("reconstruct", "bench/snapshot.nc", "-d", "admm-tv", *AGAINST)
    whole = json.loads(said(capsys, *how, "--calibration", "rendered", "--out", "whole.nc"))
    nominal = json.loads(said(capsys, *how, "--calibration", sensor["calibration"], "--out", "nominal.nc"))
    assert whole["metrics"]["psnr"] > nominal["metrics"]["psnr"] + 2
    refusal = refused(capsys, "reconstruct", "bench/snapshot.nc", "--out", "without.nc")
    assert "found a snapshot in digital numbers" in refusal
    assert "--calibration" in refusal


def test_the_guide_names_every_step(capsys):
    text = said(capsys, "calibrate")
    steps = "patterns dark flat linearity registration timing dispersion shear psf show render"
    assert all(f"tmca calibrate {name}" in text for name in steps.split())
    assert "--calibration NAME" in text


def test_patterns_are_pictures_to_show(capsys, tmp_path):
    assert "pattern_3.png" in said(capsys, "calibrate", "patterns", "shown", "--device", "33x50")
    shown = np.stack([np.array(Image.open(f"shown/pattern_{i}.png")) for i in range(4)])
    assert shown.shape == (4, 33, 50)
    assert (shown[0] == 255).all()
    assert not shown[1].any()
    assert 0.4 < (shown[2:] == 255).mean() < 0.6
    assert "an existing output" in refused(capsys, "calibrate", "patterns", "shown")


def test_what_is_not_finite_is_not_known_whether_it_was_measured_now_or_read_from_a_file():
    assert all(line.endswith("not known") for line in residual_lines({"a": math.inf, "b": math.nan, "c": None}))


@pytest.mark.filterwarnings("default::tmca.lab.quality.Doubtful")
def test_what_a_step_puts_in_doubt_is_said(capsys, bench):
    dark = ("calibrate", "dark", "bench/dark", "--out", "rendered", "--no-figures")
    assert run(capsys, *dark).err == ""
    doubted = run(capsys, "calibrate", "dark", "bench/dispersion", "--out", "x", "--no-figures").err
    assert "noise of saturation" in doubted
    assert doubted.count("\n") == 1


def test_a_calibration_says_what_it_holds_and_is_read_from_its_newest_file(capsys, bench):
    dark = step(capsys, "dark", "bench/dark", "--out", "rendered", "--no-figures")
    flat = step(capsys, "flat", "bench/flat", "--white", "bench/white", *ON)
    about = answer(capsys, "calibrate", "show", "rendered")
    assert about["calibration"] == flat["calibration"] != dark["calibration"]
    assert list(about["steps"]) == ["dark", "flat"]
    assert about["steps"]["dark"]["residuals"]["read_noise_dn"] == dark["read_noise_dn"]
    text = said(capsys, "calibrate", "show", flat["calibration"])
    assert text.startswith(f"{flat['calibration']}: camera rendered, sensor ")
    assert f"  white level dn                   {flat['white_level_dn']:.5g}" in text
    assert "dark (measured " in text
    assert "bench/dark" in text


def test_a_proof_is_written_as_it_is_said(capsys, monkeypatch):
    found = Proof(2, 30.0)
    found.found = {"registration": [0.01, 0.07]}
    found.rows = [{"camera": "spectral", "seed": 0, "operator": "true", "psnr": 20.0, "explained": 30.0}]
    asked = []
    monkeypatch.setattr("studies.calibration_proof.prove", lambda *how: asked.append(how) or found)
    command = ("calibrate", "proof", "--seeds", "2", "--size", "40x45", "--snr", "30", "--out", "proof.json")
    assert answer(capsys, *command) == json.loads(Path("proof.json").read_text())
    assert asked == [(2, (40, 45), 30.0)]
    assert json.loads(Path("proof.json").read_text())["errors"][0]["error"] == 0.07
    assert "an existing output" in refused(capsys, *command)
    assert len(asked) == 1
    assert said(capsys, *command, "--overwrite").strip() == table_of(found.stated()).strip()


def test_calibrations_of_other_cameras_are_refused(capsys, bench):
    step(capsys, "dark", "bench/dark", "--out", "other", "--no-figures")
    how = ("reconstruct", "bench/snapshot.nc", "--calibration")
    assert "found a calibration of camera other, expected one of rendered" in refused(capsys, *how, "other")
    assert "camera other, expected one of mine" in refused(
        capsys, "calibrate", "flat", "bench/flat", "--onto", "other", "--camera", "mine"
    )
    assert "no such calibration" in refused(capsys, *how, "nothing")


@pytest.mark.slow
def test_views_and_points_are_measured_too(capsys, tmp_path):
    for camera, size in (("light-field", "32x36"), ("spectral-depth", "40x41")):
        said(capsys, "calibrate", "render", camera, "--camera", camera, "--size", size, "--slots", "2")
        step(capsys, "dark", f"{camera}/dark", "--out", camera, "--no-figures")
    on = ("--onto", "light-field", "--no-figures")
    shown = ("--patterns", "light-field/patterns")
    step(capsys, "registration", "light-field/registration", *shown, *on)
    truth = json.loads((tmp_path / "light-field" / "truth.json").read_text())
    shear = step(capsys, "shear", "light-field/shear", *shown, *on)
    assert [shear["y_pixels_per_view"], shear["x_pixels_per_view"]] == pytest.approx(truth["step"], abs=0.02)
    how = ("--snapshot", "spectral-depth/snapshot.nc", "--onto", "spectral-depth")
    found = step(capsys, "psf", "spectral-depth/psf1", "--slot", "1", *how)
    assert found["rms_waves"] == pytest.approx(40e-9 * 2 / 550e-9, abs=0.02)
    assert Image.open(found["calibration"].replace(".nc", ".png")).width > 600
    assert "slots 0 to 1 of a spectral-depth camera" in refused(
        capsys, "calibrate", "psf", "spectral-depth/psf1", "--slot", "2", *how
    )
    assert "found a light-field camera, expected a spectral-depth one" in refused(
        capsys, "calibrate", "psf", "spectral-depth/psf1", "--snapshot", "light-field/snapshot.nc", *how[2:]
    )
    (tmp_path / "spectral-depth" / "psf0" / "point_0.6m_550nm.png").unlink()
    assert "no capture at 0.6 m and 550 nm" in refused(capsys, "calibrate", "psf", "spectral-depth/psf0", *how)


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """A snapshot of a spectral camera, and its codes for a DMD and a coded shutter."""
    folder = tmp_path_factory.mktemp("shown")
    camera = ["--slots", "3", "--shutter", "one-hot", "--read-noise", "0.001", "--no-figures"]
    main(["simulate", "spectral", "coffee", "--crop", "32x37", *camera, "--out", str(folder / "sim.nc")])
    devices = ["--device", "dli4120", "--device", "coded-exposure", "--macro-pixel", "4", "--mounting-angle", "45"]
    main(["export", str(folder / "sim.nc"), *devices, "--out", str(folder / "shown")])
    return folder


@pytest.fixture
def exported(shown, tmp_path):
    shutil.copytree(shown, tmp_path, dirs_exist_ok=True)


@pytest.fixture(scope="module")
def captured(shown, tmp_path_factory):
    """What is shown, and frames of its mask."""
    folder = shutil.copytree(shown, tmp_path_factory.mktemp("captured"), dirs_exist_ok=True)
    main(["calibrate", "capture", "registration", str(folder / "shown"), "--out", str(folder / "bench")])
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(("camera", "scene"), [("spectral", "coffee"), ("light-field", "coffee:1")])
def test_two_buckets_with_faults_reconstruct_as_a_bench_without(capsys, camera, scene):
    """By at most 0.5 dB worse, of a reconstruction that loses more where nobody measured them."""
    how = [
        "--slots",
        "4",
        "--shutter",
        "balanced",
        "--buckets",
        "2",
        "--period",
        "16",
        "--read-noise",
        "0.001",
        "--no-figures",
    ]
    main(["simulate", camera, scene, "--crop", "64x80", *how, "--out", "sim.nc"])
    devices = ["--device", "dli4120", "--device", "coded-exposure-two-bucket", "--macro-pixel", "4"]
    main(["export", "sim.nc", *devices, "--no-figures", "--out", "shown"])
    faults = ["--hardware", "bucket_gain=0.05,bucket_offset=0.01,leakage=0.03,transfer=0.05"]
    words = said(capsys, "calibrate", "capture", "all", "shown", *faults, "--out", "bench")
    curve = "--curve measured " if camera == "spectral" else ""
    assert words.endswith(f"measure them with tmca calibrate all bench {curve}--out NAME\n")
    main(["calibrate", "all", "bench", "--curve", "measured", "--no-figures", "--out", "mine"])
    main(["capture", "shown", "--scene", scene, "--out", "perfect"])
    main(["capture", "shown", "--scene", scene, *faults, "--out", "faulty"])
    known = {"perfect": [], "faulty": [], "measured": ["--calibration", "mine"]}
    scores = {
        name: answer(
            capsys, "reconstruct", "perfect.nc" if name == "perfect" else "faulty.nc", *calibration, "--truth", scene,
            "--no-figures", "--out", f"{name}_scene.nc",
        )["metrics"]["psnr"]
        for name, calibration in known.items()
    }  # fmt: skip
    assert scores["measured"] > scores["perfect"] - 0.5, scores
    assert scores["faulty"] < scores["perfect"] - 0.5, scores


@pytest.mark.parametrize(
    ("harm", "expected"),
    [
        (lambda kept: kept[1].write_bytes(kept[0].read_bytes()), "another content"),
        (lambda kept: kept[1].unlink(), "no such file"),
        (lambda kept: kept[1].write_bytes(kept[1].read_bytes()[:-2] + b"ab"), "another content"),
    ],
)
def test_frames_of_a_bench_are_measured_as_they_were_taken(capsys, captured, tmp_path, harm, expected):
    shutil.copytree(captured / "bench", tmp_path / "bench")
    harm(sorted(Path("bench/registration").glob("*.tif")))
    command = ("calibrate", "registration", "bench/registration", "--patterns", "bench/patterns", "--out", "new")
    assert expected in refused(capsys, *command)
    assert not list(Path().glob("new*"))


@pytest.mark.parametrize(
    ("gone", "arguments", "expected"),
    [
        ("registration/pattern_2.png", ("registration", "bench/registration", *SHOWN), "found 3 frames, expected 4"),
        (None, ("registration", "bench/registration", *SHOWN, "--device", "64x80"), "40×45 pixels, expected 64×80"),
        (None, ("registration", "bench/registration", *SHOWN, "--saturation", "20000"), "saturated in pattern_0"),
        (None, ("dispersion", "bench/dispersion", *SHOWN), "no registration, expected one"),
        (None, ("dark", "bench/dark/dark_00.png"), "two or more"),
        (None, ("flat", "bench/dark"), "ten times its noise"),
        ("linearity/even_5ms_1.png", ("linearity", "bench/linearity"), "at every exposure"),
        (None, ("buckets", "bench/timing"), "no flat, expected one, on which buckets builds"),
        ("timing/aperture_1_shutter_1.png", ("timing", "bench/timing"), "no aperture_1_shutter_1"),
    ],
)
def test_bad_captures_are_refused_in_one_line_and_nothing_is_written(capsys, bench, gone, arguments, expected):
    step(capsys, "dark", "bench/dark", "--out", "rendered", "--no-figures")
    if gone:
        (bench / gone).unlink()
    assert expected in refused(capsys, "calibrate", *arguments, *ON)
    assert len(list(bench.parent.glob("*.nc"))) == 1


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("timing", "--device", "laser"), "simulated"),
        (("registration", "--wavelength", "green"), "numbers separated by commas"),
        (("psf",), "dark, flat, white, linearity, registration, timing, dispersion"),
        (("dispersion", "--wavelength", "501"), "a band of the camera"),
        (("dark", "--frames", "1"), "2 or more"), (("dark", "--set", "port=3"), "options of its own"),
        (("dark", "--device", "folder", "--set", "path=shown"), "--device: found FrameFolder"),
    ],
)  # fmt: skip
@pytest.mark.usefixtures("exported")
def test_bad_frames_of_a_bench_are_refused(capsys, arguments, expected):
    kind, *more = arguments
    assert expected in refused(capsys, "calibrate", "capture", kind, "shown", "--out", "bench", *more, lines=None)
