"""The study of codes: the same effort for all, gains that are what they say, cells that are kept."""

import json

import numpy as np
import pytest

from tmca.decoders import Weights
from tmca.design import Effort
from tmca.errors import OutputError, SettingError
from tmca.experiments.codes_ranking import RANKED
from tmca.experiments.codes_study import CORNERS, _common, _prior, _ranking_cells, sensors, study_codes
from tmca.experiments.codes_tables import test_rows as rows_of_tests

SMALL = {"bands": 3, "slots": [2], "period": (4, 6), "effort": Effort(1, 3, 0), "test_slots": 2}
SCENES = ["tissue", "rocket"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("study")


@pytest.fixture(scope="module", autouse=True)
def small_scenes():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tmca.experiments.codes_study._RANKED_SIZE", (48, 48))
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


def test_designs_are_measured_on_test_scenes(found):
    rows = rows_of_tests(found["test"])
    assert len(rows) == len(CORNERS) * 6
    designed = [row for row in rows if row["codes"] == "static, designed"]
    assert all(row["gain"] == 0 for row in designed)
    assert all(10 < row["psnr"] < 60 for row in rows)


def test_the_order_of_codes_is_checked(found):
    assert len(RANKED) >= 20
    assert {row["codes"] for row in found["ranking"]} == set(RANKED)
    for entry in found["rank_correlation"]:
        own = [row for row in found["ranking"] if row["noise"] == entry["noise"]]
        means = [np.mean(list(row["lmmse"].values())) for row in own]
        first, second = (np.argsort(np.argsort(v)) for v in ([row["expected"] for row in own], means))
        assert entry["rank_correlation"] == pytest.approx(np.corrcoef(first, second)[0, 1])


def test_the_study_is_written_and_kept(found, folder):
    assert json.loads((folder / "out" / "codes.json").read_text())["grid"] == found["grid"]
    assert "scenes left out" in (folder / "out" / "codes.md").read_text()
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
    for changes in ({"slots": [1]}, {"slots": []}, {"seeds": 0}):
        with pytest.raises(SettingError, match="design study"):
            study_codes(SCENES, [], tmp_path, tmp_path / "work", **{**SMALL, **changes})
    with pytest.raises(SettingError, match="design study"):
        study_codes(SCENES[:1], [], tmp_path, tmp_path / "work", **SMALL)


def test_networks_of_ranked_codes_learn_behind_them(tmp_path):
    """A network for one code: its camera shows that code, and its estimate is measured."""
    from tmca.experiments import codes_ranking

    common = _common(SCENES, tmp_path, 3, (4, 6), Effort(1, 2, 0))
    cells = _ranking_cells(common, SCENES, ["coffee"], ["chelsea"], _prior(common, SCENES, tmp_path), tmp_path, 1)
    cell = next(c for c in cells if c["codes"] == "one-hot K = 2")
    found = codes_ranking.ranking(cell)
    assert set(found["unrolled"]) == {"coffee"}
    kept = Weights.load(f"{cell['folder']}/run")
    assert bool((kept.shutter.sum(0) == 1).all())
    assert kept.aperture.shape == (2, 4, 6)
