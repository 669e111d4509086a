"""Every decoder of the registry is measured by studies and sweeps of every camera that it names."""

import numpy as np
import pytest

from tests.evaluation.test_compare_spectral_depth import scene
from tmca.cameras import CAMERAS
from tmca.data import rendered_scene, select_bands, write_dataset
from tmca.data.light_field_scenes import load_light_field
from tmca.decoders import Weights, build_network, decoders_for
from tmca.decoders.nets.build import build_depth_network
from tmca.errors import SettingError
from tmca.evaluation.plan import Plan
from tmca.evaluation.run import run_study
from tmca.evaluation.study import checked_study, read_study
from tmca.evaluation.sweep import Sweep, run_sweep
from tmca.priors import PatchDictionary

pytestmark = pytest.mark.filterwarnings("ignore::tmca.optics.StrayLight", "ignore::tmca.optics.Undersampled")
KINDS = ("spectral", "light-field", "spectral-depth")
CAMERA = {
    "spectral": {"slots": 2, "period": 8},
    "light-field": {"slots": 2, "period": 6},
    "spectral-depth": {"slots": 2, "channels": "monochrome", "planes": 3},
}
READING = {
    "spectral": {"bands": 3, "size": [24, 28]},
    "light-field": {"views": 3, "frame": [26, 30], "crop": [20, 20]},
    "spectral-depth": {"side": 68, "crop": [32, 36]},
}
NETWORK = {"spectral": {"widths": [4, 4]}, "light-field": {"width": 4, "blocks": 1, "stages": 0}}


def scenes_of(kind, folder):
    """One to learn from and one to measure, small."""
    made = []
    for number, name in enumerate(("rocket", "coffee")):
        file = folder / f"{name}.nc"
        if kind == "spectral":
            write_dataset(select_bands(rendered_scene(name, size=(40, 44))["radiance"], 3), file)
        elif kind == "light-field":
            load_light_field(name, views=3, size=(40, 44)).to_dataset(name="light_field").to_netcdf(file)
        else:
            scene(file, number)
        made.append(str(file))
    return made


def weights_of(kind, folder):
    """An untrained network for the camera."""
    size, settings = (36, 36), CAMERA[kind]
    if kind == "spectral-depth":
        camera = CAMERAS[kind].from_preset("quick", size=size, **settings)
        network = build_depth_network({"kind": "two-headed", "start": "snapshot", "widths": [4, 4]}, camera)
    else:
        bands = 3 if kind == "spectral" else 9
        camera = CAMERAS[kind](3, size, **settings)
        views = {} if kind == "spectral" else {"views": [3, 3]}
        name = "unet" if kind == "spectral" else "spatial-angular"
        network = build_network(name, bands=bands, start="dagger", **NETWORK[kind], **views)
    return str(Weights.of(network.eval(), camera, "", {}).save(folder / "weights.safetensors"))


def study_of(kind, scenes, weights):
    about = {
        "camera": kind, "scenes": {"train": scenes[:1], "test": scenes[1:]}, "reading": READING[kind],
        "settings": CAMERA[kind], "codes": {"random": {}}, "noises": {"some": {"read_noise": 0.01}},
        "decoders": list(decoders_for(kind)), "options": {"network": {"weights": weights}},
        "priors": {"dictionary": {"atoms": 40}} if kind == "light-field" else {},
    }  # fmt: skip
    return checked_study({"name": "all", **about, "options": {**shipped_options(kind), **about["options"]}}, "all")


def shipped_options(kind):
    return {"likelihood": {"window": 8}} if kind == "spectral-depth" else {}


def with_search(study):
    """What the spectral-depth camera's masks are judged by is always needed."""
    return study.with_(search=read_study(study.camera).search, train=read_study(study.camera).train.model_dump())


@pytest.mark.parametrize("kind", KINDS)
def test_every_decoder_is_accepted(kind, tmp_path):
    scenes = ["rocket", "coffee"]
    study = with_search(study_of(kind, scenes, "weights.safetensors"))
    places = study.evaluation.places(study, {"coffee": "coffee"}, ["coffee"])
    cells = Plan(study, scenes[:1], places, [], tmp_path).untrained({}, {})
    assert {cell.decoder for cell in cells} == set(decoders_for(kind))
    vary = {"decoder": [name for name in decoders_for(kind) if name != "network"]}
    assert len(Sweep(kind, vary, ["coffee"], READING[kind]).points()) == len(vary["decoder"])
    network = Sweep(kind, {"slots": [2]}, ["coffee"], {}, {"decoder.weights": "default"}, "network")
    assert network.options_of(network.points()[0]) == {"weights": "default"}


@pytest.mark.parametrize("kind", KINDS)
def test_the_network_needs_weights(kind, tmp_path):
    study = study_of(kind, ["rocket", "coffee"], None)
    with pytest.raises(SettingError) as stop:
        run_study(study, tmp_path / "out", tmp_path / "work")
    assert "weights" in str(stop.value.where)
    with pytest.raises(SettingError) as stop:
        Sweep(kind, {"slots": [2]}, ["coffee"], {}, decoder="network").points()
    assert "weights" in str(stop.value.where)


@pytest.mark.slow
@pytest.mark.usefixtures("small_mixtures")
@pytest.mark.filterwarnings("ignore::tmca.decoders.OtherCodes")
@pytest.mark.parametrize("kind", KINDS)
def test_every_decoder_is_measured(kind, tmp_path, monkeypatch):
    monkeypatch.setattr(PatchDictionary, "settings_of_views", {"atoms": 40})
    scenes, weights = scenes_of(kind, tmp_path), weights_of(kind, tmp_path)
    found = run_study(with_search(study_of(kind, scenes, weights)), tmp_path / "out", tmp_path / "work")
    levels = {row["decoder"]: row["psnr"] for row in (*found["rows"], *found.get("crop_rows", ()))}
    assert set(levels) == set(decoders_for(kind))
    assert np.isfinite(list(levels.values())).all()
    names = [name for name in decoders_for(kind) if name != "network"]
    size = {"crop": (32, 36)} if kind == "spectral-depth" else {"size": (24, 28)}
    reading = {**read_study(kind).reading, **READING[kind], **size}
    fixed = {"decoder.weights": weights}
    how = {"scenes": scenes[1:], "reading": reading, "train": scenes[:1]}
    settings = {"noise": 0.01, **CAMERA[kind]}
    swept = run_sweep(Sweep(kind, {"decoder": names}, fixed=settings, **how), tmp_path / "s", tmp_path / "w")
    assert [row["decoder"] for row in swept["rows"]] == names
    asked = Sweep(kind, {"noise": [0.01]}, fixed={**CAMERA[kind], **fixed}, decoder="network", **how)
    assert len(run_sweep(asked, tmp_path / "n", tmp_path / "w")["rows"]) == 1
