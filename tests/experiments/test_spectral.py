"""The main job end to end: scene → snapshot → reconstruction → files, pictures and tables."""

import json

import numpy as np
import pytest
import scipy.io
import torch
import xarray as xr

from tmca.applications import application_of, evaluate, simulate
from tmca.applications.demo import run_demo
from tmca.cameras import Snapshot, SpectralCamera
from tmca.data import read_dataset, rendered_scene, select_bands, write_dataset, write_split
from tmca.data.scenes import load_scene
from tmca.errors import DataError, OutputError, SettingError
from tmca.experiments.cells import CellsFailed
from tmca.experiments.corner import corner_conditioning
from tmca.experiments.spectral.comparison import compare_spectral
from tmca.experiments.spectral.imaging import reconstruct_snapshot
from tmca.experiments.spectral.rows import CODES, LEARNED, NOISES
from tmca.operators import conditioning, sparse_matrix
from tmca.priors import GaussianMixturePrior, learn_prior
from tmca.sensor import Sensor

BANDS = 4


@pytest.fixture(scope="module")
def scene():
    return select_bands(rendered_scene("coffee", size=(48, 64))["radiance"], BANDS)


@pytest.fixture(scope="module")
def examples():
    return [select_bands(rendered_scene(n, size=(96, 96))["radiance"], BANDS) for n in ("astronaut", "chelsea")]


def small_mixture(examples):
    cubes = [torch.from_numpy(e.values) for e in examples]
    return GaussianMixturePrior.learn(cubes, (6, 18), kinds=4, rank=40, gains=3, samples=4000)


def camera_for(scene, **settings):
    return SpectralCamera(bands=scene["wavelength"].values.tolist(), size=scene.shape[1:], **settings)


@pytest.mark.parametrize("mixture", [False, True])
def test_a_prior_beats_the_least_norm_estimate_and_knows_its_error(scene, examples, mixture):
    snapshot = simulate(scene, camera_for(scene, slots=4, sensor=Sensor(read_noise=0.01)))
    prior = small_mixture(examples) if mixture else learn_prior(examples, spread=BANDS - 1)
    method = "mixture" if mixture else "lmmse"
    found = reconstruct_snapshot(snapshot, method, prior=prior, truth=scene, uncertainty=True)
    plain = reconstruct_snapshot(snapshot, "dagger", truth=scene)
    assert found.metrics["psnr"] > plain.metrics["psnr"] + 8
    assert found.cube.values.min() >= 0
    rms_predicted = float(np.sqrt((found.deviation.values**2).mean()))
    rms_measured = float(np.sqrt(((found.cube.values - scene.values) ** 2).mean()))
    assert 0.3 < rms_measured / rms_predicted < 3


@pytest.mark.parametrize("method", ["admm-tv", "admm-tv-joint", "pnp-tv"])
def test_total_variation_beats_the_least_norm_estimate(scene, method):
    snapshot = simulate(scene, camera_for(scene, slots=4))
    found = reconstruct_snapshot(snapshot, method, truth=scene)
    plain = reconstruct_snapshot(snapshot, "dagger", truth=scene)
    assert found.metrics["psnr"] > plain.metrics["psnr"] + 5


def test_relay_blur_is_undone_by_admm_and_refused_by_lmmse(scene, examples):
    snapshot = simulate(scene, camera_for(scene, slots=2, relay_blur=0.5))
    assert reconstruct_snapshot(snapshot, "admm-tv-joint", truth=scene).metrics["psnr"] > 20
    prior = learn_prior(examples, spread=BANDS - 1)
    with pytest.raises(SettingError, match="relay_blur"):
        reconstruct_snapshot(snapshot, "lmmse", prior=prior)


def test_a_prior_of_another_camera_is_refused(scene, examples):
    snapshot = simulate(scene, camera_for(scene))
    other = learn_prior([e[:3] for e in examples], spread=2)
    with pytest.raises(ValueError, match="3"):
        reconstruct_snapshot(snapshot, "lmmse", prior=other)
    with pytest.raises(SettingError, match="mixture"):
        reconstruct_snapshot(snapshot, "mixture", prior=learn_prior(examples, spread=3))


def test_files_carry_estimate_deviation_and_metrics(scene, examples, tmp_path):
    snapshot = simulate(scene, camera_for(scene))
    prior = learn_prior(examples, spread=3)
    found = reconstruct_snapshot(snapshot, "lmmse", prior=prior, truth=scene, uncertainty=True)
    path = found.save(tmp_path / "e.nc")
    with xr.open_dataset(path) as data:
        np.testing.assert_array_equal(data["estimate"], found.cube)
        assert data["deviation"].shape == scene.shape
        assert data.attrs["metric_psnr"] == pytest.approx(found.metrics["psnr"])
        assert data["wavelength"].attrs["units"] == "m"
    write = scene.to_dataset(name="radiance")
    write.to_netcdf(tmp_path / "t.nc", engine="h5netcdf")
    assert evaluate(path, str(tmp_path / "t.nc"))["psnr"] == pytest.approx(found.metrics["psnr"], abs=1e-3)


def test_an_estimate_above_one_is_not_rescaled_when_read_back(scene, tmp_path):
    bright = scene * 1.5 / scene.max()
    snapshot = simulate(bright, camera_for(scene))
    path = reconstruct_snapshot(snapshot, "dagger").save(tmp_path / "e.nc")
    assert evaluate(path, str(path))["dd"] == 0


def test_noise_is_independent_of_the_codes(scene):
    camera = camera_for(scene, slots=1, shutter="open", dispersion=0.0, sensor=Sensor(read_noise=1.0))
    noise = simulate(scene * 0, camera).values[0, 0]
    mask = camera.codes()[0][0] > 0
    assert abs(float(noise[mask].var() / noise[~mask].var()) - 1) < 0.15


@pytest.mark.parametrize("disperser", ["single", "dual"])
@pytest.mark.parametrize("dispersion", [1.0, 0.5, -0.7])
def test_the_corner_is_the_cameras_own_matrix(disperser, dispersion):
    settings = {"bands": BANDS, "slots": 3, "dispersion": dispersion, "disperser": disperser}
    camera = SpectralCamera(size=(2, 12), **settings)
    found = corner_conditioning(camera, rows=2, columns=12)
    truth = conditioning(sparse_matrix(camera.operator()))
    assert (found["rank"], found["shape"]) == (truth.rank, truth.shape)
    assert found["condition"] == pytest.approx(truth.condition, rel=1e-4)


def test_truth_is_brought_to_the_snapshots_bands_and_size(scene):
    cube = load_scene("coffee", bands=BANDS, size=(48, 64))
    snapshot = simulate(cube, camera_for(cube))
    np.testing.assert_array_equal(application_of("spectral").truth("coffee", snapshot.camera, {}), cube)
    large = Snapshot(snapshot.values, SpectralCamera(bands=cube["wavelength"].values.tolist(), size=(48, 9000)))
    with pytest.raises(DataError, match="9000"):
        application_of("spectral").truth("coffee", large.camera, {})


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


@pytest.mark.slow
def test_the_comparison_is_whole_resumes_and_keeps_earlier_results(splits, tmp_path):
    where = {"out": tmp_path / "results", "work": tmp_path / "work"}
    told = []
    options = {"bands": BANDS, "decoders": ["lmmse", "admm-tv"], "patches": 64}
    found = compare_spectral(*splits, **where, **options, progress=lambda *step: told.append(step))
    cells = 2 * len(CODES) * len(NOISES) + len(CODES) * len(NOISES)
    assert [step[0] for step in told] == list(range(1, cells + 1))
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
        compare_spectral(*splits, **where, **options)
    told.clear()
    again = compare_spectral(*splits, **where, **options, overwrite=True, progress=lambda *step: told.append(step))
    assert told == []
    assert again["rows"] == found["rows"]
    with pytest.raises(SettingError, match="lmsse"):
        compare_spectral(*splits, **where, bands=BANDS, decoders=["lmsse"], overwrite=True)


@pytest.mark.slow
def test_the_comparison_trains_networks_without_validation_scenes(splits, tmp_path):
    where = {"out": tmp_path / "results", "work": tmp_path / "work"}
    options = {"bands": BANDS, "decoders": ["unet-thesis"], "patches": 64, "steps": 1}
    with pytest.raises(CellsFailed, match=r"training.*do not fit|training"):
        compare_spectral(*splits, **where, **options)
    larger = [select_bands(rendered_scene(n, size=(72, 80))["radiance"], BANDS) for n in ("rocket", "tissue", "coffee")]
    for name, cube in zip("abc", larger, strict=True):
        write_dataset(cube, tmp_path / f"{name}.nc")
    write_split([tmp_path / "a.nc", tmp_path / "b.nc"], tmp_path / "train.txt", overwrite=True)
    write_split([tmp_path / "c.nc"], tmp_path / "test.txt", overwrite=True)
    found = compare_spectral(*splits, **where, **options)
    assert len(found["rows"]) == (len(CODES) + len(LEARNED)) * len(NOISES)
    assert all(row["trained"] and row["training_cpu_minutes"] > 0 for row in found["rows"])
    page = (tmp_path / "results" / "spectral.md").read_text()
    assert "not told the codes" in page
    gains = page.split("What learning codes gains")[1].split("\n## ")[0]
    psnr = {row["code"]: row["psnr"] for row in found["rows"] if row["noise"] == "σ = 0.01"}
    for code, base in (("CASSI learned", "CASSI random"), ("TMCA learned K = 8", "CASSI learned")):
        line = next(line for line in gains.splitlines() if line.startswith(f"| {code} | {base} |") and "σ" in line)
        assert f"| {psnr[code] - psnr[base]:+.2f} |" in line


@pytest.mark.slow
def test_the_demo_leaves_a_report_with_pictures(tmp_path, monkeypatch):
    monkeypatch.setenv("TMCA_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("tmca.priors.prior._VIEWS_SIZE", (40, 48))
    found = run_demo(tmp_path / "demo", size=(40, 48))
    assert len(found["rows"]) == 10
    assert [row["throughput"] for row in found["light_field"]] == pytest.approx([0.5, 1 / 16], rel=0.2)
    assert all(row["psnr"] > 10 and row["disparity_mae"] >= 0 for row in found["light_field"])
    assert [row["throughput"] for row in found["spectral_depth"]] == pytest.approx([1, 0.25])
    assert all(row["psnr"] > 10 and 0 <= row["depth_mae"] < 1.6 for row in found["spectral_depth"])
    page = (tmp_path / "demo" / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 11
    assert page.count("data:image/gif;base64,") == 1
    assert Snapshot.load(tmp_path / "demo" / "light_field_onehot8_snapshot.nc").camera.views == (5, 5)
    assert Snapshot.load(tmp_path / "demo" / "spectral_depth_onehot4_snapshot.nc").camera.slots == 4
    assert Snapshot.load(tmp_path / "demo" / "coffee_tmca8_snapshot.nc").camera.slots == 8
    assert "deviation" in read_dataset(tmp_path / "demo" / "coffee_tmca8_lmmse.nc")
    with pytest.raises(OutputError, match=r"report\.html"):
        run_demo(tmp_path / "demo", size=(40, 48))
