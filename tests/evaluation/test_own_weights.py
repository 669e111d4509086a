"""Trained codes and networks in a study of one's own: by name, run or file, and what they learned from."""

import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from tmca.cli import main
from tmca.data import make_folder
from tmca.data.in_memory import SceneWarning
from tmca.decoders import Weights
from tmca.errors import DataError, SettingError, ShapeError
from tmca.evaluation.camera import evaluation_of
from tmca.evaluation.own import own_study
from tmca.evaluation.run import run_study
from tmca.evaluation.trained import check_weights


@pytest.fixture
def here(tmp_path, monkeypatch):
    """The current folder, with weights in two runs and a file."""
    monkeypatch.chdir(tmp_path)
    for file in ("runs/noise0.01/weights.safetensors", "runs/noise0.02/weights.safetensors", "other.safetensors"):
        Weights.find("default").save(make_folder((tmp_path / file).parent) / Path(file).name)
    return tmp_path


@pytest.mark.parametrize(("kind", "scene", "usual"), [
    ("spectral", "coffee", "universal"), ("light-field", "coffee:1", "default"),
    ("spectral-depth", "coffee", "default"),
])  # fmt: skip
def test_codes_and_networks_that_come_with_tmca(kind, scene, usual):
    study = own_study(scene, camera=kind, codes=["default"], decoders=["network"])
    assert (study.codes["default"].weights, study.options["network"]) == ("default", {"weights": usual})
    assert study.decoder_labels["network"] == f"network ({usual})"
    named = own_study(scene, camera=kind, codes=["mine=default"], decoders=["lmmse"], weights="default")
    assert (named.decoders, named.options["network"], [*named.codes]) == (
        ("lmmse", "network"), {"weights": "default"}, ["mine"],
    )  # fmt: skip
    assert "network" not in own_study(scene, camera=kind, decoders=["lmmse"]).options


@pytest.mark.parametrize("kind", ["light-field", "spectral-depth"])
def test_a_network_of_one_camera_is_measured_behind_its_codes_where_none_are_named(kind):
    assert [*own_study("coffee", camera=kind, decoders=["network"]).codes] == ["default"]


def test_a_network_of_any_codes_is_measured_behind_the_usual_ones():
    assert [*own_study("coffee", decoders=["network"]).codes] == ["cassi", "one-hot", "two-bucket"]


def test_weights_of_a_run_bring_their_codes_under_its_name(here):
    codes = own_study("coffee", codes=["runs/noise0.01", "runs/noise0.02", "mine=other.safetensors"]).codes
    assert {name: code.weights for name, code in codes.items()} == {
        "noise0.01": "runs/noise0.01", "noise0.02": "runs/noise0.02", "mine": "other.safetensors",
    }  # fmt: skip
    assert own_study("coffee", weights="runs/noise0.01").decoder_labels["network"] == "network (noise0.01)"


def test_a_folder_that_is_no_run_is_refused(here):
    make_folder(here / "design")
    with pytest.raises(DataError, match="a folder without weights"):
        own_study("coffee", codes=["design"])


@pytest.mark.parametrize(("weights", "scene", "known"), [
    ("default", "astronaut", True),  # of the training
    ("default", "tissue", True),  # of its validation
    ("default", "coffee", False),
    ("universal", "coffee", False),
])  # fmt: skip
def test_scenes_that_weights_learned_from_are_said(recwarn, weights, scene, known):
    study = own_study(scene, codes=["default"] if weights == "default" else ["cassi"], weights=weights)
    said = [str(one.message) for one in recwarn if issubclass(one.category, SceneWarning)]
    assert said == ([f"{scene} is a scene that the weights {weights} learned from."] if known else [])
    assert list(study.about) == said


@pytest.mark.parametrize(("more", "said"), [
    (["--codes", "default-light-field"], "those of a light-field camera"),
    (["--codes", "cassi", "--weights", "gone.safetensors"], "--weights: found gone.safetensors: no such file"),
    (["--codes", "cassi", "--weights", ""], "found none for the decoder network"),
    (["--codes", "cassi", "--weights", "default-light-field"], "those of a light-field camera"),
    (["--codes", "cassi,default", "--bands", "5"], "found 12 bands of 400 to 700 nm, expected the scene's 5 bands"),
    (["--codes", "cassi", "--weights", "default", "--bands", "5"], "expected the scene's 5 bands of 400 to 700 nm;"),
])  # fmt: skip
def test_weights_that_a_study_cannot_use_are_refused_before_anything_is_measured(here, capsys, more, said):
    with pytest.raises(SystemExit) as ended:
        main(["study", "coffee", "--crop", "32x32", "--decoders", "dagger", *more])
    assert ended.value.code == 2
    assert said in capsys.readouterr().err.splitlines()[-1]
    assert not (here / "coffee-study").exists()


def test_networks_for_other_views_are_refused_before_anything_is_measured(here):
    study = own_study("coffee:1", camera="light-field", crop=(32, 32), weights="default", reading={"views": 3})
    with pytest.raises(ShapeError, match="5×5 views, expected the scene's 3×3"):
        run_study(study, here / "out", here / "work")


def test_weights_beside_cameras_of_other_bands_are_refused():
    with pytest.raises(SettingError, match="cameras of the same bands"):
        own_study("coffee", camera="spectral-depth", codes=["thesis", "default"])


@pytest.mark.parametrize("weights", [5, ["a"], ""])
def test_what_names_no_weights_is_refused(weights):
    with pytest.raises(SettingError, match="for the decoder network"):
        check_weights("network", {"weights": weights}, "spectral", "weights")


def test_predicted_figures_of_codes_are_new_where_weights_changed_under_the_same_path(monkeypatch):
    evaluation = evaluation_of("spectral-depth")
    monkeypatch.setattr(type(evaluation), "judging", lambda *_: {})
    study, lists = SimpleNamespace(reading={}, seed=0), SimpleNamespace(places=[])
    same = {
        "decoder": "likelihood",
        "code": "mine",
        "noise": "low",
        "seed": 0,
        "settings": {},
        "sensor": {},
        "codes": None,
    }
    cells = [SimpleNamespace(**same, camera_of="w.safetensors", identity=identity) for identity in ("one", "other")]
    keys = [evaluation.checks(study, [cell], lists)[1].key for cell in cells]
    assert keys[0] != keys[1]


@pytest.mark.slow
def test_a_network_is_measured_behind_default_codes(here, capsys):
    asked = ("coffee", "--crop", "48x48", "--codes", "default", "--decoders", "dagger", "--weights", "universal")
    main(["study", *asked, "--json"])
    level = {row["decoder"]: row["psnr"] for row in json.loads(capsys.readouterr().out)["rows"]}
    assert level["network"] > level["dagger"] + 3
