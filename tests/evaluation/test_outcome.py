"""Results of a study as a dictionary, a table, bars and a few lines."""

import json

import pytest

from tmca.evaluation import StudyResults, checked_study


def row(code, decoder, psnr, sam):
    names = {"method": f"{code} + {decoder}", "code": code, "noise": "low", "decoder": decoder, "scenes": {}}
    return {**names, "psnr": psnr, "sam": sam, "ssim": psnr and psnr / 50}


ROWS = [row("static", "lmmse", 30.0, 5.0), row("one-hot", "lmmse", 32.5, 3.0), row("one-hot", "dagger", None, None)]
FOUND = {
    "study": {"name": "mine", "camera": "spectral", "codes": {"static": {}, "one-hot": {}}, "noises": {"low": {}},
              "decoders": ["lmmse", "dagger"]},
    "split": {"test": ["coffee"]},
    "rows": ROWS,
}  # fmt: skip
PSNR, SAM, SSIM = ("psnr", "PSNR (dB)", ".2f"), ("sam", "SAM (°)", ".2f"), ("ssim", "SSIM", ".2f")


def test_they_are_the_dictionary_of_the_file():
    results = StudyResults(FOUND, PSNR)
    assert results == FOUND
    assert json.loads(json.dumps(results)) == FOUND


@pytest.mark.parametrize(("column", "best"), [(PSNR, "32.50"), (SAM, "3.00"), (SSIM, "0.65")])
def test_the_best_row_is_told_and_drawn_first(column, best):
    results = StudyResults(FOUND, column)
    assert f"best: one-hot + lmmse: {column[1]} {best}" in repr(results)
    assert len(repr(results).splitlines()) <= 9
    (axes,) = results.plot().axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["one-hot + lmmse", "static + lmmse"]
    assert "data:image/png" in results._repr_html_()


def test_they_are_a_table():
    table = StudyResults(FOUND, PSNR).to_pandas()
    assert table["psnr"].tolist()[:2] == [30.0, 32.5]
    assert "scenes" not in table
    assert StudyResults(FOUND, PSNR).to_xarray()["code"].values.tolist() == ["static", "one-hot", "one-hot"]


def test_without_a_row_there_is_no_picture():
    empty = StudyResults({**FOUND, "rows": []}, PSNR)
    assert "rows: 0" in repr(empty)
    assert "<img" not in empty._repr_html_()


def test_a_study_says_what_it_compares():
    study = checked_study({
        "name": "mine", "camera": "spectral", "codes": {"static": {}}, "noises": {"low": {}}, "decoders": ["lmmse"],
        "scenes": {"test": ["coffee"]},
    }, "mine.yaml")  # fmt: skip
    assert repr(study).splitlines()[0] == "Study"
    assert "decoders: lmmse" in repr(study)
    assert len(repr(study).splitlines()) <= 6
