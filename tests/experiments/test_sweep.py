"""Sweeps: every combination once, failed ones named, impossible ones refused before any work."""

import csv
import json

import pytest

from tmca.errors import SettingError
from tmca.experiments.cells import CellsFailed
from tmca.experiments.sweep_spectral import combinations, sweep_spectral


def sweep(folder, vary, scenes=("coffee",), **changes):
    options = {"bands": 4, "size": (24, 32), "decoder": "admm-tv"} | changes
    return sweep_spectral(vary, scenes, folder / "out", folder / "work", **options)


def test_every_combination_is_measured_once_and_kept(tmp_path):
    told = []
    vary = {"noise": [0.0, 0.05], "slots": [1, 2]}
    found = sweep(tmp_path, vary, progress=lambda done, total, name: told.append(name))
    assert [(row["noise"], row["slots"]) for row in found["rows"]] == [(0.0, 1), (0.0, 2), (0.05, 1), (0.05, 2)]
    assert found["rows"][0]["psnr"] > found["rows"][2]["psnr"]
    assert len(told) == 4
    assert json.loads((tmp_path / "out.json").read_text())["rows"] == found["rows"]
    with (tmp_path / "out.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["psnr"]) for row in rows] == [row["psnr"] for row in found["rows"]]
    assert (tmp_path / "out.png").stat().st_size > 1000
    again = sweep(tmp_path, vary, overwrite=True, progress=lambda done, total, name: told.append(name))
    assert again["rows"] == found["rows"]
    assert len(told) == 4


def test_a_failed_cell_is_named_and_the_others_are_kept(tmp_path):
    with pytest.raises(CellsFailed, match=r"1 of 2.*nowhere"):
        sweep(tmp_path, {"slots": [1]}, ["nowhere.mat", "coffee"])
    told = []
    sweep(tmp_path, {"slots": [1]}, ["coffee"], progress=lambda done, total, name: told.append(name))
    assert told == []


@pytest.mark.parametrize(
    ("vary", "words"),
    [
        ({}, "nothing"),
        ({"slotz": [1]}, "slotz"),
        ({"slots": []}, "slots"),
        ({"slots": [2, 2]}, "different"),
        ({"slots": [0]}, "slots"),
        ({"noise": [-1]}, "read_noise"),
        ({"decoder": ["magic"]}, "magic"),
        ({"shutter": ["onehot"]}, "onehot"),
    ],
)
def test_impossible_grids_are_refused_before_anything_is_computed(vary, words):
    with pytest.raises(SettingError, match=words):
        combinations(vary, {"decoder": "lmmse"})


def test_a_network_is_trained_once_for_all_scenes(tmp_path):
    changes = {"decoder": "unet-thesis", "steps": 1, "bands": 2, "size": (64, 64)}
    found = sweep(tmp_path, {"slots": [1]}, ["coffee", "motorcycle"], **changes)
    assert set(found["rows"][0]["scenes"]) == {"coffee", "motorcycle"}
    assert len(list((tmp_path / "work").glob("point-*"))) == 1
