"""The study of codes: the same effort for all, gains that are what they say, cells that are kept."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from studies.codes import ablation as lacking
from studies.codes import ranking as ranks
from studies.codes import study as studied
from studies.codes.figures import study_figures
from studies.codes.records import Cell
from studies.codes.searches import task_of
from studies.codes.study import _first_cell, sensors, study_codes
from studies.codes.tables import scene_rows, study_markdown
from studies.codes.tables import test_rows as rows_of_tests
from tmca.data import load_scene, rendered_scene, select_bands, write_dataset
from tmca.design import Effort
from tmca.errors import OutputError, SettingError
from tmca.priors import GaussianMixturePrior

pytestmark = pytest.mark.slow
RESULTS = Path(__file__).parents[2] / "docs" / "results"
SMALL = {"bands": 3, "slots": [2], "period": (4, 6), "effort": Effort(2, 1, 10), "test_slots": 2}
SCENES = ["tissue", "rocket"]
RANKED = (
    "static, 20% open", "static, designed", "random K = 2", "one-hot K = 2, designed", "free K = 2, designed",
    "blue noise K = 4", "complementary K = 4", "S-matrix K = 7",
)  # fmt: skip
"""A code of every family."""
CORNERS = {name: studied.CORNERS[name] for name in ("σ = 0.01", "10 000 e⁻ full well, 3 e⁻ read noise")}
FEW = {"kinds": 2, "rank": 10, "gains": 2, "samples": 1000}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("study")


@pytest.fixture(scope="module", autouse=True)
def few_noises_and_small_scenes(files):
    learn = GaussianMixturePrior.learn
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ranks, "SIZE", (48, 48))
        patch.setattr(studied, "READ_NOISES", (0.001, 0.01))
        patch.setattr(studied, "FULL_WELLS", (1e4,))
        patch.setattr(studied, "CORNERS", CORNERS)
        patch.setattr(studied, "_RANKED_NOISES", ("σ = 0.01",))
        patch.setattr(studied, "RANKED", {name: ranks.RANKED[name] for name in RANKED})
        patch.setattr(studied, "split_rendered", lambda: {"train": [files["chelsea"]]})
        patch.setattr(GaussianMixturePrior, "learn", lambda *given, **how: learn(*given, **how | FEW))
        patch.setitem(lacking.INGREDIENTS, "free, one descent, tile of 32×48", lacking._of_period(12, 12))
        yield


def test_the_page_is_made_from_its_results_with_pictures(tmp_path):
    stored = json.loads((RESULTS / "codes.json").read_text())
    assert study_markdown(stored) == (RESULTS / "codes.md").read_text()
    for file in study_figures(stored, tmp_path):
        assert (RESULTS / file.name).exists()


@pytest.fixture(scope="module")
def files(folder):
    """Small scenes, by name."""
    made, place = {}, folder / "scenes"
    place.mkdir()
    for name in (*SCENES, "chelsea", "coffee"):
        scene = rendered_scene(name, size=(64, 64))["radiance"]
        made[name] = str(write_dataset(select_bands(scene, 3), place / f"{name}.nc"))
    return made


@pytest.fixture(scope="module")
def asked(files, folder):
    return [files[name] for name in SCENES], [files["coffee"]], folder / "out", folder / "work"


@pytest.fixture(scope="module")
def found(asked):
    return study_codes(*asked, **SMALL)


@pytest.mark.slow
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


@pytest.mark.slow
def test_designs_are_measured_on_test_scenes(found):
    rows = rows_of_tests(found["test"], found["light"])
    assert len(rows) == len(CORNERS) * 10
    designed = rows[rows.codes.isin(["static, designed", "static, designed for the light"])]
    assert not designed[["gain", "there"]].any(axis=None)
    assert rows.psnr.between(10, 60).all()


@pytest.mark.slow
def test_gains_are_predicted_of_examples_dimmed_to_the_scene(found, files, folder):
    cell, (row,) = _stored_cell(folder, "light")
    bright, light = task_of(cell), float(load_scene(files["coffee"], bands=3).mean())
    there = task_of(cell, light)
    assert there.examples.light == pytest.approx(min(light, bright.examples.most_light))
    static, free = (bright.design(kind, slots).camera for kind, slots in (("static", 1), ("free", 2)))
    errors = [there.examples.held_out(camera, there.noise.read, there.noise.shot) for camera in (static, free)]
    gain = np.mean([10 * np.log10(errors[0][name] / errors[1][name]) for name in SCENES])
    assert row["there"]["free, designed"] == pytest.approx(gain, abs=1e-6)
    rows = scene_rows(found["test"], found["light"])
    line = rows[(rows.noise == cell.noise) & (rows.codes == "free, designed")].iloc[0]
    assert line.miss == pytest.approx(line.gain - gain, abs=1e-6)


def _stored_cell(folder, kind, **named):
    """A finished cell of a kind and its rows."""
    for file in sorted((folder / "work").glob("*.json")):
        stored = json.loads(file.read_text())
        if stored["kind"] == kind and all(stored[name] == value for name, value in named.items()):
            rows, _ = stored.pop("rows"), stored.pop("digest")
            return Cell.of(stored), rows
    raise AssertionError(kind)


@pytest.mark.slow
def test_the_study_is_written_and_kept(found, asked, files, folder):
    assert json.loads((folder / "out" / "codes.json").read_text())["grid"] == found["grid"]
    assert "prior of the others" in (folder / "out" / "codes.md").read_text()
    assert (folder / "out" / "codes_full_well.png").stat().st_size > 10_000
    with pytest.raises(OutputError, match=r"codes\.json"):
        study_codes(asked[0], [], folder / "out", folder / "work", **SMALL)
    told = []
    again = study_codes(*asked, overwrite=True, **SMALL, progress=lambda *step: told.append(step))
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


def test_a_design_is_searched_once(files, folder, tmp_path, monkeypatch):
    base = _first_cell([files[name] for name in SCENES], folder / "work", 3, (4, 6), Effort(2, 2, 0))
    cell = replace(base, sensor={"read_noise": 0.01}, designs=str(tmp_path))
    first = task_of(cell).design("free", 2)
    monkeypatch.setattr("tmca.design.task.search", None)
    again = task_of(cell).design("free", 2)
    assert (again.mse, again.random, again.seconds) == (first.mse, first.random, first.seconds)
    for one, other in zip(first.camera.codes(), again.camera.codes(), strict=True):
        assert one.equal(other)
    assert task_of(cell).error.whole(again.camera) == pytest.approx(first.mse)
