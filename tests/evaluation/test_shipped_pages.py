"""The pages under docs/results are what is made of the numbers beside them, and show the pictures there."""

import json
from pathlib import Path

import pytest

from tmca.evaluation.camera import evaluation_of
from tmca.evaluation.page import filled, markdown

RESULTS = Path(__file__).parents[2] / "docs" / "results"


@pytest.mark.parametrize("camera", ["spectral", "light-field", "spectral-depth"])
def test_a_shipped_page_tells_the_shipped_numbers(camera):
    numbers = json.loads((RESULTS / f"{camera}.json").read_text())
    page = markdown(numbers)
    assert page == (RESULTS / f"{camera}.md").read_text()
    assert numbers["pictures"]
    for file in numbers["pictures"]:
        assert f"]({file})" in page
        assert (RESULTS / file).exists()


def test_entries_of_the_results_are_filled_in_and_other_braces_stay():
    words = {"split": {"real scenes": "a, b"}}
    assert filled("{split[real scenes]}, {split[none]}, {split}, {x}", words) == "a, b, {split[none]}, {split}, {x}"


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
