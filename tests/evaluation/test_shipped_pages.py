"""The pages under docs/results are what is made of the numbers beside them, and show the pictures there."""

import json
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from tmca.evaluation.camera import evaluation_of
from tmca.evaluation.gains import margins
from tmca.evaluation.overview import overview, overview_figure
from tmca.evaluation.page import filled, markdown
from tmca.evaluation.study import checked_study, read_study

RESULTS = Path(__file__).parents[2] / "docs" / "results"
STUDIES = ["spectral", "light-field", "spectral-depth", *(file.stem for file in sorted(RESULTS.glob("*.json")) if
           file.stem.startswith(("buckets", "moving")))]  # fmt: skip


@pytest.mark.parametrize("study", STUDIES)
def test_a_shipped_page_tells_the_shipped_numbers(study):
    numbers = json.loads((RESULTS / f"{study}.json").read_text())
    page = markdown(numbers)
    assert "\nTraining scenes: " in page
    assert page == (RESULTS / f"{study}.md").read_text()
    assert bool(numbers["pictures"]) == (study in ("spectral", "light-field", "spectral-depth"))
    for file in (*numbers["pictures"], f"{study}_glance.png"):
        assert f"]({file})" in page
        assert (RESULTS / file).exists()


def test_at_a_glance_every_row_has_its_metric_and_its_gain_over_the_best_code_of_one_slot():
    numbers = json.loads((RESULTS / "buckets.json").read_text())
    study = checked_study(numbers["study"], "buckets")
    figure = overview_figure(numbers, study)
    (axis,) = figure.axes
    gains, (section,) = axis.images[0].get_array(), overview(numbers, study)
    psnr = {(row["code"], row["noise"]): row["psnr"] for row in numbers["rows"]}
    for row, column in product(range(len(study.codes)), range(len(study.noises))):
        code, noise = [*study.codes][row], [*study.noises][column]
        best = max(psnr[name, noise] for name in ("static, random", "static, designed"))
        assert gains[row, column] == pytest.approx(psnr[code, noise] - best)
        assert section.table[row][noise] == psnr[code, noise]
    (bar,) = axis.child_axes
    assert bar.get_ylabel() == "gain (dB)"
    shades = {text.get_text(): text.get_color() for text in axis.texts}
    assert (shades["46.64"], shades["38.25"]) == ("white", "black")
    assert "full well,\n3\N{NO-BREAK SPACE}e⁻ read\nnoise" in axis.get_xticklabels()[5].get_text()
    assert "with the same decoder" in figure.get_suptitle().replace("\n", " ")


def test_entries_of_the_results_are_filled_in_and_other_braces_stay():
    words = {"split": {"real scenes": "a, b"}}
    assert filled("{split[real scenes]}, {split[none]}, {split}, {x}", words) == "a, b, {split[none]}, {split}, {x}"


def test_a_burst_is_no_time_multiplexed_code_and_searches_choose_without_a_test_scene():
    numbers = json.loads((RESULTS / "buckets.json").read_text())
    study = checked_study(numbers["study"], "buckets")
    rows = margins(numbers, study)
    assert {row["against"] for row in rows} == {"one slot", *study.bases}
    assert not any(study.codes[row["best"]].burst or study.codes[row["best"]].one_slot for row in rows)
    assert all(study.codes[row["base"]].one_slot for row in rows if row["against"] == "one slot")
    for row in rows:
        expected = {one["code"]: one["psnr"] for one in numbers["searches"] if one["noise"] == row["noise"]}
        several = {
            code: psnr for code, psnr in expected.items() if study.codes[code].search.kind in ("free", "two-bucket")
        }
        assert row["best"] == max(several, key=several.get)


@pytest.mark.parametrize("file", sorted((RESULTS.parents[1] / "studies").glob("*.yaml")), ids=lambda file: file.stem)
def test_a_study_beside_the_package_can_be_read(file):
    assert read_study(file).codes


def test_trainings_without_validation_tell_nothing_of_their_codes():
    trainings = [{"decoder": "unet", "code": code, "best": {"psnr": best}} for code, best in (("a", None), ("b", 30.0))]
    assert evaluation_of("spectral").scores({"budget": {"training": trainings}}, "unet", "") == {"b": -30.0}


def test_a_table_says_which_rows_are_not_meaningful():
    numbers = json.loads((RESULTS / "spectral.json").read_text())
    assert "not meaningful" not in markdown(numbers)
    row = numbers["rows"][0]
    next(iter(row["scenes"].values()))["psnr"] = -177.0
    text = f"Warning: 1 row ({row['decoder']}) of this table fell below 0 dB of PSNR: not meaningful"
    assert markdown(numbers).count(text) == 1


def test_at_a_glance_bears_rows_that_failed_and_studies_without_a_code_of_one_slot():
    numbers = json.loads((RESULTS / "buckets.json").read_text())
    study = checked_study(numbers["study"], "buckets")
    without = [row for row in numbers["rows"] if not study.codes[row["code"]].one_slot]
    failed = [row for row in numbers["rows"] if row["noise"] != "σ = 0.1" or not study.codes[row["code"]].one_slot]
    assert np.isnan(
        overview_figure(numbers | {"rows": failed}, study).axes[0].images[0].get_array().filled(np.nan)
    ).any()
    assert overview_figure(numbers | {"rows": without}, study).axes[0].images[0].get_array().min() < 0
    nothing = [{name: value for name, value in row.items() if name != "psnr"} for row in numbers["rows"]]
    assert not list(overview(numbers | {"rows": nothing}, study))
