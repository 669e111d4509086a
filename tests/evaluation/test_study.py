"""Studies of one's own: what their YAML may say, rows that are those of the cameras, resumption."""

import json
import re
from pathlib import Path

import pytest
import yaml

from tests.cli.refusals import refused
from tmca.applications import evaluate, simulate
from tmca.cameras import SpectralCamera
from tmca.cli import main
from tmca.data.scenes import load_scene
from tmca.decoders import Weights, decode
from tmca.errors import SettingError
from tmca.evaluation.study import read_study, training_of
from tmca.sensor import Sensor

MINE = {
    "camera": "spectral",
    "scenes": {"test": ["coffee"]},
    "reading": {"bands": 4, "size": [24, 32]},
    "codes": {"static": {"camera": {"slots": 1, "shutter": "open"}}, "two": {"camera": {"slots": 2}}},
    "noises": {"some": {"read_noise": 0.02}},
    "decoders": ["admm-tv", "dagger"],
    "seeds": 2,
}


def written(folder, **changes):
    file = folder / "mine.yaml"
    file.write_text(yaml.safe_dump(MINE | changes, allow_unicode=True))
    return file


@pytest.mark.parametrize("camera", ["spectral", "light-field", "spectral-depth"])
def test_shipped_studies_are_whole(camera):
    study = read_study(camera)
    assert study.name == study.camera == camera
    assert study.page
    assert set(study.decoders) <= set(study.decoder_labels)
    for code, decoder in study.shown or ():
        assert code in study.codes
        assert decoder in study.decoder_labels


def test_a_study_measures_what_the_cameras_give_and_resumes(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    main(["study", str(written(tmp_path)), "--json"])
    captured = capsys.readouterr()
    found = json.loads(captured.out)
    rows = {(row["code"], row["noise"], row["decoder"]): row for row in found["rows"]}
    assert set(rows) == {(code, "some", name) for code in MINE["codes"] for name in MINE["decoders"]}
    assert {file.name for file in (tmp_path / "results").iterdir()} == {"mine.json", "mine.csv", "mine.md"}
    scene, levels = load_scene("coffee", bands=4, size=(24, 32)), []
    for seed in (0, 1):
        bands = scene["wavelength"].values.tolist()
        camera = SpectralCamera(bands=bands, size=(24, 32), slots=2, seed=seed, sensor=Sensor(0.02))
        levels.append(evaluate(decode(simulate(scene, camera, seed=seed), "admm-tv"), scene)["psnr"])
    assert rows["two", "some", "admm-tv"]["seed_psnr"] == pytest.approx(levels, abs=1e-4)
    main(["study", "mine.yaml"])
    assert capsys.readouterr().err == ""
    written(tmp_path, seeds=1)
    said = refused(capsys, "study", "mine.yaml")
    assert "mine.json: found results of another study (other seeds)" in said
    main(["study", "mine.yaml", "--overwrite"])
    assert capsys.readouterr().err == ""
    assert "mine.json" in refused(capsys, "study", str(written(tmp_path)))
    (tmp_path / "results" / "mine.json").write_text("{")
    assert "found results of another study, expected none" in refused(capsys, "study", "mine.yaml")


def test_codes_may_be_those_of_weights(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    codes = {"one": {"weights": "default", "camera": {"slots": 1}}, "several": {"weights": "default-spectral"}}
    about = {"codes": codes, "reading": {"bands": 12, "size": [40, 48]}, "seeds": 1, "decoders": ["dagger", "network"]}
    file = written(tmp_path, **about, options={"network": {"weights": "default"}})
    study = read_study(file)
    assert [code.one_slot for code in study.codes.values()] == [True, False]
    main(["study", str(file), "--json"])
    rows = {(row["code"], row["decoder"]): row["psnr"] for row in json.loads(capsys.readouterr().out)["rows"]}
    camera = Weights.find("default", 1).camera_for((40, 48), sensor=Sensor(0.02))
    scene = load_scene("coffee", bands=12, size=(40, 48))
    for decoder in about["decoders"]:
        alone = evaluate(decode(simulate(scene, camera, seed=0), decoder), scene)["psnr"]
        assert rows["one", decoder] == pytest.approx(alone, abs=1e-4)
    assert rows["several", "network"] > rows["several", "dagger"] + 3


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ({"weights": "nowhere"}, "codes.mine.weights: found nowhere: nowhere: found no such file"),
        ({"weights": "universal"}, "codes.mine.weights: found universal"),
        ({"weights": "default-light-field"}, "codes.mine.weights: found default-light-field"),
        ({"weights": "default", "camera": {"slots": 4}}, "slots = 4 beside weights of 8"),
        ({"weights": "default", "camera": {"shutter": "open"}}, "shutter beside weights"),
        ({"weights": "default", "file": "codes.nc"}, "codes of file and weights"),
    ],
)
def test_weights_that_are_no_codes_are_named(tmp_path, code, said):
    with pytest.raises(SettingError, match=re.escape(said)):
        read_study(written(tmp_path, codes={"mine": code}))


def test_in_dead_time_a_burst_collects_no_light(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    burst = {"camera": {"slots": 2, "shutter": "burst", "buckets": 2}}
    codes = {"burst": burst, "gaps": {**burst, "dead_time": 0.25}}
    settings = {"motion": {"pixels": 2, "frames": 2}, "seeds": 1, "decoders": ["dagger"], "noises": {"none": {}}}
    main(["study", str(written(tmp_path, codes=codes, **settings)), "--json"])
    rows = {row["code"]: row for row in json.loads(capsys.readouterr().out)["rows"]}
    assert rows["gaps"]["throughput"] == pytest.approx(0.75 * rows["burst"]["throughput"])
    assert rows["gaps"]["psnr"] != rows["burst"]["psnr"]


def test_networks_of_the_shipped_study_are_at_hand_and_may_be_changed(tmp_path):
    shipped, own = read_study("spectral"), {"unrolled": {"pace": 0.5}}
    study = read_study(written(tmp_path, decoders=["unrolled"], networks=own))
    assert study.networks["unrolled"].decoder == shipped.networks["unrolled"].decoder
    assert study.networks["unrolled"].pace == 0.5
    assert not study.page


@pytest.mark.parametrize(
    ("changes", "where"),
    [
        ({"camera": "pinhole"}, "camera"),
        ({"codes": {}}, "codes"),
        ({"colour": 1}, "colour"),
        ({"seeds": 0}, "seeds"),
        ({"reading": {"views": 5}}, "views"),
        ({"noises": {"odd": {"hiss": 1}}}, "noises.odd"),
        ({"codes": {"a": {"search": {"kind": "free", "slots": 2, "noise": "none"}}}}, "codes.a.search.noise"),
        ({"codes": {"a": {"learn": {"what": "both", "networks": {"magic": []}}}}}, "codes.a.learn.networks"),
        ({"codes": {"a": {"learn": {"what": "both", "start": "b", "networks": {}}}}}, "codes.a.learn.start"),
        ({"decoder_pairs": [["lmmse", "magic"]]}, "decoder_pairs"),
        ({"codes": {"a": {"dead_time": 0.004}}}, "codes.a.dead_time"),
        ({"codes": {"a": {"camera": {"buckets": 2}, "search": {"kind": "burst", "slots": 4}}}}, "codes.a.buckets"),
        ({"camera": "spectral-depth", "reading": {}, "codes": {"a": {"dead_time": 0.1}}}, "codes.a.dead_time"),
        ({"codes": {"a": {"dead_time": 0.1, "learn": {"what": "both", "networks": {}}}}}, "codes.a.dead_time"),
    ],
)
def test_what_is_no_study_is_named(tmp_path, changes, where):
    with pytest.raises(SettingError) as stop:
        read_study(written(tmp_path, **changes))
    assert where in str(stop.value.where)


NETWORK = {"settings": {"period": 4}, "networks": {"net": {"label": "net", "decoder": {"kind": "unet"}}}}
GAPS = {"camera": {"slots": 2, "shutter": "burst", "buckets": 2}, "dead_time": 0.1}


def test_a_network_learns_behind_as_many_slots_as_were_searched(tmp_path):
    codes = {"searched": {"search": {"kind": "free", "slots": 4, "noise": "some"}}}
    study = read_study(written(tmp_path, **NETWORK, codes=codes, decoders=["net"]))
    assert training_of(study, "searched", "net", 0, {})["camera"]["slots"] == 4


def test_dead_time_is_for_codes_that_no_network_learns_behind(tmp_path):
    with pytest.raises(SettingError, match="train: false"):
        read_study(written(tmp_path, **NETWORK, codes={"gaps": GAPS}, decoders=["net"]))
    study = read_study(
        written(tmp_path, **NETWORK, codes={"gaps": {**GAPS, "train": False}}, decoders=["net", "dagger"])
    )
    assert study.codes["gaps"].dead_time == 0.1


def documented():
    text = (Path(__file__).parents[2] / "docs" / "studies.md").read_text()
    return next(block for block in re.findall(r"```yaml\n(.*?)```", text, re.S) if "camera:" in block)


def test_the_study_of_the_docs_is_one(tmp_path):
    (tmp_path / "mine.yaml").write_text(documented())
    study = read_study(tmp_path / "mine.yaml")
    assert study.name == "mine"
    assert len(study.codes) == len(study.noises) == len(study.decoders) == 2


@pytest.mark.slow
def test_the_study_of_the_docs_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").write_text(documented())
    main(["study", "mine.yaml"])
    page = capsys.readouterr().out
    assert page == (tmp_path / "results" / "mine.md").read_text()
    assert "one-hot K = 4" in page


DESIGNED = {"codes": {"two": {"camera": {"buckets": 2}, "search": {"kind": "two-bucket", "slots": 2}}}, "seeds": 1}


@pytest.mark.slow
def test_codes_of_two_buckets_are_searched_in_a_tile_given_by_one_side(tmp_path, monkeypatch, capsys):
    """Scenes to learn from are the rendered ones; the searched codes are measured."""
    monkeypatch.chdir(tmp_path)
    own = {"settings": {"period": 8}, "search": {"effort": {"descents": 1, "steps": 1, "flips": 0}}}
    scenes = {"train": ["astronaut", "rocket"], "test": ["coffee"]}
    reading = {"bands": 2, "size": [32, 40]}
    main(["study", str(written(tmp_path, **DESIGNED, **own, scenes=scenes, reading=reading)), "--json"])
    (row,) = [r for r in json.loads(capsys.readouterr().out)["rows"] if r["decoder"] == "dagger"]
    assert row["psnr"] > 10


@pytest.mark.slow
def test_a_search_without_a_tile_is_refused(tmp_path, capsys):
    about = written(tmp_path, **DESIGNED, scenes={"train": ["astronaut", "rocket"], "test": ["coffee"]})
    assert "settings.period" in refused(capsys, "study", str(about), "--out", str(tmp_path), lines=None)
