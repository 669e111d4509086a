"""Codes on the pixels of a device, against the geometry followed pixel by pixel."""

from math import cos, radians, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tmca.errors import DataError, SettingError
from tmca.lab.display.placement import Placement


def mirror(place, i, j):
    """Place of a device pixel, pitches."""
    return (i / 2, j + (i % 2) / 2) if place.lattice == "diamond" else (i, j)


def slow(place):
    """(R, C) index, one device pixel after the other."""
    found = np.full(place.device, -1)
    at = {(i, j): mirror(place, i, j) for i in range(place.device[0]) for j in range(place.device[1])}
    middle = [(min(part) + max(part)) / 2 for part in zip(*at.values(), strict=True)]
    for i in range(place.device[0]):
        for j in range(place.device[1]):
            y, x = (part - m - moved for part, m, moved in zip(at[i, j], middle, place.offset, strict=True))
            turn = radians(place.angle)
            y, x = cos(turn) * y + sin(turn) * x, cos(turn) * x - sin(turn) * y
            y, x = (-y if "rows" in place.flip else y), (-x if "columns" in place.flip else x)
            row = np.floor(y / place.macro_pixel + place.code[0] / 2 + 1e-9)  # between two pixels: the later one
            column = np.floor(x / place.macro_pixel + place.code[1] / 2 + 1e-9)
            if 0 <= row < place.code[0] and 0 <= column < place.code[1]:
                found[i, j] = int(row) * place.code[1] + int(column)
    return found


@pytest.mark.parametrize("code", [(4, 6), (5, 7)])
@pytest.mark.parametrize(
    "how",
    [
        {"macro_pixel": 2}, {"macro_pixel": 3, "flip": ("columns",)}, {"macro_pixel": 2.1, "angle": 45.0},
        {"macro_pixel": 2.1, "angle": -30.0, "flip": ("rows", "columns")}, {"macro_pixel": 2.1, "lattice": "diamond"},
        {"macro_pixel": 2.3, "lattice": "diamond", "angle": 45.0, "offset": (1, -2)},
    ],
)  # fmt: skip
def test_every_device_pixel_shows_the_code_above_it(code, how):
    whole = int(how["macro_pixel"])
    place = Placement(code, (code[0] * whole + 44, code[1] * whole + 20), **how)
    np.testing.assert_array_equal(place.index(), slow(place))


@settings(max_examples=60, deadline=None)
@given(
    code=st.tuples(st.integers(1, 9), st.integers(1, 9)),
    extra=st.tuples(st.integers(0, 5), st.integers(0, 5)),
    macro=st.integers(1, 4),
    flip=st.sampled_from([(), ("rows",), ("columns",), ("rows", "columns")]),
    seed=st.integers(0, 99),
)
def test_codes_come_back_from_whole_macro_pixels(code, extra, macro, flip, seed):
    device = (code[0] * macro + extra[0], code[1] * macro + extra[1])
    place = Placement(code, device, macro, flip=flip)
    patterns = np.random.default_rng(seed).integers(0, 2, (3, *code), dtype=np.uint8)
    shown = place.shown(patterns)
    assert (np.bincount(place.index()[place.index() >= 0]) == macro**2).all()
    np.testing.assert_array_equal(place.read_back(shown, "here"), patterns)


@settings(max_examples=40, deadline=None)
@given(
    code=st.tuples(st.integers(1, 9), st.integers(1, 9)),
    angle=st.sampled_from([45.0, -45.0, 30.0, 90.0, 180.0]),
    lattice=st.sampled_from(["square", "diamond"]),
    macro=st.floats(2, 4),
    seed=st.integers(0, 99),
)
def test_codes_come_back_from_turned_devices(code, angle, lattice, macro, seed):
    place = Placement(code, (120, 70), macro, angle, lattice)
    patterns = np.random.default_rng(seed).integers(0, 2, (2, *code), dtype=np.uint8)
    np.testing.assert_array_equal(place.read_back(place.shown(patterns), "here"), patterns)


def test_a_mirrored_device_shows_the_mirrored_code():
    code = np.arange(6, dtype=np.uint8).reshape(1, 2, 3)
    shown = Placement((2, 3), (2, 3), flip=("columns",)).shown(code)
    np.testing.assert_array_equal(shown[0], code[0][:, ::-1])


def test_a_quarter_turn_is_a_transpose():
    code = np.arange(9, dtype=np.uint8).reshape(1, 3, 3)
    shown = Placement((3, 3), (3, 3), angle=90.0).shown(code)
    np.testing.assert_array_equal(shown[0], np.rot90(code[0]))


def test_a_registration_says_where_code_pixels_are():
    """Code pixel (r, c) is centred on device pixel (2 r + 3, 2 c + 1.5), as an affine matrix says."""
    place = Placement((3, 4), (12, 14), affine=((2.0, 0.0, 3.5), (0.0, 2.0, 2.5)))
    index = place.index()
    for row in range(3):
        for column in range(4):
            rows, columns = np.nonzero(index == 4 * row + column)
            assert rows.mean() == 2 * row + 3.5
            assert columns.mean() == 2 * column + 2.5


def test_pixels_beside_the_code_are_dark():
    shown = Placement((2, 2), (5, 6)).shown(np.ones((1, 2, 2), np.uint8))
    assert shown.sum() == 4


@pytest.mark.parametrize(
    ("place", "where"),
    [
        (Placement((30, 40), (20, 50)), "--macro-pixel"), (Placement((9, 9), (40, 40), 1.0, 45.0), "--macro-pixel"),
        (Placement((5, 5), (20, 20), 4, offset=(3, 0)), "--offset"),
    ],
)  # fmt: skip
def test_codes_that_a_device_cannot_show_are_refused(place, where):
    with pytest.raises(SettingError) as found:
        place.index()
    assert found.value.where == where


def test_what_would_fit_is_named():
    with pytest.raises(SettingError, match=r"take --macro-pixel 2 or less, or a code of 192x256 or less"):
        Placement((300, 300), (768, 1024), macro_pixel=4).index()
    with pytest.raises(SettingError, match=r"take a code of 768x1024 or less"):
        Placement((900, 300), (768, 1024)).index()


def test_frames_that_were_touched_are_refused():
    place = Placement((2, 2), (4, 4), 2)
    frames = place.shown(np.ones((1, 2, 2), np.uint8))
    frames[0, 0, 0] = 0
    with pytest.raises(DataError, match="differ"):
        place.read_back(frames, "here")
    with pytest.raises(DataError, match="4×4"):
        place.read_back(frames[:, :3], "here")


@pytest.mark.parametrize("device", [(48, 40), (48, 41), (50, 40)])
def test_a_code_lies_on_the_middle_of_the_mirrors_of_a_diamond_lattice(device):
    place = Placement((4, 4), device, 4, lattice="diamond")
    index = place.index()
    at = np.array([[mirror(place, i, j) for j in range(device[1])] for i in range(device[0])])
    np.testing.assert_allclose(at[index >= 0].mean(0), at.reshape(-1, 2).mean(0), atol=1e-9)


@pytest.mark.parametrize("columns", [15, 16, 32, 33])
def test_a_code_that_just_fits_a_diamond_lattice_is_shown(columns):
    Placement((4, 5), (24, columns), 3, lattice="diamond").index()
    with pytest.raises(SettingError, match="smaller code"):
        Placement((4, 5), (23, columns), 3, lattice="diamond").index()
