"""`tmca compare spectral`: rows of every code, noise and decoder, resumed, with networks and learned codes."""

import json

import numpy as np
import pytest
import scipy.io
import torch

from tmca.applications import evaluate, simulate
from tmca.cameras import SpectralCamera
from tmca.data import rendered_scene, select_bands, write_dataset, write_split
from tmca.data.scenes import load_scene
from tmca.decoders import decode
from tmca.errors import OutputError, SettingError
from tmca.evaluation.expected import predicted_and_measured
from tmca.evaluation.grid import CellsFailed
from tmca.evaluation.run import run_study
from tmca.evaluation.study import checked_study, read_study
from tmca.priors import GaussianPrior
from tmca.sensor import Sensor

BANDS, NARROW = 4, {"networks__unet-thesis__decoder__widths": [4, 8, 8]}
STUDY = read_study("spectral")
CODES, NOISES = [name for name, code in STUDY.codes.items() if code.learn is None], STUDY.noises


def asked(splits, **changes):
    scenes = {name: [str(split)] for name, split in zip(("train", "test"), splits, strict=True)}
    return STUDY.with_(scenes=scenes, reading={"bands": BANDS}, patches=64, **changes)


@pytest.fixture
def splits(tmp_path):
    rng = np.random.default_rng(0)
    for name in ("a", "b", "c"):
        smooth = np.cumsum(np.cumsum(rng.normal(size=(40, 44, 1)), 0), 1) * rng.random(31)
        smooth = (smooth - smooth.min()) / (smooth.max() - smooth.min())
        scipy.io.savemat(tmp_path / f"{name}.mat", {"cube": smooth})
    write_split([tmp_path / "a.mat", tmp_path / "b.mat"], tmp_path / "train.txt")
    write_split([tmp_path / "c.mat"], tmp_path / "test.txt")
    return tmp_path / "train.txt", tmp_path / "test.txt"


FEW = {
    "name": "few", "camera": "spectral", "reading": {"bands": 3}, "codes": {"two": {"camera": {"slots": 2}}},
    "noises": {"some": {"read_noise": 0.02}}, "decoders": ["lmmse"], "patches": 64,
    "shown": None, "shown_noise": "some",
}  # fmt: skip


def test_rows_pictures_and_expected_errors_are_of_the_prior_that_was_learned(tmp_path):
    for name in ("rocket", "chelsea"):
        write_dataset(select_bands(rendered_scene(name, size=(30, 34))["radiance"], 3), tmp_path / f"{name}.nc")
    scenes = {"train": [str(tmp_path / "rocket.nc")], "test": [str(tmp_path / "chelsea.nc")]}
    found = run_study(checked_study({**FEW, "scenes": scenes}, "few"), tmp_path / "out", tmp_path / "work")
    learned, seen = (load_scene(scenes[name][0], bands=3) for name in ("train", "test"))
    camera = SpectralCamera(
        bands=seen["wavelength"].values.tolist(), size=(30, 34), slots=2, seed=0, sensor=Sensor(0.02)
    )
    (file,) = (tmp_path / "work").glob("prior-gaussian-*.nc")
    estimate = decode(simulate(seen, camera, seed=0), "lmmse", prior=file)
    (row,), (expected,) = found["rows"], found["expected_error"]
    assert row["psnr"] == pytest.approx(evaluate(estimate, seen)["psnr"], abs=1e-4)
    large = SpectralCamera(bands=camera.wavelengths, size=(256, 256), slots=2, seed=0, sensor=Sensor(0.02))
    for name, cube in (("train", learned), ("test", seen)):
        of = predicted_and_measured(GaussianPrior.load(file), large, [torch.from_numpy(cube.values)], count=64, seed=0)
        assert (expected["predicted"], expected[name]) == pytest.approx(of)
    assert (expected["code"], expected["noise"]) == ("two", "some")
    page = (tmp_path / "out" / "few.md").read_text()
    assert f"| two | some | {expected['predicted']:.2f} | {expected['train']:.2f} | {expected['test']:.2f} |" in page
    pictures = {f"few_chelsea_{kind}.png" for kind in ("composites", "spectra", "bands")}
    assert {file.name for file in (tmp_path / "out").glob("*.png")} == pictures
    assert all(f"({name})" in page for name in pictures)


@pytest.mark.slow
def test_the_comparison_is_whole_resumes_and_keeps_earlier_results(splits, tmp_path):
    where = {"out": tmp_path / "results", "work": tmp_path / "work"}
    told = []
    study = asked(splits, decoders=["lmmse", "admm-tv"])
    found = run_study(study, **where, progress=lambda *step: told.append(step))
    cells = 2 * len(CODES) * len(NOISES)
    assert [step[1] for step in told if step[1] == cells] == [cells] * cells
    assert len(found["rows"]) == 2 * len(CODES) * len(NOISES)
    on_disk = json.loads((tmp_path / "results" / "spectral.json").read_text())
    assert {"command", "commit", "split", "budget", "rows"} <= set(on_disk)
    assert {"method", "exposure", "noise", "psnr", "scenes"} <= set(on_disk["rows"][0])
    assert len(on_disk["expected_error"]) == len(CODES) * len(NOISES)
    assert "TMCA one-hot K = 4" in (tmp_path / "results" / "spectral.md").read_text()
    assert {f"spectral_c_{kind}.png" for kind in ("composites", "spectra", "bands")} <= {
        file.name for file in (tmp_path / "results").iterdir()
    }
    with pytest.raises(OutputError, match=r"spectral\.json"):
        run_study(study.with_(seeds=2), **where)
    told.clear()
    again = run_study(study, **where, progress=lambda *step: told.append(step))
    assert told == []
    assert again["rows"] == found["rows"]
    with pytest.raises(SettingError, match="lmsse"):
        run_study(asked(splits, decoders=["lmsse"]), **where, overwrite=True)


@pytest.mark.slow
def test_the_comparison_trains_networks_without_validation_scenes(splits, tmp_path):
    where = {"out": tmp_path / "results", "work": tmp_path / "work"}
    study = asked(splits, decoders=["unet-thesis"], train__steps=1, **NARROW)
    with pytest.raises(CellsFailed, match="training"):
        run_study(study, **where)
    larger = [select_bands(rendered_scene(n, size=(72, 80))["radiance"], BANDS) for n in ("rocket", "tissue", "coffee")]
    for name, cube in zip("abc", larger, strict=True):
        write_dataset(cube, tmp_path / f"{name}.nc")
    write_split([tmp_path / "a.nc", tmp_path / "b.nc"], tmp_path / "train.txt", overwrite=True)
    write_split([tmp_path / "c.nc"], tmp_path / "test.txt", overwrite=True)
    found = run_study(study, **where)
    assert len(found["rows"]) == len(study.codes) * len(NOISES)
    assert all(row["training_cpu_minutes"] > 0 for row in found["rows"])
    page = (tmp_path / "results" / "spectral.md").read_text()
    assert "not told the codes" in page
    gains = page.split("## Codes over others")[1].split("\n## ")[0]
    psnr = {row["code"]: row["psnr"] for row in found["rows"] if row["noise"] == "σ = 0.01"}
    for code, base in (("CASSI learned", "CASSI random"), ("TMCA learned K = 8", "CASSI learned")):
        line = next(line for line in gains.splitlines() if line.startswith(f"| {code} | {base} |") and "σ" in line)
        assert f"| {psnr[code] - psnr[base]:+.2f} |" in line
