"""Sweeps: every combination once, failed ones named, impossible ones refused before any work."""

import csv
import json

import pytest

from tmca.applications import evaluate, simulate
from tmca.cameras import LightFieldCamera
from tmca.data import rendered_scene, select_bands, write_dataset
from tmca.data.light_field_scenes import load_light_field
from tmca.decoders import decode
from tmca.errors import DataError, OutputError, SettingError
from tmca.evaluation.grid import CellsFailed
from tmca.evaluation.sweep import Sweep, run_sweep


def sweep(folder, vary, scenes=("coffee",), bands=4, size=(24, 32), overwrite=False, progress=None, **changes):
    options = {"reading": {"bands": bands, "size": size}, "decoder": "admm-tv"} | changes
    asked = Sweep("spectral", vary, scenes, **options)
    return run_sweep(asked, folder / "out", folder / "work", overwrite=overwrite, progress=progress)


@pytest.mark.slow
def test_every_combination_is_measured_once_and_kept(tmp_path):
    told = []
    vary = {"noise": [0.0, 0.05], "slots": [1, 2]}
    found = sweep(tmp_path, vary, progress=lambda done, total, name, left: told.append(name))
    assert [(row["noise"], row["slots"]) for row in found["rows"]] == [(0.0, 1), (0.0, 2), (0.05, 1), (0.05, 2)]
    assert found["rows"][0]["psnr"] > found["rows"][2]["psnr"]
    assert len(told) == 4
    assert json.loads((tmp_path / "out.json").read_text())["rows"] == found["rows"]
    with (tmp_path / "out.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["psnr"]) for row in rows] == [row["psnr"] for row in found["rows"]]
    assert (tmp_path / "out.png").stat().st_size > 1000
    again = sweep(tmp_path, vary, progress=lambda done, total, name, left: told.append(name))
    assert again["rows"] == found["rows"]
    assert len(told) == 4
    with pytest.raises(OutputError, match=r"results of another sweep \(other vary\).*--overwrite"):
        sweep(tmp_path, {"noise": [0.0]})


def test_a_failed_cell_is_named_and_the_others_are_kept(tmp_path):
    lost = write_dataset(small_cube(), tmp_path / "lost.nc")
    with pytest.raises(CellsFailed, match=r"1 of 2.*lost"):
        sweep(tmp_path, {"slots": [1]}, ["coffee", str(lost)], progress=lambda *told: lost.unlink(missing_ok=True))
    assert not (tmp_path / "out.md").exists()
    told = []
    sweep(tmp_path, {"slots": [1]}, ["coffee"], progress=lambda done, total, name, left: told.append(name))
    assert told == []


@pytest.mark.parametrize("what", ["scenes", "train", "validation"])
def test_a_scene_that_cannot_be_read_is_named_before_anything_is_made(tmp_path, what):
    broken = tmp_path / "broken.nc"
    for words in ("no such file", "truncated"):
        changes = {"scenes": ["coffee"], "train": ["astronaut"], "validation": ["chelsea"], what: [str(broken)]}
        with pytest.raises(DataError, match=f"broken.nc: .*{words}"):
            sweep(tmp_path, {"slots": [1]}, changes.pop("scenes"), **changes)
        broken.write_bytes(b"\x89HDF\r\n\x1a\n truncated")
    with pytest.raises(SettingError, match="crop"):
        sweep(tmp_path, {"slots": [1]}, size=(9999, 9999))
    assert list(tmp_path.iterdir()) == [broken]


def test_a_scene_that_changes_is_measured_anew(tmp_path):
    paths = [str(write_dataset(cube, tmp_path / "a.nc")) for cube in (small_cube(),)]
    first = sweep(tmp_path, {"slots": [1]}, paths)
    write_dataset(0.5 * small_cube(), tmp_path / "a.nc", overwrite=True)
    second = sweep(tmp_path, {"slots": [1]}, paths, overwrite=True)
    assert first["rows"][0]["psnr"] != second["rows"][0]["psnr"]


def test_scenes_of_one_name_stay_apart(tmp_path):
    paths = []
    for folder, scale in (("a", 1.0), ("b", 0.3)):
        (tmp_path / folder).mkdir()
        paths.append(str(write_dataset(scale * small_cube(), tmp_path / folder / "x.nc")))
    found = sweep(tmp_path, {"slots": [1]}, paths)
    assert len(found["rows"][0]["scenes"]) == 2
    with pytest.raises(SettingError, match="twice"):
        sweep(tmp_path, {"slots": [1]}, [paths[0], paths[0]], overwrite=True)


def small_cube():
    return select_bands(rendered_scene("tissue", size=(40, 48))["radiance"], 4)


@pytest.mark.slow
def test_a_network_is_trained_once_for_all_scenes(tmp_path):
    train = ["astronaut", "chelsea", "rocket"]
    changes = {"decoder": "unet-thesis", "steps": 1, "bands": 2, "size": (64, 64), "train": train}
    found = sweep(tmp_path, {"slots": [1]}, ["coffee", "motorcycle"], **changes)
    assert set(found["rows"][0]["scenes"]) == {"coffee", "motorcycle"}
    assert len(list((tmp_path / "work").glob("training-*"))) == 1


def light_fields(folder, vary, views=3, **changes):
    for name in ("rocket", "coffee"):
        if not (folder / f"{name}.nc").exists():
            field = load_light_field(name, views=3, size=(26, 28))
            field.to_dataset(name="light_field").to_netcdf(folder / f"{name}.nc")
    options = {"reading": {"views": views}, "train": [str(folder / "rocket.nc")]} | changes
    asked = Sweep("light-field", vary, [str(folder / "coffee.nc")], **options)
    return run_sweep(asked, folder / "out", folder / "work")


def test_light_fields_are_swept_with_named_codes(tmp_path):
    fixed = {"shutter": "one-hot", "period": 4}
    found = light_fields(tmp_path, {"slots": [2, 4], "noise": [0.0, 0.1]}, fixed=fixed)
    assert [(row["slots"], row["noise"]) for row in found["rows"]] == [(2, 0.0), (2, 0.1), (4, 0.0), (4, 0.1)]
    camera = LightFieldCamera(3, (26, 28), 4, shutter="one-hot", period=4)
    truth = load_light_field(str(tmp_path / "coffee.nc"), views=3)
    (prior,) = (tmp_path / "work").glob("prior-*.nc")
    own = evaluate(decode(simulate(truth, camera), prior=prior), truth)
    assert found["rows"][2]["psnr"] == pytest.approx(own["psnr"], abs=1e-4)
    assert "SAM" not in (tmp_path / "out.md").read_text()
    assert "Light-field camera" in (tmp_path / "out.md").read_text()


@pytest.mark.slow
def test_codes_are_searched_for_every_combination(tmp_path):
    effort = {"descents": 1, "steps": 20, "flips": 100}
    found = light_fields(tmp_path, {"noise": [0.0, 1.0]}, fixed={"slots": 2, "design": "one-hot"}, effort=effort)
    assert len(list((tmp_path / "work" / "designs").glob("one-hot-2-*.nc"))) == 2
    quiet, loud = (row["throughput"] for row in found["rows"])
    assert loud > quiet


@pytest.mark.parametrize(
    ("vary", "fixed", "words"),
    [
        ({"dispersion": [1]}, {}, "one of"),
        ({"slots": [2]}, {"decoder": "unet"}, "unet"),
        ({"design": ["pretty"]}, {}, "design.*pretty.*free"),
        ({"design": ["free"]}, {"shutter": "open"}, "shutter"),
        ({"shear": ["nan"]}, {}, "finite"),
    ],
)
def test_impossible_light_field_sweeps_are_refused_before_any_work(tmp_path, vary, fixed, words):
    with pytest.raises(SettingError, match=words):
        light_fields(tmp_path, vary, fixed=fixed)
    with pytest.raises(SettingError, match="odd"):
        light_fields(tmp_path, {"slots": [2]}, views=4)
    assert not (tmp_path / "work").exists()


@pytest.mark.parametrize(
    ("vary", "words"),
    [
        ({}, "nothing"), ({"slotz": [1]}, "slotz"), ({"slots": []}, "slots"), ({"slots": [2, 2]}, "different"),
        ({"slots": [0]}, "slots"), ({"noise": [-1]}, "read_noise"), ({"decoder": ["magic"]}, "magic"),
        ({"shutter": ["onehot"]}, "onehot"), ({"slots": ["2.5"]}, "whole"), ({"noise": ["nan"]}, "finite"),
        ({"decoder.tv_weight": [1]}, "decoder.tv_weight"), ({"buckets": ["1.5"]}, "whole"),
        ({"dispersion": ["wide"]}, "numbers"), ({"noise": [0.1], "read_noise": [0.1]}, "one of them"),
    ],
)  # fmt: skip
def test_impossible_grids_are_refused_before_anything_is_computed(tmp_path, vary, words):
    with pytest.raises(SettingError, match=words):
        sweep(tmp_path, vary, decoder="lmmse")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("fixed", [{"slots": 2}, {"colour": 2}, {"seed": "a"}])
def test_impossible_fixed_settings_are_refused(tmp_path, fixed):
    with pytest.raises(SettingError):
        sweep(tmp_path, {"slots": [1, 2]}, fixed=fixed)


def test_values_may_be_text_as_on_the_command_line(tmp_path):
    found = sweep(tmp_path, {"noise": ["1e-2"], "slots": ["4.0"], "buckets": ["2"]})
    assert [found["rows"][0][name] for name in ("noise", "slots", "buckets")] == [0.01, 4, 2]


@pytest.mark.slow
def test_a_static_design_stands_beside_those_of_several_slots(tmp_path):
    effort = {"descents": 1, "steps": 5, "flips": 0}
    found = light_fields(tmp_path, {"slots": [2, 4], "design": ["static", "one-hot"]}, effort=effort)
    assert len(list((tmp_path / "work" / "designs").glob("static-1-*.nc"))) == 1
    rows = {(row["slots"], row["design"]): row["psnr"] for row in found["rows"]}
    assert rows[2, "static"] == pytest.approx(rows[4, "static"])
    assert rows[2, "one-hot"] != pytest.approx(rows[4, "one-hot"])
