"""The three checks: what passes, and where what does not is said to be."""

import pickle

import numpy as np
import pytest
import torch

from tmca.errors import SettingError, ShapeError, check_choice, check_range, check_shape


def test_a_choice_is_one_of_those():
    check_choice("family", "open", {"open": 1, "random": 2})
    with pytest.raises(SettingError, match=r"^family: found 'closed', expected one of open, random$"):
        check_choice("family", "closed", ["open", "random"])


def test_the_middle_of_a_long_value_is_left_out():
    assert str(SettingError("a", "b" * 250)) == f"a: found {'b' * 250}"
    caught = SettingError("numbers", f"first{'0' * 10**6}last", "few", "shorten them")
    assert str(caught).startswith("numbers: found first00")
    assert str(caught).endswith("00last, expected few; shorten them")
    assert len(str(caught)) < 320


@pytest.mark.parametrize(
    ("value", "bounds"),
    [
        (0, {"low": 1}), (2, {"high": 1}), (0.0, {"above": 0}), (1, {"below": 1}), (1.5, {"whole": True}),
        (float("nan"), {}), (float("inf"), {"above": 0}), (-float("inf"), {"high": float("inf")}), (True, {}),
        ("3", {}), (None, {"low": 0}),
    ],
)  # fmt: skip
def test_other_numbers_are_refused(value, bounds):
    with pytest.raises(SettingError) as caught:
        check_range("pitch", value, **bounds)
    assert caught.value.where == "pitch"


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (torch.zeros(2, 3), (2, 3)), (np.zeros((2, 1, 4, 5)), ("B", 1, "H", "W")), ((7, 3, 3), (..., "n", "n")),
        (torch.zeros(3, 3), (..., "n", "n")), (torch.zeros(()), ()),
    ],
)  # fmt: skip
def test_shapes_that_fit_pass(found, expected):
    check_shape("cube", found, expected)


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        ((2, 3), (2, 4)), ((2, 3), (2, 3, "W")), ((0, 3), ("B", 3)), ((2, 3), ("n", "n")), ((3,), (..., "H", "W")),
        (5, ("H",)),
    ],
)  # fmt: skip
def test_other_shapes_are_refused(found, expected):
    with pytest.raises(ShapeError) as caught:
        check_shape("cube", found if found == 5 else torch.zeros(found), expected, "crop it")
    assert (caught.value.where, caught.value.remedy) == ("cube", "crop it")


@pytest.mark.parametrize(
    ("value", "bounds"),
    [
        (1, {"low": 1, "whole": True}), (4.0, {"low": 1, "whole": True}), (np.float32(0.5), {"above": 0, "below": 1}),
        (np.int64(3), {"high": 3}), (float("inf"), {"above": 0, "high": float("inf")}), (-2.5, {}),
    ],
)  # fmt: skip
def test_numbers_within_bounds_pass(value, bounds):
    check_range("pitch", value, **bounds)


@pytest.mark.parametrize(
    ("call", "line"),
    [
        (lambda: check_shape("cube", (2, 3), (..., "B", 4)), "cube: found shape (2, 3), expected (…, B, 4)"),
        (lambda: check_range("pitch", -1.0, above=0, unit="m"), "pitch: found -1 m, expected above 0 m"),
        (lambda: check_range("slots", 0, 1, 9, whole=True), "slots: found 0, expected a whole number, 1 to 9"),
    ],
)
def test_an_error_is_a_line_of_where_found_and_expected(call, line):
    with pytest.raises((ShapeError, SettingError)) as caught:
        call()
    assert str(caught.value) == line


def test_an_error_comes_whole_out_of_another_process():
    error = pickle.loads(pickle.dumps(SettingError("--jobs", "-1", "1 or more", "take 2")))
    assert isinstance(error, SettingError)
    assert (str(error), error.where, error.remedy) == (
        "--jobs: found -1, expected 1 or more; take 2",
        "--jobs",
        "take 2",
    )
