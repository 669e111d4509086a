"""``tmca import``, ``tmca real`` and ``tmca decoder`` from files to files, and what they refuse."""

import json

import numpy as np
import pytest
import torch
import xarray as xr
import yaml

from tests.cli.calls import answer, run, said
from tests.cli.refusals import refused
from tests.lab.real_captures.bench import DESCRIBED, SHUTTERED, captured, mask_of, smooth_scene, write_mat
from tmca.cameras import Snapshot
from tmca.lab.registering import MaskImage, registered
from tmca.priors import GaussianPrior


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Files of a bench whose mask is larger in its captures."""
    place = tmp_path_factory.mktemp("bench")
    (place / "bench.yaml").write_text(yaml.safe_dump(DESCRIBED))
    mask = mask_of(170, 150)
    light = captured(smooth_scene(4, 170, 150), registered(mask, MaskImage(scale=(1.01, 1), shift=(0.3, 0))))
    write_mat(place / "capture.mat", y=0.1 + 0.8 * light / light.max())
    write_mat(place / "mask.mat", mask=mask)
    slots = np.random.default_rng(0).integers(4, size=(12, 13))
    shutter = (slots[..., None] == np.arange(4)).astype(np.uint8)
    write_mat(place / "wine.mat", a=np.random.default_rng(0).normal(0.5, 1e-7, (12, 13)), s=shutter)
    described = {**SHUTTERED, "black": 0, "white": 1}
    (place / "wine.yaml").write_text(yaml.safe_dump(described))
    return place


@pytest.fixture
def bench(folder):
    return ("--prototype", folder / "bench.yaml", "--mask", folder / "mask.mat")


def test_a_capture_is_imported_and_reconstructed(capsys, folder, bench):
    text = said(capsys, "import", folder / "capture.mat", *bench, "--out", "s.nc")
    assert "s.nc: a plain, 170×150 pixels, 4 bands, 1 slots" in text
    about = answer(capsys, "import", folder / "capture.mat", *bench, "--out", "t.nc")
    assert about["bands"] == 4
    assert "snapshot" in said(capsys, "inspect", "s.nc")
    assert "dagger" in said(capsys, "reconstruct", "s.nc", "-d", "dagger", "--no-figures", "--out", "e.nc")


@pytest.mark.filterwarnings("default::tmca.lab.quality.Doubtful")
def test_saturated_pixels_are_told_and_withheld_if_asked(capsys, folder, bench, tmp_path):
    described = {**DESCRIBED, "saturation": 0.8}
    (tmp_path / "bright.yaml").write_text(yaml.safe_dump(described))
    how = ("import", folder / "capture.mat", "--prototype", "bright.yaml", "--mask", folder / "mask.mat")
    kept = run(capsys, *how, "--out", "kept.nc").err
    gone = said(capsys, *how, "--out", "gone.nc", "--withhold-saturated")
    assert kept.count("of the pixels are saturated: withhold them (--withhold-saturated)") == 1
    assert "of the pixels are saturated, and withheld" in gone
    withheld = Snapshot.load("gone.nc")
    share = float((withheld.camera.codes()[1] == 0).float().mean())
    assert 0 < share < 0.5
    assert withheld.notes["saturated_share"] == pytest.approx(share)
    assert "dagger" in said(capsys, "reconstruct", "gone.nc", "-d", "dagger", "--no-figures", "--out", "e.nc")
    plain = refused(capsys, "import", folder / "capture.mat", *bench, "--withhold-saturated", "--out", "no.nc")
    assert "--withhold-saturated: found no saturation in the prototype" in plain
    assert not (tmp_path / "no.nc").exists()


def test_the_mask_is_put_in_register(capsys, folder, bench):
    how = ("--mask", folder / "mask.mat", "--prototype", folder / "bench.yaml")
    found = answer(capsys, "real", "register", folder / "capture.mat", *how)
    assert found["scale"][0] == pytest.approx(1.01, abs=1.5e-3)
    assert found["shift"][0] == pytest.approx(0.3, abs=0.08)
    assert "times as large along y" in said(capsys, "real", "register", folder / "capture.mat", *how)
    wine = ("--prototype", folder / "wine.yaml")
    assert "--name" in refused(capsys, "real", "register", folder / "wine.mat", *wine)
    assert "--shift" in refused(capsys, "real", "register", folder / "wine.mat", *wine, "--name", "one", "--shift", "1")
    found = said(capsys, "real", "register", folder / "wine.mat", *wine, "--name", "one", "--shift", "0,0", "--json")
    assert json.loads(found)["shutter_shift"] == [0, 0]
    assert "--mask" in refused(capsys, "real", "register", folder / "capture.mat", *how[2:])


def test_the_mask_is_put_in_register_by_evidence(capsys, folder, tmp_path):
    (tmp_path / "flat.yaml").write_text(yaml.safe_dump({**DESCRIBED, "response": "flat"}))
    prior = GaussianPrior.learn([torch.from_numpy(smooth_scene(4, 120, 130, seed=seed)) for seed in (2, 3)], (6, 20))
    prior.save("prior.nc")
    how = (
        "real",
        "register",
        folder / "capture.mat",
        "--prototype",
        "flat.yaml",
        "--mask",
        folder / "mask.mat",
        "--by",
        "evidence",
    )
    (found,) = answer(capsys, *how, "--prior", "prior.nc")
    assert found["converged"]
    assert found["scale"] == pytest.approx((1.01, 1), abs=1e-3)
    assert found["shift"] == pytest.approx((0.3, 0), abs=0.05)
    assert found["dispersion"] == pytest.approx(1, abs=5e-3)
    assert "--prior: found nowhere.nc, expected none without" in refused(capsys, *how[:-2], "--prior", "nowhere.nc")
    assert "--by: found 'hand', expected one of blocks, evidence" in refused(capsys, *how[:-1], "hand")
    wine = ("real", "register", folder / "wine.mat", "--prototype", folder / "wine.yaml", "--by", "evidence")
    assert "--by: found evidence for a pixel shutter" in refused(capsys, *wine)


def test_the_report_names_what_it_lacks(capsys, bench, tmp_path):
    how = ("--data", tmp_path, "--out", "real")
    assert "no tsa/mask_660_real.mat" in refused(capsys, "real", "report", *how)
    (tmp_path / "tsa").mkdir()
    (tmp_path / "tsa" / "mask_660_real.mat").write_text("")
    assert "--decoders: found none, expected some of" in refused(capsys, "real", "report", *how, "--decoders", "")
    assert [entry.name for entry in tmp_path.iterdir()] == ["tsa"]


@pytest.mark.slow
def test_a_decoder_for_the_camera_of_a_snapshot(capsys, folder, bench, tmp_path):
    said(capsys, "import", folder / "capture.mat", *bench, "--out", "s.nc")
    network = "decoder={kind: unrolled, start: dagger, stages: 1, widths: [8, 8], blocks: 1}"
    small = ("--set", "data.patch=16", "--set", "data.batch=2", "--steps", "2", "--set", network)
    scenes = ("--train", "chelsea", "--validation", "coffee")
    said(capsys, "train", "spectral", "--snapshot", "s.nc", "--out", "run", *scenes, *small)
    assert "network" in said(capsys, "reconstruct", "s.nc", "--weights", "run", "--no-figures", "--out", "e.nc")
    text = said(capsys, "decoder", "export", "run", "--out", "exported", "--formats", "torch")
    assert "decoder.pt2: torch, differs" in text
    assert answer(capsys, "decoder", "check", "exported", "--run", "run")[0]["error"] < 1e-4
    said(capsys, "decoder", "run", "exported", "s.nc", "--out", "x.nc")
    with xr.open_dataset("e.nc") as one, xr.open_dataset("x.nc") as other:
        np.testing.assert_allclose(one["estimate"], other["estimate"], atol=2e-3)
    mirrored = write_mat(tmp_path / "mirrored.mat", mask=mask_of(170, 150)[:, ::-1])
    other = ("--prototype", folder / "bench.yaml", "--mask", mirrored)
    said(capsys, "import", folder / "capture.mat", *other, "--out", "other.nc")
    run = ("decoder", "run", "exported", "other.nc", "--out", "other_cube.nc")
    assert "other.nc: found the codes" in refused(capsys, *run)
    assert not (tmp_path / "other_cube.nc").exists()
    assert "some of torch, onnx" in refused(capsys, "decoder", "export", "run", "--out", "y", "--formats", "gif")
    assert "no decoder.json" in refused(capsys, "decoder", "check", "nowhere", "--run", "run")


@pytest.fixture
def wine(capsys, folder):
    said(capsys, "import", folder / "wine.mat", "--prototype", folder / "wine.yaml", "--name", "one", "--out", "w.nc")
    return ("real", "movie", "w.nc", "--out", "m.nc", "--frames")


@pytest.mark.parametrize("decoder", ["kriging", "space-time-dct"])
def test_frames_behind_a_pixel_shutter(capsys, wine, decoder):
    assert "4 frames of 1 slots" in said(capsys, *wine, "4", "--decoder", decoder)
    text = said(capsys, *wine, "2", "--decoder", decoder, "--figure", "m.png", "--overwrite")
    assert "2 frames of 2 slots each" in text
    with xr.open_dataset("m.nc") as frames:
        np.testing.assert_allclose(frames["frames"], 0.5, atol=1e-4)
        assert frames.attrs["decoder"] == decoder


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("3", "a divisor or a multiple of the 4 slots"), ("2 --decoder dream", "--decoder: found 'dream'"),
        ("2 --decoder kriging --threshold=0.1", "--threshold: found 0.1 for kriging"),
        ("2 --decoder kriging --lifetime=inf", "found inf, expected above 0"),
        ("2 --decoder kriging --changing=1.5", "expected 0 to 1"),
        ("2 --decoder space-time-dct --threshold=nan", "above 0"),
        ("2 --decoder space-time-dct --iterations=1", "2 or more"),
        ("2 --decoder space-time-dct --lifetime=nan", "--lifetime: found nan for space-time-dct"),
    ],
)  # fmt: skip
def test_impossible_movies_are_refused(capsys, wine, tmp_path, options, words):
    assert words in refused(capsys, *wine, *options.split())
    assert not (tmp_path / "m.nc").exists()


@pytest.mark.parametrize(
    ("command", "words"),
    [
        *((f"real register FOLDER/wine.mat --prototype FOLDER/wine.yaml --name one --shift={shift}", "shift: found")
          for shift in ("-300,400", "12,0", "-3.4,nan", "1.5,2", "inf,0")),
        ("real register FOLDER/capture.mat --prototype FOLDER/bench.yaml --mask small.mat", "expected 60×56 pixels"),
        ("real register nan.mat --prototype FOLDER/wine.yaml --name one --shift=0,0", "expected a finite picture"),
        ("import FOLDER/capture.mat --prototype lens --out s.nc", "tsa, or a YAML file"),
        ("import FOLDER/capture.mat --prototype FOLDER/bench.yaml --out s.nc", "--mask: found none"),
    ],
)  # fmt: skip
def test_what_cannot_be_registered_or_imported_is_refused(capsys, folder, tmp_path, command, words):
    write_mat(tmp_path / "small.mat", mask=mask_of(60, 50))
    write_mat(tmp_path / "nan.mat", a=np.full((12, 13), np.nan), s=np.ones((12, 13, 4), np.uint8))
    assert words in refused(capsys, *command.replace("FOLDER", str(folder)).split())
    assert not (tmp_path / "s.nc").exists()
