"""The light-field camera's main job, from the command line and from Python."""

import numpy as np
import pytest
import xarray as xr

from tests.cli.calls import answer
from tests.cli.refusals import refused
from tmca.applications import application_of, evaluate, simulate
from tmca.applications.evaluating import evaluation_of
from tmca.cameras import LightFieldCamera, Snapshot
from tmca.cli import main
from tmca.data.light_field_scenes import load_light_field
from tmca.data.scene_names import SceneWarning, compare_source
from tmca.decoders import Weights, decode
from tmca.metrics import estimate_disparity
from tmca.priors import GaussianMixturePrior, learn_prior

SCENE = {"views": 3, "size": (24, 30)}


@pytest.fixture(scope="module")
def prior(tmp_path_factory):
    path = tmp_path_factory.mktemp("prior") / "prior.nc"
    fields = [load_light_field(name, **SCENE) for name in ("rocket", "rocket:1")]
    return learn_prior(fields, block=(5, 5)).save(path) or path


def test_views_go_through_the_camera_and_back(prior, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene = ["coffee:2", "--views", "3", "--crop", "24x30"]
    take = ["--slots", "2", "--shutter", "one-hot", "--period", "6", "--read-noise", "0.01", "--shear", "1,0.5"]
    said = answer(capsys, "simulate", "light-field", *scene, *take, "--out", "s.nc")
    assert said["views"] == [3, 3]
    assert said["files"] == ["s.nc", "s.png", "s_codes.png", "s_rays.png"]
    kept = Snapshot.load("s.nc")
    assert kept.camera.shear.step == (1.0, 0.5)
    found = answer(capsys, "reconstruct", "s.nc", "--prior", str(prior), "--truth", "coffee:2", "--out", "e.nc")
    assert sorted(file.split(".")[-1] for file in found["files"]) == ["gif", "nc", "png", "png", "png"]
    truth = load_light_field("coffee:2", **SCENE)
    with xr.open_dataset("e.nc") as stored:
        assert stored["estimate"].dims == ("view_v", "view_u", "y", "x")
        error = float(((stored["estimate"].values - truth.values) ** 2).mean())
        assert found["metrics"]["psnr"] == pytest.approx(-10 * np.log10(error), abs=1e-4)
        assert (stored["deviation"] > 0).all()
    again = answer(capsys, "evaluate", "e.nc", "coffee:2")
    assert again["psnr"] == pytest.approx(found["metrics"]["psnr"], abs=1e-4)
    assert again["disparity_mae"] == pytest.approx(found["metrics"]["disparity_mae"], rel=1e-4)
    assert 0 <= again["disparity_badpix"] <= 1


def test_colours_are_snapshots_of_their_own(prior):
    colour = load_light_field("coffee", colour=True, **SCENE)
    camera = LightFieldCamera(3, (24, 30), 2, period=6)
    together = decode(simulate(colour, camera), prior=prior).to_xarray()["estimate"]
    assert together.dims == ("colour", "view_v", "view_u", "y", "x")
    alone = decode(simulate(colour[1], camera), prior=prior).to_xarray()["estimate"]
    np.testing.assert_allclose(together.values[1], alone.values, atol=1e-5)


def test_the_estimate_explains_more_than_the_least_norm_one(prior):
    truth = load_light_field("coffee", **SCENE)
    taken = simulate(truth, LightFieldCamera(3, (24, 30), 4, shutter="one-hot", period=6))
    found = {d: evaluate(decode(taken, d, **how), truth)["psnr"]
             for d, how in (("lmmse", {"prior": prior}), ("admm-tv", {}), ("dagger", {}))}  # fmt: skip
    assert found["lmmse"] > found["dagger"] + 3
    assert found["admm-tv"] > found["dagger"]


@pytest.mark.slow
def test_codes_and_network_are_trained_and_used(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    camera = "camera={views: 3, size: [24, 24], slots: 2, period: 6, learn: both}"
    decoder = "decoder={kind: spatial-angular, start: dagger, stages: 1, width: 4, blocks: 1}"
    tune = ["--set", camera, "--set", decoder, "--set", "data.patch=16", "--set", "data.batch=2"]
    load_light_field("rocket", views=3, size=(40, 44)).to_dataset(name="light_field").to_netcdf("rocket.nc")
    main(["train", "light-field", "--train", "rocket.nc", "--steps", "2", "--out", "run", *tune])
    weights = Weights.load("run")
    assert weights.kind == "light-field"
    assert weights.camera_for((30, 40)).views == (3, 3)
    capsys.readouterr()
    main(["simulate", "light-field", "coffee", "--views", "3", "--crop", "24x30", "--weights", "run", "--out", "s.nc"])
    main(["reconstruct", "s.nc", "--weights", "run", "--out", "e.nc", "--no-figures"])
    assert xr.open_dataset("e.nc")["estimate"].shape == (3, 3, 24, 30)
    assert "light-field camera" in refused(
        capsys, "simulate", "spectral", "coffee", "--weights", "run", "--out", "t.nc"
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("learn", "called", "decode"),
    [
        (["--dictionary", "--atoms", "64"], "dictionary of patches 9 × 11 × 11", ["--dictionary", "p.nc"]),
        (["--mixture", "--figure", "m.png"], "Gaussian mixture of blocks 9 ×", ["-d", "mixture", "--prior", "p.nc"]),
    ],
)
def test_a_prior_of_views_is_learned_and_decodes(learn, called, decode, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(GaussianMixturePrior.settings_of_views, "samples", 2000)
    main(["prior", "learn-views", "rocket", "--views", "3", *learn, "--out", "p.nc"])
    assert called in capsys.readouterr().out
    main(["simulate", "light-field", "coffee", "--views", "3", "--crop", "24x30", "--no-figures", "--out", "s.nc"])
    assert answer(capsys, "reconstruct", "s.nc", *decode, "--truth", "coffee", "--no-figures")["metrics"]["psnr"] > 10


def test_a_colour_estimate_is_evaluated_and_drawn_in_colour(prior, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene = ["coffee", "--views", "3", "--crop", "24x30", "--colour", "--no-figures"]
    main(["simulate", "light-field", *scene, "--slots", "2", "--period", "6", "--out", "s.nc"])
    found = answer(
        capsys, "reconstruct", "s.nc", "--prior", str(prior), "--truth", "coffee", "--no-figures", "--out", "e.nc"
    )["metrics"]
    drawn = {}
    figure = "tmca.applications.light_field.light_field_figure"
    monkeypatch.setattr(figure, lambda estimates, truth, *shown: drawn.update(estimates, truth=truth))
    beside = evaluation_of("e.nc", "coffee")
    beside.figure("e")
    again = beside.metrics
    assert again["psnr"] == pytest.approx(found["psnr"], abs=1e-4)
    assert again["ssim"] == pytest.approx(found["ssim"], abs=1e-5)
    assert drawn["e"].shape == drawn["truth"].shape == (3, 3, 3, 24, 30)


def test_a_picture_of_colours_says_that_it_is_their_mean():
    scene = load_light_field("coffee", **SCENE, colour=True)
    snapshot = simulate(scene, LightFieldCamera(slots=1, shutter="open"))
    assert snapshot.plot().axes[0].get_title() == "light-field, K = 1, mean of red, green and blue"
    grey = simulate(scene.isel(colour=0), LightFieldCamera(slots=1, shutter="open"))
    assert grey.averaged == ""


def test_without_a_true_disparity_the_one_of_the_true_views_is_compared_with():
    truth = load_light_field("coffee", **SCENE)
    del truth.attrs["scene_reading"]  # which says where the true disparity is
    estimate = (0.9 * truth + 0.05).to_dataset(name="estimate")
    found = application_of("light-field").geometry(estimate, truth)
    seen, real = estimate_disparity(estimate["estimate"].values), estimate_disparity(truth.values)
    assert found["disparity_agreement_mae"] == pytest.approx(np.abs(seen - real).mean())
    assert found["disparity_agreement_mae_of_constant"] == pytest.approx(np.abs(real - np.median(real)).mean())
    assert "disparity_mae" not in found


def test_an_estimate_says_where_its_disparity_is():
    scene = load_light_field("coffee:1", **SCENE)
    still = decode(simulate(scene, LightFieldCamera(slots=1, shutter="open")), "dagger")
    assert "disparity, confidence and all_in_focus in .maps" in repr(still)
    single = decode(simulate(scene[1:2, 1:2], LightFieldCamera(slots=1, shutter="open")), "dagger")
    assert "maps" not in repr(single)


def test_a_rendered_truth_of_another_name_is_doubted(tmp_path):
    scene = load_light_field("coffee:1", **SCENE)
    found = decode(simulate(scene, LightFieldCamera(slots=1, shutter="open")), "dagger").save(tmp_path / "e.nc")
    with pytest.warns(SceneWarning, match="coffee:2 is beside a snapshot of coffee:1"):
        evaluate(found, "coffee:2")
    evaluate(found, "coffee:1")
    compare_source("coffee", "coffee:0")  # the same scene
