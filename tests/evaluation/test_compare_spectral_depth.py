"""The spectral-depth table, small: its rows, margins, resumption, refusals and pictures."""

import json

import numpy as np
import pytest
import torch
import xarray as xr

from tests.cli.refusals import refused
from tmca.cameras import SpectralDepthCamera
from tmca.data import label, split_rendered, write_dataset
from tmca.data.depth_scenes import withheld_scene
from tmca.evaluation.expected import order
from tmca.evaluation.gains import margins
from tmca.evaluation.page import markdown, sections
from tmca.evaluation.plan import Plan
from tmca.evaluation.run import run_study
from tmca.evaluation.study import checked_study, read_study, training_of

pytestmark = pytest.mark.filterwarnings("ignore::tmca.optics.StrayLight")  # masks of two steps are rough
SHOWN = ("diffractive element only, optimised", "TMCA random K = 4", "diffractive element only, learned")
SHIPPED = read_study("spectral-depth")


def small(codes=None, **changes):
    """The shipped study on small scenes, some of its codes."""
    about = SHIPPED.model_dump()
    about["codes"] = {name: code for name, code in about["codes"].items() if codes is None or name in codes}
    about["reading"] |= {"side": 68, "crop": (32, 36)}
    about["options"], about["search"] = (
        {"likelihood": {"window": 8}},
        {"searched": 4, "effort": {"starts": 1, "steps": 1}},
    )
    about["train"]["settings"]["data"]["patch"], about["train"]["steps"] = 32, 1
    if codes:
        about["codes"][codes[0]]["train"] = False
    return checked_study(about, "small").with_(**changes)


def scene(path, seed, size=(68, 72)):
    """A textured cube (8, *size) before a slope."""
    source = torch.Generator().manual_seed(seed)
    coarse = torch.rand(1, 8, 20, 22, generator=source)
    fine = torch.nn.functional.interpolate(coarse, size=size, mode="bicubic").clamp(0, 1)[0]
    waves = np.array(SpectralDepthCamera.from_preset("quick", size=(32, 32)).wavelengths)
    depth = (1 / np.linspace(0.6, 2.4, size[1])[None].repeat(size[0], 0)).astype(np.float32)
    whole = xr.Dataset({"radiance": label(fine.numpy(), waves), "depth": (("y", "x"), depth, {"units": "m"})})
    return str(write_dataset(whole, path))


@pytest.fixture
def scenes(tmp_path):
    return [scene(tmp_path / f"{name}.nc", seed) for seed, name in enumerate(("learned", "measured"))]


def compare(tmp_path, scenes, **how):
    lists = {"train": scenes[:1], "test": scenes[1:]}
    study = small(SHOWN, scenes=lists, decoders=["likelihood", "two-headed"])
    return run_study(study, tmp_path / "out", tmp_path / "work", **how)


@pytest.mark.slow
def test_every_code_noise_and_decoder_has_a_row(tmp_path, scenes, monkeypatch):
    begun = []
    found = compare(tmp_path, scenes, progress=lambda done, total, name, left: begun.append(name))
    assert begun[0] == "gaussian prior"
    rows = {(row["code"], row["noise"], row["decoder"]): row for row in found["rows"]}
    noises = {row["noise"] for row in found["rows"]}
    wanted = {(code, noise, "likelihood") for code in SHOWN for noise in noises}
    wanted |= {(code, noise, "two-headed") for code in SHOWN[1:] for noise in noises}
    assert set(rows) == wanted
    moved, start = (rows[code, "σ = 0.002", "likelihood"]["psnr"] for code in (SHOWN[2], SHOWN[0]))
    assert abs(moved - start) > 1e-3  # the learned masks are others than those they began with
    assert json.loads((tmp_path / "out" / "spectral-depth.json").read_text())["rows"] == found["rows"]
    page = (tmp_path / "out" / "spectral-depth.md").read_text()
    assert page == markdown(found)
    assert all(code in page for code in SHOWN)
    assert {file.name for file in (tmp_path / "out").glob("*.png")} == {"spectral-depth_glance.png"} | {
        "spectral-depth_fisher.png", "spectral-depth_measured.png"
    }  # fmt: skip
    assert {(row["code"], row["noise"]) for row in found["predicted"]} == {(c, n) for c in SHOWN for n in noises}
    assert all(row["confusion"] > 0 and row["psnr"] > 0 and row["fisher"] > 0 for row in found["predicted"])
    assert all(0.3 < row["arrived"] <= 1 for row in found["rows"])
    (search,) = found["searches"]
    assert search["seconds"] > 0
    assert f"| {SHOWN[2]} | {SHOWN[0]} | patch likelihood |" in page.split("## Codes over others")[1]
    assert "a rendered scene and" in page
    guess = found["guess"]["measured"]
    assert guess["known_depth"] == 1
    with xr.open_dataset(scenes[1]) as truth:
        inverse = 1 / truth["depth"].values
    fitted = 0.5 + 2.0 * (inverse - inverse.min()) / np.ptp(inverse)  # affine in inverse metres, onto 0.4 to 2 m
    middle = 1 / fitted[18:50, 18:54]
    assert guess["depth_mae"] == pytest.approx(float(np.abs(middle - 2 / 3).mean()), rel=1e-3)
    monkeypatch.setattr("tmca.evaluation.run.write_pictures", lambda *results, **how: None)
    told = []
    compare(tmp_path, scenes, overwrite=True, progress=lambda done, total, name, left: told.append(name))
    assert not told  # all cells were kept


STATIC = {"slots": 1, "shutter": "open", "filters": "clear"}
FEW = {  # planes, and pixels: too few to judge masks on examples
    "camera": "spectral-depth", "page": True, "reading": {"side": 36, "crop": (16, 18)}, "settings": {"planes": 3},
    "codes": {"drawn": {"camera": STATIC}, "searched": {"camera": STATIC, "search": {"noise": "some"}}},
    "noises": {"some": {"read_noise": 0.002}}, "decoders": ["likelihood"], "options": {"likelihood": {"window": 4}},
    "search": {"searched": 2, "effort": {"starts": 1, "steps": 2}}, "shown": None, "shown_noise": "some",
}  # fmt: skip


@pytest.mark.slow
def test_searched_masks_are_measured_and_predicted_as_their_file_has_them(tmp_path):
    learned, measured = (scene(tmp_path / f"{n}.nc", k, (36, 40)) for k, n in enumerate(("learned", "measured")))
    study = checked_study({**FEW, "name": "few", "scenes": {"train": [learned], "test": [measured]}}, "few")
    found = run_study(study, tmp_path / "out", tmp_path / "work")
    (search,), predicted = found["searches"], {row["code"]: row for row in found["predicted"]}
    for name, figures in (("searched", "optimised"), ("drawn", "random")):
        distances = np.array(search["predicted"][figures]["kullback_leibler"]) + np.diag([np.inf] * 3)
        assert predicted[name]["kullback_leibler"] == pytest.approx(distances.min(1).mean(), rel=1e-3)
        fisher = np.log(search["predicted"][figures]["fisher"]).mean()
        assert np.log(predicted[name]["fisher"]) == pytest.approx(fisher, rel=1e-3)
    assert predicted["searched"]["confusion"] == pytest.approx(search["confusion"], rel=1e-3)
    assert predicted["searched"]["confusion"] < predicted["drawn"]["confusion"]
    assert "placed" not in predicted["searched"]
    inverse = np.linspace(0.5, 2.5, 40)[11:29]  # inverse metres of what is measured, onto the range of the design
    guess = float(np.abs(1 / inverse - 2 / 3).mean())
    assert found["guess"]["measured"]["depth_mae"] == pytest.approx(guess, rel=1e-3)
    assert all(row["depth_mae"] < guess for row in found["rows"])
    out = tmp_path / "out"
    assert {file.name for file in out.glob("*.png")} == {"few_fisher.png", "few_measured.png"}
    page = (out / "few.md").read_text()
    assert page == markdown(json.loads((out / "few.json").read_text()))
    assert "![Colours, depth and spectra behind every code (measured)](few_measured.png)" in page


CHOSEN = {  # depth error on test scenes, PSNR, and the error that chooses
    "diffractive element only, random": (0.35, 31.0, 2.0),
    "diffractive element only, optimised": (0.4, 30.0, 1.0),
    "static mask + CCA, optimised": (0.3, 31.0, 0.9),
    "TMCA random K = 4": (0.12, 30.5, 0.5),
    "TMCA optimised K = 4": (0.15, 30.2, 0.2),
    "TMCA learned K = 4": (0.1, 30.0, None),
}


def results(rows, predicted=(), training=()):
    study, split = SHIPPED.model_dump(mode="json"), {"test": ["a"], "real": ["a"]}
    found = {"study": study, "rows": rows, "searches": [], "guess": {}, "predicted": [*predicted], "split": split}
    return found | {"budget": {"training": [*training]}}


def made(decoder, levels):
    """Rows of depth errors and PSNR by codes."""
    return [
        {"code": code, "noise": "n", "decoder": decoder, "seed_depth_mae": [mae - 0.05, mae + 0.05],
         "scenes": {"a": {"depth_mae": mae, "psnr": psnr}}}
        for code, (mae, psnr, *_) in levels.items()
    ]  # fmt: skip


@pytest.mark.parametrize("decoder", ["likelihood", "physics"])
def test_margins_compare_codes_that_are_chosen_without_a_test_scene(decoder):
    rows, judged = made(decoder, CHOSEN), {code: error for code, (_, _, error) in CHOSEN.items() if error is not None}
    predicted = [{"code": code, "noise": "n", "placed": error, "flat": -error} for code, error in judged.items()]
    trained = [
        {"code": code, "decoder": decoder, "cpu_seconds": 1.0, "best": {"depth_mae": error + seed}}
        for code, error in judged.items() for seed in (0.1, -0.1)
    ]  # fmt: skip
    parts = (predicted,) if decoder == "likelihood" else ((), trained)
    static, alone = margins(results(rows, *parts), SHIPPED)
    assert (static["against"], alone["against"]) == ("one slot", "the mask alone")
    assert (static["best"], static["base"]) == ("TMCA optimised K = 4", "static mask + CCA, optimised")
    assert static["gain"] == pytest.approx(0.5)
    assert static["seeds"] == "0.40, 0.57"
    assert alone["gain"] == pytest.approx(0.15 / 0.4)
    assert alone["psnr"] == pytest.approx(0.2)
    assert static["hindsight"] == pytest.approx(0.1 / 0.3)
    assert alone["hindsight"] == pytest.approx(0.1 / 0.35)


def test_static_rows_have_as_much_time():
    """As many times the descents and steps as a static mask is cheaper; codes that stay as they are have no more."""
    codes = SHIPPED.codes
    assert codes["diffractive element only, free-form, optimised"].search.starts == 4
    assert codes["TMCA optimised K = 4"].search.starts == 1
    study = small(train__steps=10)

    def training(code, **how):
        return training_of(study, code, "two-headed", 0, {}, "start", **how)

    for learns, steps in ((True, 50), (False, 10)):
        assert training("diffractive element only, learned", learns=learns)["optimiser"]["steps"] == steps
    assert training("TMCA learned K = 4")["optimiser"]["steps"] == 10
    assert training("diffractive element only, free-form, learned")["camera"]["mask"] == "free-form"


def test_learned_codes_stand_beside_their_start_and_their_static_case():
    levels = {"TMCA optimised K = 4": (0.2, 30.0), "TMCA learned K = 4": (0.15, 31.0),
              "diffractive element only, learned": (0.3, 29.0)}  # fmt: skip
    tables = {one.title: one.table for one in sections(results(made("two-headed", levels)), SHIPPED)}
    start, static = tables["Codes over others"]
    assert (start["code"], start["base"]) == ("TMCA learned K = 4", "TMCA optimised K = 4")
    assert (start["gain"], start["psnr"]) == pytest.approx((0.75, 1.0))
    assert (static["gain"], static["psnr"]) == pytest.approx((0.5, 2.0))


def test_the_right_order_is_one_and_the_opposite_minus_one():
    def told(code, mae, psnr):
        right = {"confusion": mae, "fisher": -mae, "kullback_leibler": mae, "psnr": psnr + 10}
        measured = {"likelihood": {"depth_mae": mae, "psnr": psnr}, "physics": {"depth_mae": -mae, "psnr": psnr}}
        return {"code": code, "noise": "n", **right, "measured": measured}

    labels = SHIPPED.decoder_labels
    first, second = order({"predicted": [told("a", 0.3, 20.0), told("b", 0.1, 25.0), told("c", 0.2, 30.0)]}, labels)
    right = dict.fromkeys(("confusion", "fisher", "psnr"), pytest.approx(1))
    assert first == {"noise": "n", "decoder": "patch likelihood", "codes": 3, **right,
                     "kullback_leibler": pytest.approx(-1)}  # fmt: skip
    assert (second["confusion"], second["kullback_leibler"]) == (pytest.approx(-1), pytest.approx(1))
    assert order({"predicted": [told("a", 0.3, 20.0), told("b", 0.1, 25.0)]}, labels) == []


@pytest.mark.slow
def test_networks_learn_from_no_scene_that_is_measured(tmp_path, scenes):
    rendered = sorted(split_rendered()["train"])
    study = small(decoders=["two-headed"])
    plan = Plan(study, scenes[:1], study.evaluation.places(study, {rendered[1]: "a"}, []), [], tmp_path)
    (cells, *_) = plan.trainings({})
    learned = {name for cell in cells for part in ("train", "validation") for name in cell.training["data"][part]}
    assert learned == {scenes[0], *rendered} - {rendered[1]}


def test_a_withheld_scene_chooses_steps_and_teaches_nothing(tmp_path, scenes):
    rendered, (first, last) = sorted(split_rendered()["train"]), scenes
    study = small(decoders=["two-headed"])
    own = study.evaluation.training_scenes(study.reading, scenes, [], [], study.train)
    expected = {"train": [first, *rendered[1:]], "validation": [rendered[0], last], "prior": [first], "side": 68}
    assert own == expected | {"from_rgb": False, "placed": None}


def test_the_last_file_with_depth_is_withheld_where_another_is_left(tmp_path, scenes):
    cube = xr.open_dataset(scenes[0])["radiance"]
    cube.to_netcdf(tmp_path / "cube.nc")
    assert withheld_scene([*scenes, str(tmp_path / "cube.nc"), "coffee"]) == scenes[1]
    assert withheld_scene([scenes[0], str(tmp_path / "cube.nc"), "coffee"]) is None


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("--decoders likelihood,guess", "--decoders"),
        ("--steps 0", "--steps"),
        ("--side 0", "at least 96"),
        # 15 pixels around a patch of 64 are 16 in whole tiles
        ("--side 94 --crop 64x64 --decoders two-headed", "at least 96"),
        ("--test learned.nc", "a training scene"),
        ("--test folder/../learned.nc", "a training scene"),
        ("--train none.nc", "no such"),
    ],
)
def test_wrong_lists_and_decoders_are_refused(capsys, tmp_path, monkeypatch, scenes, more, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    given = {"--train": "learned.nc", "--test": "measured.nc"}
    lists = [word for pair in given.items() if pair[0] not in more for word in pair]
    assert words in refused(capsys, "compare", "spectral-depth", *lists, *more.split(), "--out", "out", "--work", "w")
    assert not (tmp_path / "out").exists()
