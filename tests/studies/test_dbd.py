"""The page of results of dual blind deconvolution: every bound is measured, as it is said, with pictures."""

import json

import numpy as np
import pytest

from studies.dbd import draws as module
from studies.dbd.claims import shared_gram
from studies.dbd.draws import Row, Study, run_study
from studies.dbd.report import Page, write_report
from tmca.errors import SettingError

PAGE = Page.read()


def test_every_bound_is_of_a_row_that_the_page_computes():
    studies = {part.name: part.study for part in PAGE.sections}
    asked = [pair for claim in PAGE.asked for pair in claim.of_parts()]
    assert len(asked) > 25
    for part, claim in asked:
        for name, value in claim.where.items():
            assert value in studies[part].axes[name]
        assert claim.number in Row.__dataclass_fields__
        assert claim.number != "certified" or studies[part].certify


def measured(cell):
    """What a draw might have given: exact without noise, the shared Gram matrix a little worse."""
    noisy = cell["snr_db"] is not None
    shared = cell["gram"] == "shared"
    found = {"success": True, "exact": not noisy, "seconds": 0.01 * cell["M"], "right_number": True, "certified": True}
    found |= {"error": 0.0, "correlation": 1.0, "silent": (cell["snr_db"] or 0) < -50}
    if noisy:
        found |= {"squared_error": 1.21, "squared_bound": 1.0}
    if cell["method"] == "sdp":
        found |= {"value": 4.0 + 0.001 * shared - 0.1 * shared * cell["seed"], "optimum": 1 - 0.1 * shared}
    return found


@pytest.mark.slow
def test_the_page_tells_every_bound_every_part_and_the_cost(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "one_draw", measured)
    told = []
    write_report(
        tmp_path / "page", tmp_path / "runs", ["tmca", "dbd", "report"], draws=2,
        progress=lambda done, total, name, left: told.append((done, total, name)),
    )  # fmt: skip
    text = (tmp_path / "page.md").read_text()
    data = json.loads((tmp_path / "page.json").read_text())
    for part in PAGE.sections:
        assert f"## {part.title}" in text
        assert len(data["parts"][part.name]["rows"]) == np.prod([len(values) for values in part.study.axes.values()])
    assert text.count("**no**") == 0
    assert "| RMSE over bound at 20 dB, given right numbers | ≤ 1.2 | 1.1 | yes |" in text
    assert "any draw | ≤ 0.002 | 0.001 | yes |" in text
    assert data["cost_exponent"] == pytest.approx(0.5, abs=0.1)  # seconds grow with M, samples with its square
    for name in [line.split("](")[1].rstrip(")") for line in text.splitlines() if line.startswith("![")]:
        assert (tmp_path / name).stat().st_size > 5000
    assert told[-1][0] == told[-1][1] == len(told)
    assert "129 x 65, J = 3, L = 10, Q = 10" in told[-1][2]


def settings(study):
    """A setting of every varied axis, one after the other."""
    longest = max(len(values) for values in study.axes.values())
    return [{name: values[i % len(values)] for name, values in study.axes.items()} for i in range(longest)]


def row(study, **changes):
    """A row where every bound holds."""
    numbers = {"draws": 1, "success": 1.0, "near": 1.0, "right_number": 1.0, "exact": 0.0, "certified": 1.0}
    numbers |= {"median_s": 0.1, "p90_s": 0.2, "max_s": 0.3, "rmse_over_bound": 1.1, "values": (1.0,)}
    numbers |= {"optimum": 1.0 if changes.get("gram") != "shared" else 0.5}
    settings = {**study.fixed, **{name: value for name, value in changes.items() if name not in numbers}}
    return Row(settings=settings, **{**numbers, **{n: v for n, v in changes.items() if n in numbers}})


def test_the_shared_gram_is_compared_draw_by_draw():
    study = Study({"gram": ["separate", "shared"]}, {}, 2)
    separate = row(study, gram="separate", optimum=0.5, values=(4.0, 3.0))
    shared = row(study, gram="shared", optimum=0.2, values=(3.0, 3.5))  # lower on the average, and higher once
    assert shared_gram([separate, shared]) == (pytest.approx(0.3), pytest.approx(0.5))


@pytest.mark.slow
def test_the_value_of_the_dual_tells_whether_the_truth_is_its_optimum(tmp_path):
    fixed = {"M": 9, "P": 5, "J": 2, "L": 3, "Q": 3, "method": "sdp", "early": False, "accuracy": 1e-6}
    separate, shared = run_study(Study({"gram": ["separate", "shared"]}, fixed, 1), tmp_path)
    assert separate.optimum == 1
    assert separate.values == (pytest.approx(6, abs=2e-4),)  # six paths of amplitude one
    assert shared.optimum == 0
    assert shared.values[0] < separate.values[0] + 2e-3


@pytest.mark.parametrize(("told", "silent"), [("known", True), pytest.param("zero", False, marks=pytest.mark.slow)])
def test_noise_alone_is_never_exact_whatever_the_solver_is_told(tmp_path, told, silent):
    fixed = {"M": 5, "P": 4, "J": 2, "L": 1, "Q": 1, "snr_db": -100, "separation": 0.1}
    row = run_study(Study({"sigma": [told]}, fixed, 2), tmp_path)[0]
    assert row.exact == 0
    assert (row.silent or 0) == silent


@pytest.mark.parametrize(
    ("axes", "told"),
    [
        ({"sigma": ["nothing"]}, "sigma: found 'nothing', expected one of known, unknown, zero"),
        ({"method": ["magic"]}, "method: found 'magic', expected one of sfw, sdp, cvxpy"),
        ({"M": [9.5]}, "M: found 9.5, expected a whole number"),
        ({"L": [1.5]}, "L or Q: found 1.5, expected a whole number"),
        ({"Q": ["a"]}, "L or Q: found 'a', expected a whole number, or several"),
        ({"lag": ["late"]}, "lag: found 'late', expected a number"),
        ({"noise": [1]}, "vary: found 'noise', expected one of M, P"),
    ],
)
def test_what_no_draw_can_be_made_of_is_said_before_the_work(axes, told):
    with pytest.raises(SettingError, match=told):
        Study(axes, {}, 1)
