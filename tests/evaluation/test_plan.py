"""What a study is made of, before anything is computed: searches, trainings in the order of their needs, rows."""

import pytest

from tmca.evaluation.camera import Lists
from tmca.evaluation.grid import CellsFailed, Grid
from tmca.evaluation.plan import Plan
from tmca.evaluation.run import _measured
from tmca.evaluation.study import checked_study

TWO, NET = {"slots": 2}, {"kind": "unet"}
CODES = {
    "random": {"camera": TWO},
    "searched": {"camera": TWO, "search": {"kind": "free", "slots": 2, "noise": "some"}},
    "for each noise": {"camera": TWO, "search": {"kind": "free", "slots": 2}, "train": False},
    "from random": {"camera": TWO, "learn": {"what": "both", "networks": {"net": []}}},
    "from searched": {
        "camera": TWO,
        "learn": {"what": "both", "start": "searched", "networks": {"net": ["admm-tv", "other"]}},
    },
    "from learned": {
        "camera": TWO,
        "learn": {"what": "both", "start": "from searched", "decoder": True, "networks": {"net": []}},
    },
}
ABOUT = {
    "camera": "spectral", "settings": {"period": [8, 8]}, "reading": {"bands": 4, "size": [24, 32]}, "codes": CODES,
    "noises": {"none": {}, "some": {"read_noise": 0.02}}, "decoders": ["lmmse", "admm-tv", "net", "other"],
    "networks": {name: {"label": name, "decoder": NET} for name in ("net", "other")}, "seeds": 2, "seed": 5,
    "search": {"effort": {}},
}  # fmt: skip
PRIORS = {"gaussian": "gaussian.nc", "examples": "examples"}


@pytest.fixture
def plan(tmp_path):
    study = checked_study(ABOUT, "study")
    places = study.evaluation.places(study, {"coffee": "coffee"}, [])
    return Plan(study, ["astronaut", "rocket"], places, [], tmp_path)


@pytest.fixture
def searches(plan):
    return plan.searches(Lists(plan.train, ["coffee"], PRIORS, plan.places))


@pytest.fixture
def files(plan, searches):
    """Files of all searched codes."""
    return plan.files(searches, [{"name": cell.name, "codes": f"{cell.name}.nc"} for cell in searches.values()])


def starts(cell):
    return cell.training["codes"].get("start")


def rows_of(cells):
    return {(cell.code, cell.noise, cell.decoder, cell.seed) for cell in cells}


def test_a_search_that_several_rows_need_is_one(searches, files):
    assert sorted((cell.noise, cell.seed) for cell in searches.values()) == [
        ("none", 5), ("none", 6), ("some", 5), ("some", 6)
    ]  # fmt: skip
    assert len({cell.name for cell in searches.values()}) == 4
    for seed in (5, 6):
        one = files["searched", "some", seed]
        assert files["searched", "none", seed] == files["for each noise", "some", seed] == one
        assert files["for each noise", "none", seed] != one


def test_every_training_comes_after_what_it_starts_from(plan, files):
    at_hand, seen = {None, *files.values()}, []
    for cells in plan.trainings(files):
        assert {starts(cell) for cell in cells} <= at_hand
        for cell in cells:
            at_hand |= {str(cell.folder(plan.work)), str(cell.folder(plan.work) / "weights.safetensors")}
            seen.append((cell.code, cell.decoder, cell.seed))
    learned = [(code, "net") for code in CODES if code.startswith("from")]
    fixed = [(code, name) for code in ("random", "searched") for name in ("net", "other")]
    wanted = [(*pair, seed) for pair in [*learned, *fixed, ("from searched", "other")] for seed in (5, 6)]
    assert sorted(seen) == sorted(wanted)


def test_codes_that_learn_begin_with_those_that_the_study_names(plan, files):
    cells = {(c.code, c.decoder): c for part in plan.trainings(files) for c in part if c.seed == 6}
    first = cells["from searched", "net"]
    assert starts(cells["from random", "net"]) is None
    assert starts(cells["searched", "net"]) == starts(first) == files["searched", "some", 6]
    assert starts(cells["from learned", "net"]) == str(first.folder(plan.work))
    assert cells["from learned", "net"].training["codes"]["decoder"] == str(first.folder(plan.work))
    other = cells["from searched", "other"]
    assert starts(other) == str(first.folder(plan.work) / "weights.safetensors")
    assert (first.training["camera"]["learn"], other.training["camera"]["learn"]) == ("both", "none")


def test_without_a_searched_code_the_other_rows_are_left(plan):
    trained = {cell.code for part in plan.trainings({}) for cell in part}
    assert trained == {"random", "from random"}
    assert {cell.code for cell in plan.untrained(PRIORS, {})} == {"random"}


def test_codes_of_a_search_have_one_row_of_each_noise(plan, files):
    cells = plan.untrained(PRIORS, files)
    wanted = {("random", noise) for noise in ("none", "some")} | {("searched", noise) for noise in ("none", "some")}
    wanted |= {("for each noise", "none")}  # for the other noise they are the searched ones
    assert rows_of(cells) == {
        (*row, decoder, seed) for row in wanted for decoder in ("lmmse", "admm-tv") for seed in (5, 6)
    }
    for cell in cells:
        assert cell.prior == (PRIORS["gaussian"] if cell.decoder == "lmmse" else None)
        assert cell.codes == files.get((cell.code, cell.noise, cell.seed))


def test_decoders_behind_learned_codes_see_those_and_networks_their_own(plan, files):
    made = [("random", "net", "a"), ("searched", "net", "b"), ("from searched", "net", "c")]
    trained = [{"code": code, "decoder": name, "seed": 5, "weights": weights} for code, name, weights in made]
    cells = plan.behind_networks(trained, PRIORS, files)
    noises = ("none", "some")
    assert rows_of(cells) == {
        *((code, noise, "net", 5) for code, *_ in made for noise in noises),
        *(("from searched", noise, "admm-tv", 5) for noise in noises),
    }
    shown = {(cell.code, cell.decoder): (cell.codes, cell.camera_of, cell.weights) for cell in cells}
    assert shown == {
        ("random", "net"): (None, None, "a"),
        ("searched", "net"): (files["searched", "some", 5], None, "b"),
        ("from searched", "net"): (None, "c", "c"),
        ("from searched", "admm-tv"): (None, "c", None),
    }


def test_a_search_that_fails_is_tried_and_said_once_and_what_needs_it_is_left_out(plan, tmp_path):
    begun = []

    def compute(cell):
        begun.append((cell["step"], cell["name"]))
        if (cell["step"], cell.get("noise"), cell.get("seed")) == ("search", "some", 5):
            raise ValueError("no such codes")
        return {what: f"{cell['name']}.nc" for what in ("prior", "codes", "weights")}

    grid = Grid(compute, tmp_path)
    measured = _measured(plan, grid, ["coffee"])
    assert len(begun) == len({name for _, name in begun}) == grid.total == len(measured) + 1 + 2  # two priors
    behind = {(cell["code"], cell["seed"]) for cell in measured if cell["step"] in ("training", "measurement")}
    assert ("searched", 6) in behind
    assert not {("searched", 5), ("from searched", 5), ("from learned", 5)} & behind
    with pytest.raises(
        CellsFailed,
        match=r"1 of \d+ cells failed .* · some · seed 5\); the first says: ValueError: no such codes",
    ):
        grid.check()
