"""The light-field table: rows of every code, noise and decoder, numbers that are those of the cameras, kept cells."""

import json
import re

import numpy as np
import pytest
from PIL import Image

from tests.cli.refusals import refused
from tmca.applications import evaluate, simulate
from tmca.cameras import LightFieldCamera
from tmca.data import rendered_light_field
from tmca.data.light_field_scenes import load_light_field
from tmca.decoders import Weights, decode
from tmca.errors import SettingError
from tmca.evaluation.gains import margins
from tmca.evaluation.light_field import LightFieldEvaluation
from tmca.evaluation.page import sections
from tmca.evaluation.run import run_study
from tmca.evaluation.study import checked_study, read_study
from tmca.metrics import estimate_disparity
from tmca.sensor import Sensor

SHIPPED = read_study("light-field")
EFFORT = {"descents": 1, "steps": 3, "flips": 10}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("table")
    for name in ("rocket", "tissue", "chelsea"):
        field = load_light_field(name, views=3, size=(40, 44))
        field.to_dataset(name="light_field").to_netcdf(place / f"{name}.nc")
    (place / "train.txt").write_text("rocket.nc\ntissue.nc\n")
    (place / "test.txt").write_text("chelsea.nc\n")
    return place


@pytest.fixture(scope="module")
def study(folder):
    about = SHIPPED.model_dump()
    for name, own in (("consistent", {"start": "lmmse"}), ("sub-network", {"start": "dagger", "stages": 0})):
        about["networks"][name]["decoder"] = {"kind": "spatial-angular", "width": 4, "blocks": 1, **own}
    del about["noises"][list(about["noises"])[2]]
    for name in ("CLFP static random", "TMCA random K = 8", "TMCA one-hot K = 8", "TMCA E2E K = 8"):
        del about["codes"][name]
    about["decoders"] = [name for name in about["decoders"] if name != "dictionary"]
    for name, code in about["codes"].items():
        code["train"] = name == "CLFP optimised"
        if "K = 8" in name:  # without the searches of fewer slots that designs of eight start from
            code["camera"]["slots"] = code["search"]["slots"] = 2
    about["reading"] |= {"views": 3, "frame": (30, 36), "rendered": (26, 30), "crop": (20, 20)}
    about["settings"], about["search"] = {"period": [6, 6]}, {"effort": EFFORT}
    about["train"] |= {"steps": 4, "repeat": 1, "rendered": False}
    about["train"]["settings"]["data"]["patch"] = 16
    about |= {"seeds": 2, "priors": {"mixture": {"kinds": 3, "rank": 20, "samples": 2000}}}
    about["scenes"] = {name: [str(folder / f"{name}.txt")] for name in ("train", "test")}
    return checked_study(about, "small")


@pytest.fixture(scope="module")
def found(folder, study):
    return run_study(study, folder / "out", folder / "work")


@pytest.mark.slow
def test_every_code_noise_and_decoder_has_a_row_and_no_design_two(found, study):
    plain = {name for name, code in study.codes.items() if code.learn is None}
    whole = {(row["decoder"], row["noise"], row["code"]) for row in found["rows"]}
    assert len(whole) == len(found["rows"])
    for decoder in ("lmmse", "mixture"):
        for noise in study.noises:
            own = {code for name, column, code in whole if (name, column) == (decoder, noise)}
            twice = {code for code in plain if code.endswith("this noise") and noise == "σ = 0.05"}
            assert own == plain - twice
    assert {code for name, _, code in whole if name in study.networks} == {"CLFP optimised", "CLFP E2E"}
    assert {row["decoder"] for row in found["crop_rows"]} == set(study.decoders)
    assert all(len(row["seed_psnr"]) == 2 for row in found["rows"])


@pytest.mark.slow
def test_a_row_is_what_the_camera_of_its_codes_gives(found, folder):
    name = "TMCA one-hot K = 4"
    row = next(r for r in found["rows"] if (r["code"], r["noise"], r["decoder"]) == (name, "σ = 0.05", "lmmse"))
    scene = load_light_field(str(folder / "chelsea.nc"), views=3, size=(30, 36))
    levels = []
    for seed in (0, 1):
        camera = LightFieldCamera((3, 3), (30, 36), 4, shutter="one-hot", period=6, seed=seed, sensor=Sensor(0.05))
        (prior,) = (folder / "work").glob("prior-gaussian-*.nc")
        levels.append(evaluate(decode(simulate(scene, camera, seed=seed), prior=prior), scene)["psnr"])
    assert row["scenes"]["chelsea"]["psnr"] == pytest.approx(np.mean(levels), abs=1e-4)
    assert row["psnr"] == pytest.approx(np.mean([own["psnr"] for own in row["scenes"].values()]))
    assert "disparity_mae" not in row["scenes"]["chelsea"]
    assert row["disparity_mae"] == pytest.approx(
        np.mean([row["scenes"][n]["disparity_mae"] for n in ("coffee", "motorcycle")])
    )


@pytest.mark.slow
def test_codes_learn_end_to_end_from_the_designed_ones(found, folder):
    learned = {}
    for file in (folder / "work").glob("*.json"):
        cell = json.loads(file.read_text())
        if cell.get("step") == "training" and (cell["decoder"], cell["seed"]) == ("sub-network", 0):
            learned[cell["code"]] = (Weights.load(cell["weights"]), cell["training"])
    (fixed, plain), (tuned, settings) = learned["CLFP optimised"], learned["CLFP E2E"]
    assert (plain["camera"]["learn"], settings["camera"]["learn"]) == ("none", "aperture")
    assert settings["codes"]["start"] == plain["codes"]["start"]
    assert (tuned.codes["shutter"] == 1).all()
    assert (tuned.camera_for((30, 36)).codes.aperture.tile() == tuned.codes["aperture"]).all()
    assert fixed.codes["aperture"].shape == tuned.codes["aperture"].shape


@pytest.mark.slow
def test_the_json_has_what_results_have_and_every_view(found, study):
    assert {"command", "commit", "study", "split", "budget", "rows"} <= set(found)
    assert found["study"]["search"]["effort"] == EFFORT
    for row in found["rows"]:
        assert row["exposure"] == "equal"
        assert row["method"] == f"{row['code']} + {study.decoder_labels[row['decoder']]}"
        for scene, own in row["views"].items():
            assert np.shape(own["psnr"]) == np.shape(own["ssim"]) == (3, 3)
            assert row["scenes"][scene]["ssim"] == pytest.approx(np.mean(own["ssim"]), abs=1e-6)


@pytest.mark.slow
def test_designs_are_searched_for_their_noise(found, study):
    searched = {(row["code"], row["noise"]): row for row in found["searches"] if row["seed"] == 0}
    assert len(searched) == 4
    for noise in study.noises:
        static, free = (
            searched[f"{code} for this noise", noise] for code in ("CLFP optimised", "TMCA optimised K = 8")
        )
        assert static["held_out_gain"] == pytest.approx(0, abs=1e-9)
        assert free["psnr"] >= static["psnr"] - 1e-6


@pytest.mark.slow
def test_results_come_with_a_page_and_pictures_and_stay(found, folder, study):
    out = folder / "out"
    assert json.loads((out / "light-field.json").read_text())["rows"] == json.loads(json.dumps(found["rows"]))
    page = (out / "light-field.md").read_text()
    assert "## noise-free" in page
    assert "TMCA optimised K = 8 for this noise" in page
    row = next(r for r in found["rows"] if (r["code"], r["decoder"]) == ("CLFP E2E", "sub-network"))
    own = row["scenes"]["chelsea"]
    assert f"| CLFP E2E | 33.21 | 0.910 |  | {own['psnr']:.2f} / {own['ssim']:.3f} |" in page
    pictures = {file.name for file in out.glob("*.png")}
    assert pictures == set(re.findall(r"\]\(([^)]*\.png)\)", page))
    assert pictures == {"light-field_glance.png"} | {
        f"light-field_{scene}_{kind}.png"
        for scene in ("chelsea", "coffee", "motorcycle") for kind in ("views", "psnr", "disparity")
    }  # fmt: skip
    told = []
    again = run_study(study, out, folder / "work", overwrite=True, progress=lambda *said: told.append(said))
    assert told == []
    assert again["rows"] == found["rows"]


FEW = {  # views and pixels
    "name": "few", "camera": "light-field", "settings": {"period": [4, 4]},
    "reading": {"views": 3, "frame": (24, 28), "crop": (12, 12)},
    "codes": {
        "drawn": {"camera": {"slots": 2}},
        "searched": {"camera": {"slots": 2}, "search": {"kind": "one-hot", "slots": 2, "noise": "some"}},
    },
    "noises": {"some": {"read_noise": 0.02}}, "decoders": ["tikhonov"],
    "shown": [["drawn", "tikhonov"]], "shown_noise": "some",
    "search": {"effort": {"descents": 1, "steps": 2, "flips": 4}},
}  # fmt: skip


def test_rows_say_how_views_and_their_disparity_come_back(tmp_path):
    field = load_light_field("rocket", views=3, size=(20, 24))
    field.to_dataset(name="light_field").to_netcdf(tmp_path / "rocket.nc")
    study = checked_study({**FEW, "scenes": {"train": [str(tmp_path / "rocket.nc")], "test": ["coffee"]}}, "few")
    out = tmp_path / "out"
    found = run_study(study, out, tmp_path / "work")
    rows = {row["code"]: row for row in found["rows"]}
    scene = load_light_field("coffee", views=3, size=(24, 28))
    camera = LightFieldCamera((3, 3), (24, 28), 2, period=4, seed=0, sensor=Sensor(0.02))
    estimate = decode(simulate(scene, camera, seed=0), "tikhonov")
    views, own = estimate.to_xarray()["estimate"].values, rows["drawn"]["scenes"]["coffee"]
    assert own["psnr"] == pytest.approx(evaluate(estimate, scene)["psnr"], abs=1e-4)
    squares = ((views - scene.values) ** 2).mean((2, 3))
    np.testing.assert_allclose(rows["drawn"]["views"]["coffee"]["psnr"], -10 * np.log10(squares), atol=1e-3)
    known = rendered_light_field("coffee", views=3, size=(24, 28))["disparity"].values
    seen, of_truth = estimate_disparity(views), estimate_disparity(scene.values)
    assert own["disparity_mae"] == pytest.approx(np.abs(seen - known).mean(), rel=1e-3)
    assert own["disparity_agreement_mae"] == pytest.approx(np.abs(seen - of_truth).mean(), rel=1e-3)
    assert own["disparity_mae_of_constant"] == pytest.approx(np.abs(known - np.median(known)).mean(), rel=1e-3)
    assert own["disparity_spread"] == pytest.approx(np.subtract(*np.quantile(seen, (0.95, 0.05))), rel=1e-3)
    assert found["geometry"]["coffee"]["disparity_mae"] == pytest.approx(np.abs(of_truth - known).mean(), rel=1e-3)
    (crop,) = [row for row in found["crop_rows"] if row["code"] == "drawn"]
    assert crop["scenes"]["coffee"]["psnr"] != own["psnr"]
    assert "disparity_mae" not in crop["scenes"]["coffee"]
    assert rows["searched"]["throughput"] == pytest.approx(found["searches"][0]["throughput"])
    assert found["searches"][0]["psnr"] > found["searches"][0]["random_psnr"]
    pictures = re.findall(r"\]\(([^)]*\.png)\)", (out / "few.md").read_text())
    assert {file.name for file in out.glob("*.png")} == {*pictures}
    assert {*pictures} == {f"few_coffee_{kind}.png" for kind in ("views", "psnr", "disparity")}


def results(rows, **more):
    found = {"study": SHIPPED.model_dump(mode="json"), "rows": rows, "searches": [], "geometry": {}, "pictures": {}}
    return found | {"split": {"test": ["a"], "real": ["a"]}, "budget": {"training": []}} | more


def test_rows_with_a_flat_disparity_are_said_beside_what_a_constant_has():
    flat = {**row("a", 12.0, 0.3, "dagger"), "disparity_spread": 0.1, "disparity_spread_of_true": 1.0}
    rich = {**row("b", 30.0, 0.3), "disparity_spread": 0.9, "disparity_spread_of_true": 1.0}
    made = sections(results([flat, rich, row("old", 30.0, 0.3)]), SHIPPED)
    first = next(section for section in made if section.title == "noise-free")
    assert [text[:32] for text in first.text] == ["Flat disparity: a + least norm. "]
    assert "disparity varies by (px, 5 to 95 %)" in [heading for _, heading, _ in first.columns]


def test_the_published_table_stands_beside_what_was_measured():
    row = {"code": "CLFP static random", "noise": "noise-free", "decoder": "dictionary", "seed_psnr": [33.8],
           "scenes": {"a": {"psnr": 33.8, "ssim": 0.92}}}  # fmt: skip
    made = {section.title: section for section in sections(results([], crop_rows=[row]), SHIPPED)}
    table = {one["row"]: one for one in made["The thesis' table 1"].table}
    assert table["CLFP dictionary"] == {"row": "CLFP dictionary", "psnr": 30.06, "ssim": 0.82,
                                        "dictionary": "33.80 / 0.920"}  # fmt: skip
    assert [(one["psnr"], one["ssim"]) for one in table.values()][1:] == [
        (32.43, 0.91), (33.21, 0.91), (34.03, 0.93), (34.89, 0.94)
    ]  # fmt: skip
    assert not table["CLFP deep"]["consistent"]


def row(code, psnr, shape, decoder="lmmse"):
    geometry = {"disparity_mae": shape, "disparity_badpix": shape, "disparity_agreement_mae": shape}
    scenes = {"a": {"psnr": psnr}, "b": {"psnr": 2 * psnr, **geometry}}
    return {"code": code, "noise": "noise-free", "decoder": decoder, "seed_psnr": [psnr], "scenes": scenes}


def test_margins_compare_the_best_of_each_kind_and_decoders_each_other():
    table = [row("CLFP static random", 30.0, 0.3), row("CLFP optimised", 31.0, 0.4)]
    table += [row("TMCA random K = 8", 30.5, 0.1), row("TMCA optimised K = 8", 33.0, 0.2)]
    split = {"test": ["a", "b"], "real": ["a"]}
    real, rendered = margins(results(table, split=split), SHIPPED)
    assert (real["part"], rendered["part"]) == ("of the study", "rendered")
    assert (real["base"], real["best"]) == ("CLFP optimised", "TMCA optimised K = 8")
    assert (real["gain"], rendered["gain"]) == pytest.approx((2.0, 4.0))
    assert rendered["disparity_mae"] == pytest.approx(-0.2)
    assert real["disparity_mae"] is None
    better = [row("CLFP optimised", 32.5, 0.1, "consistent"), row("TMCA optimised K = 8", 33.5, 0.1, "consistent")]
    made = {one.title: one.table for one in sections(results(table + better, split=split), SHIPPED)}
    steps = made["Decoders over others"]
    assert [step["part"] for step in steps] == ["of the study", "rendered"]
    assert (steps[0]["least"], steps[0]["mean"], steps[0]["most"]) == pytest.approx((0.5, 1.0, 1.5))
    pair = next(one for one in made["Codes over others"] if one["decoder"] == "patch LMMSE")
    assert (pair["code"], pair["base"]) == ("TMCA optimised K = 8", "CLFP optimised")
    assert pair["gain"] == pytest.approx(2.0)


def test_networks_are_chosen_by_their_validation_and_told_in_hindsight_too():
    validated = {"CLFP optimised": 2.0, "TMCA optimised K = 8": 1.0, "TMCA random K = 8": 2.0}
    trained = [
        {"code": code, "decoder": "consistent", "best": {"psnr": best}, "cpu_seconds": 1.0}
        for code, best in validated.items()
    ]
    table = [row("CLFP optimised", 31.0, 0.4, "consistent"), row("TMCA random K = 8", 30.5, 0.1, "consistent"),
             row("TMCA optimised K = 8", 33.0, 0.2, "consistent")]  # fmt: skip
    (found,) = margins(results(table, budget={"training": trained}), SHIPPED)
    assert found["best"] == "TMCA random K = 8"
    assert (found["gain"], found["hindsight"]) == pytest.approx((-0.5, 2.0))


def test_cells_of_a_folder_are_read_by_its_pattern(tmp_path):
    truth = load_light_field("coffee", views=3, size=(26, 30))
    for v, u in np.ndindex(3, 3):
        Image.fromarray(np.rint(255 * truth.values[v, u]).astype(np.uint8)).save(tmp_path / f"a{v}b{u}c.png")
    maps = []
    for pattern in ("a{row}b{column}c.png", "a{-row}b{-column}c.png"):
        reading = {"views": 3, "size": [26, 30], "pattern": pattern}
        maps.append(LightFieldEvaluation().disparity(str(tmp_path), reading)["seen"].values)
    assert np.corrcoef(maps[0].ravel(), maps[1].ravel())[0, 1] < 0


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("--decoders magic", "magic"), ("--frame 30", "--frame"), ("--steps 0", "--steps"), ("--views 4", "4"),
        ("--views 3 --frame 270x480", "chelsea.nc"), ("--train missing.txt", "missing"),
    ],
)  # fmt: skip
def test_bad_input_is_refused(folder, tmp_path, capsys, more, words):
    lists = [f"--{name}={folder / name}.txt" for name in ("train", "test") if f"--{name}" not in more]
    command = ["compare", "light-field", *lists, "--out", tmp_path / "o", "--work", tmp_path / "w"]
    assert words in refused(capsys, *command, *more.split())
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("frame", "crop"), [("30x100", [30, 96]), ("270x480", [96, 96])])
def test_dictionaries_have_no_more_than_the_frame(folder, capsys, monkeypatch, frame, crop):
    def seen(study, *places, **how):
        raise SettingError("study", str([*study.reading["crop"]]))

    monkeypatch.setattr("tmca.evaluation.run.run_study", seen)
    lists = [f"--{name}={folder / name}.txt" for name in ("train", "test")]
    assert f"study: found {crop}" in refused(capsys, "compare", "light-field", *lists, "--frame", frame)


def test_a_scene_that_is_measured_anyway_is_not_to_be_named(folder, tmp_path, capsys):
    (tmp_path / "test.txt").write_text("coffee\n")
    command = ("compare", "light-field", f"--train={folder / 'train.txt'}", f"--test={tmp_path / 'test.txt'}")
    said = refused(capsys, *command, "--views", "3", "--out", tmp_path / "o", "--work", tmp_path / "w")
    assert "--test: found coffee, expected other scenes; leave it out: coffee, motorcycle are measured anyway" in said
