"""The study of codes: the same effort for all, gains that are what they say, cells that are kept."""

import json

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.stats import rankdata

from tmca.applications import simulate
from tmca.data.scenes import load_scene
from tmca.decoders import Weights
from tmca.design import Effort
from tmca.errors import OutputError, SettingError
from tmca.experiments.codes import ranking as ranks
from tmca.experiments.codes.ablation import INGREDIENTS
from tmca.experiments.codes.figures import _draw_bars
from tmca.experiments.codes.learned import prior_file
from tmca.experiments.codes.study import CORNERS, _common, _network_cells, sensors, study_codes
from tmca.experiments.codes.tables import grid_rows, network_rows, scene_rows
from tmca.experiments.codes.tables import test_rows as rows_of_tests
from tmca.experiments.codes.task import Task, on_frame
from tmca.experiments.spectral.imaging import reconstruct_snapshot
from tmca.priors import GaussianPrior
from tmca.sensor import Sensor

pytestmark = pytest.mark.slow
SMALL = {"bands": 3, "slots": [2], "period": (4, 6), "effort": Effort(2, 3, 20), "test_slots": 2}
SCENES = ["tissue", "rocket"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("study")


@pytest.fixture(scope="module", autouse=True)
def small_scenes():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tmca.experiments.codes.study._RANKED_SIZE", (48, 48))
        yield


@pytest.fixture(scope="module")
def found(folder):
    return study_codes(SCENES, ["coffee"], folder / "out", folder / "work", **SMALL)


def test_every_noise_is_searched_at_equal_time_and_the_corners_per_slot(found):
    equal = [row for row in found["grid"] if row["exposures"] == 1]
    assert {row["noise"] for row in equal} == set(sensors())
    assert [(row["kind"], row["slots"]) for row in equal[:3]] == [("static", 1), ("one-hot", 2), ("free", 2)]
    assert {row["noise"] for row in found["grid"] if row["exposures"] == 2} == set(CORNERS)
    for noise in sensors():
        static, one_hot, free = (row for row in equal if row["noise"] == noise)
        assert static["gain"] == 0
        assert one_hot["gain"] == pytest.approx(one_hot["psnr"] - static["psnr"])
        assert free["psnr"] >= max(static["psnr"], one_hot["psnr"]) - 1e-4
        assert set(free["held_out_gains"]) == set(SCENES)


def test_time_per_slot_is_less_noise(found):
    noise = "σ = 0.01"
    static = {row["exposures"]: row["psnr"] for row in found["grid"] if row["noise"] == noise and row["slots"] == 1}
    assert static[2] > static[1]
    rows = [row for row in grid_rows(found, 2) if row["noise"] == noise]
    assert [row["ahead"] for row in rows] == pytest.approx([row["psnr"] - static[1] for row in rows])


def test_designs_are_measured_on_test_scenes(found):
    rows = rows_of_tests(found["test"], found["light"])
    assert len(rows) == len(CORNERS) * 10
    designed = [row for row in rows if row["codes"] in ("static, designed", "static, designed for the light")]
    assert all(row["gain"] == row["there"] == 0 for row in designed)
    assert all(10 < row["psnr"] < 60 for row in rows)


def test_gains_are_foretold_of_examples_dimmed_to_the_scene(found, folder):
    cell = {**_kept_cell(folder, "light"), "exposures": 1}
    bright, light = Task.of(cell), float(load_scene("coffee", bands=3).mean())
    there = Task.of(cell, light)
    assert there.examples.light == pytest.approx(min(light, bright.examples.most_light))
    static, free = (bright.design(kind, slots).camera for kind, slots in (("static", 1), ("free", 2)))
    errors = [there.examples.held_out(camera, there.noise.read, there.noise.shot) for camera in (static, free)]
    gain = np.mean([10 * np.log10(errors[0][name] / errors[1][name]) for name in SCENES])
    assert cell["there"]["free, designed"] == pytest.approx(gain, abs=1e-6)
    rows = [row for row in scene_rows(found["test"], found["light"]) if row["noise"] == cell["noise"]]
    own = next(row for row in rows if row["codes"] == "free, designed")
    assert own["miss"] == pytest.approx(own["gain"] - gain, abs=1e-6)


def test_what_light_foretold_is_what_codes_for_the_light_are_held_to():
    def told(gain, predicted):
        return {"psnr": 30 + gain, "expected_psnr": 0.0, "predicted_gain": predicted, "throughput": 0.1}

    lit = {"static, designed for the light": told(0, 0), "free, designed for the light": told(2.0, 3.0)}
    there = {"static, designed": 0, "free, designed": 2.5, "static, designed for the light": 0}
    cell = {"noise": "σ = 0.01", "scene": "coffee", "seed": 0}
    tested = {**cell, "metrics": {"static, designed": told(0, 0), "free, designed": told(1.0, 4.0)}}
    light = {**cell, "metrics": lit, "plain_prior": lit, "there": {**there, "free, designed for the light": 2.8}}
    rows = scene_rows([tested], [light])
    misses = {(row["codes"], row["prior"]): row["miss"] for row in rows}
    assert misses == {
        ("free, designed", "as learned"): pytest.approx(1.0 - 2.5),
        ("free, designed for the light", "as learned"): pytest.approx(2.0 - 3.0),
        ("free, designed for the light", "dimmed"): pytest.approx(2.0 - 3.0),
    }


def test_bars_that_are_missing_say_so():
    axis = Figure().add_subplot()
    _draw_bars(axis, {"one": {"σ = 0": 1.0, "σ = 1": 2.0}, "other": {"σ = 1": 3.0}}, ["σ = 0", "σ = 1"])
    left = [text for text in axis.texts if "not computed" in text.get_text()]
    assert [text.get_position() for text in left] == [(pytest.approx(0.2), 0)]


def test_codes_for_the_light_are_decoded_by_both_priors(found, folder):
    cell = _kept_cell(folder, "light")
    scene, prior = load_scene("coffee", bands=3), GaussianPrior.load(cell["prior"])
    camera = Task.of(cell, cell["light"]).design("free", 2).camera
    whole = on_frame(camera, {"bands": scene["wavelength"].values.tolist()}, scene.shape[1:], Sensor(**cell["sensor"]))
    taken = simulate(scene, whole, seed=cell["seed"])
    dimmed = prior.scaled(cell["light"] / float(prior.mean.mean()))
    for own, kept in ((prior, "plain_prior"), (dimmed, "metrics")):
        measured = reconstruct_snapshot(taken, "lmmse", prior=own, truth=scene).metrics["psnr"]
        assert cell[kept]["free, designed for the light"]["psnr"] == pytest.approx(measured, abs=1e-6)
    rows = [row for row in rows_of_tests(found["test"], found["light"]) if row["noise"] == cell["noise"]]
    assert [row["prior"] for row in rows] == ["as learned"] * 8 + ["dimmed"] * 2


def test_ranked_codes_are_expected_of_dimmed_examples_too(found, folder):
    cell = _kept_cell(folder, "there")
    there = Task.of(cell, cell["light"])
    code = ranks.coded(there, ranks.RANKED["random K = 4"])
    expected = -10 * np.log10(float(there.error.whole(code)))
    row = next(r for r in found["ranking"] if (r["noise"], r["codes"]) == (cell["noise"], "random K = 4"))
    assert row["expected_there"] == pytest.approx(expected, abs=1e-6)


def _kept_cell(folder, kind):
    cells = (json.loads(file.read_text()) for file in sorted((folder / "work").glob("*.json")))
    return next(cell for cell in cells if cell["kind"] == kind)


def test_the_order_of_codes_is_checked(found):
    assert len(ranks.RANKED) >= 20
    assert {row["codes"] for row in found["ranking"]} == set(ranks.RANKED)
    for entry in found["rank_correlation"]:
        own = [row for row in found["ranking"] if row["noise"] == entry["noise"]]
        means = [np.mean(list(row["lmmse"].values())) for row in own]
        first, second = (rankdata(v) for v in ([row["expected"] for row in own], means))
        assert entry["rank_correlation"] == pytest.approx(np.corrcoef(first, second)[0, 1])


def test_the_study_is_written_and_kept(found, folder):
    assert json.loads((folder / "out" / "codes.json").read_text())["grid"] == found["grid"]
    assert "prior of the others" in (folder / "out" / "codes.md").read_text()
    assert (folder / "out" / "codes_full_well.png").stat().st_size > 10_000
    with pytest.raises(OutputError, match=r"codes\.json"):
        study_codes(SCENES, [], folder / "out", folder / "work", **SMALL)
    told = []
    again = study_codes(
        SCENES, ["coffee"], folder / "out", folder / "work", overwrite=True, **SMALL,
        progress=lambda *step: told.append(step),
    )  # fmt: skip
    assert told == []
    assert again["grid"] == found["grid"]


def test_impossible_studies_are_refused(tmp_path):
    for changes in ({"slots": [1]}, {"slots": []}, {"seeds": 0}, {"test_slots": 1}, {"steps": -1}):
        with pytest.raises(SettingError, match="design study"):
            study_codes(SCENES, [], tmp_path, tmp_path / "work", **{**SMALL, **changes})
    with pytest.raises(SettingError, match="design study"):
        study_codes(SCENES[:1], [], tmp_path, tmp_path / "work", **SMALL)
    large = (
        ({"period": (0, 6)}, "0×6 pixels"),
        ({"period": (10**6, 6)}, "GB for the blocks"),
        ({"slots": [2**20]}, "code"),
    )
    for changes, words in large:
        with pytest.raises(SettingError, match=words):
            study_codes(SCENES, [], tmp_path, tmp_path / "work", **{**SMALL, **changes})
    assert not list(tmp_path.iterdir())


def test_ingredients_are_compared_with_the_static_design(found):
    assert [cell["noise"] for cell in found["ablation"]] == list(CORNERS)
    for cell in found["ablation"]:
        gains = {row["ingredient"]: row["gain"] for row in cell["rows"]}
        assert set(gains) == set(INGREDIENTS)
        assert gains["static, designed"] == 0
        assert gains["free, designed"] >= max(0, gains["one-hot shutter, designed"]) - 1e-4


def test_a_design_is_searched_once(tmp_path, monkeypatch):
    common = {**_common(SCENES, tmp_path, 3, (4, 6), Effort(2, 2, 0)), "sensor": {"read_noise": 0.01}}
    first = Task.of(common).design("free", 2)
    monkeypatch.setattr("tmca.experiments.codes.task.search", None)
    again = Task.of(common).design("free", 2)
    assert (again.mse, again.random, again.seconds) == (first.mse, first.random, first.seconds)
    for one, other in zip(first.camera.codes(), again.camera.codes(), strict=True):
        assert one.equal(other)
    assert Task.of(common).error.whole(again.camera) == pytest.approx(first.mse)


def test_networks_learn_behind_their_codes_and_tune_them_if_told(tmp_path):
    common = _common(SCENES, tmp_path, 3, (4, 6), Effort(2, 2, 0))
    common |= {"prior": str(prior_file(SCENES, tmp_path, 3))}
    trained = {"train": SCENES, "validation": ["motorcycle"]}
    cells = _network_cells(common, ["coffee"], trained, tmp_path, 2, 2, 1)
    found = []
    for cell in cells[: len(ranks.networks(2))]:
        found.append({**cell, **ranks.ranking({**cell, "size": [48, 48]})})
        kept = Weights.load(f"{cell['folder']}/run")
        assert kept.aperture.shape == (cell["code"]["slots"], 4, 6)
        assert kept.card["training"]["camera"]["learn"] == cell["code"].get("tune", "none")
    rows = network_rows(found)
    assert [row["codes"] for row in rows] == list(ranks.networks(2))
    assert next(row["gain"] for row in rows if row["codes"] == "static, designed") == 0
    mean = np.mean([*found[0]["unrolled"].values()])
    assert rows[0]["unrolled"] == pytest.approx(mean)
