"""The main job end to end: scene → snapshot → reconstruction → files, pictures and tables."""

import json
import re

import numpy as np
import pytest
import torch
import xarray as xr

from tests.cli.calls import answer
from tmca.applications import application_of, evaluate, simulate
from tmca.applications.demo import run_demo
from tmca.cameras import Snapshot, SpectralCamera
from tmca.cli import main
from tmca.data import read_dataset, rendered_scene, select_bands
from tmca.data.scenes import load_scene
from tmca.decoders import decode
from tmca.design.measures import corner_conditioning
from tmca.errors import DataError, OutputError, SettingError
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


@pytest.fixture(scope="module")
def prior(examples):
    return learn_prior(examples, extent=BANDS - 1)


def small_mixture(examples):
    cubes = [torch.from_numpy(e.values) for e in examples]
    return GaussianMixturePrior.learn(cubes, (6, 18), kinds=4, rank=40, gains=3, samples=4000)


def camera_for(scene, **settings):
    return SpectralCamera(bands=scene["wavelength"].values.tolist(), size=scene.shape[1:], **settings)


def psnr_of(estimate, scene):
    return evaluate(estimate, scene)["psnr"]


@pytest.mark.parametrize("mixture", [False, True])
def test_a_prior_beats_the_least_norm_estimate_and_knows_its_error(scene, examples, prior, mixture):
    snapshot = simulate(scene, camera_for(scene, slots=4, sensor=Sensor(read_noise=0.01)))
    prior = small_mixture(examples) if mixture else prior
    method = "mixture" if mixture else "lmmse"
    found = decode(snapshot, method, prior=prior, uncertainty=True)
    assert psnr_of(found, scene) > psnr_of(decode(snapshot, "dagger"), scene) + 8
    assert found.values.min() >= 0
    rms_predicted = float((found.deviation**2).mean().sqrt())
    rms_measured = float(((found.values[0] - torch.from_numpy(scene.values)) ** 2).mean().sqrt())
    assert 0.3 < rms_measured / rms_predicted < 3


def test_relay_blur_is_undone_by_admm_and_refused_by_lmmse(scene, prior):
    snapshot = simulate(scene, camera_for(scene, slots=2, relay_blur=0.5))
    assert psnr_of(decode(snapshot, "admm-tv-joint"), scene) > 20
    with pytest.raises(SettingError, match=r"relay.blur"):
        decode(snapshot, "lmmse", prior=prior)


def test_files_carry_estimate_deviation_and_metrics(scene, prior, tmp_path):
    snapshot = simulate(scene, camera_for(scene))
    found = decode(snapshot, "lmmse", prior=prior, uncertainty=True)
    path = found.save(tmp_path / "e.nc")
    with xr.open_dataset(path) as data:
        np.testing.assert_array_equal(data["estimate"], found.values[0])
        assert data["deviation"].shape == scene.shape
        assert data["wavelength"].attrs["units"] == "m"
    write = scene.to_dataset(name="radiance")
    write.to_netcdf(tmp_path / "t.nc", engine="h5netcdf")
    assert evaluate(path, str(tmp_path / "t.nc"))["psnr"] == pytest.approx(psnr_of(found, scene), abs=1e-3)


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


def test_the_demo_says_what_multiplexing_and_learning_changed():
    demo = application_of("spectral").demo
    levels = [20.0, 23.0, 22.0, 21.5, 25.0]  # static, two buckets, one-hot, learned static, learned K = 8
    said = " ".join(demo.text([{"psnr": level} for level in levels]))
    assert "the mean PSNR by +3.00 dB where each pixel has two buckets" in said
    assert "by +2.00 dB where it has one" in said
    assert "eight learned slots by +3.50 dB" in said


def test_learned_codes_of_the_demo_come_with_their_network():
    demo = application_of("spectral").demo
    trials = {trial.stem: trial for trial in demo.trials(demo.scene("coffee", (32, 40)))}
    assert [*trials] == [f"coffee_{stem}" for stem, _ in demo.codes.values()]
    for stem, slots in (("learned_static", 1), ("learned_tmca8", 8)):
        trial = trials[f"coffee_{stem}"]
        assert (trial.decoder, trial.settings["weights"].slots, trial.camera.slots) == ("network", slots, slots)
    for trial in trials.values():
        assert trial.camera.size == (32, 40)
        assert trial.camera.sensor.read_noise == demo.read_noise
    assert trials["coffee_static"].camera.throughput() == pytest.approx(0.5, abs=0.05)
    assert trials["coffee_onehot4"].camera.throughput() == pytest.approx(0.125, abs=0.02)


@pytest.mark.slow
def test_the_demo_leaves_a_report_with_pictures(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("tmca.priors.finding._VIEWS_SIZE", (40, 48))
    monkeypatch.setattr("tmca.priors.finding._SIZE", (96, 96))
    main(["demo", "--size", "40x48", "--jobs", "1", "--json", "--out", str(tmp_path / "demo")])
    found = json.loads(capsys.readouterr().out)
    assert len(found["rows"]) == 10
    assert [row["throughput"] for row in found["light_field"][:2]] == pytest.approx([0.5, 1 / 16], rel=0.2)
    for rows in (found["light_field"], found["spectral_depth"]):
        assert rows[-1]["psnr"] > rows[0]["psnr"], rows[-1]["code"]
    assert all(row["psnr"] > 10 and row["disparity_mae"] >= 0 for row in found["light_field"])
    assert [row["throughput"] for row in found["spectral_depth"]] == pytest.approx([1, 0.25, 0.25])
    assert all(row["psnr"] > 10 and 0 <= row["depth_mae"] < 1.6 for row in found["spectral_depth"])
    page = (tmp_path / "demo" / "report.html").read_text()
    assert len(re.findall("data:image/(?:png|webp|gif);base64,", page)) == 13
    estimate, row = tmp_path / "demo" / "coffee_static_lmmse.nc", found["rows"][5]
    assert (row["scene"], row["code"]) == ("coffee", "static (CASSI)")
    assert answer(capsys, "evaluate", estimate, tmp_path / "demo" / "coffee_scene.nc")["psnr"] == pytest.approx(
        row["psnr"]
    )
    assert Snapshot.load(tmp_path / "demo" / "light_field_onehot8_snapshot.nc").camera.views == (5, 5)
    assert Snapshot.load(tmp_path / "demo" / "spectral_depth_onehot4_snapshot.nc").camera.slots == 4
    assert Snapshot.load(tmp_path / "demo" / "coffee_buckets4_snapshot.nc").camera.buckets == 2
    assert "deviation" in read_dataset(tmp_path / "demo" / "coffee_buckets4_lmmse.nc")
    with pytest.raises(OutputError, match=r"report\.html"):
        run_demo(tmp_path / "demo", size=(40, 48))
