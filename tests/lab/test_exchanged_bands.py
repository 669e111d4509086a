"""Scans of which two frames were named after each other, and scans in order whose spectra have edges and lines."""

import numpy as np
import pytest
from PIL import Image

from tmca.errors import DataError
from tmca.lab.spectral_scan import read_scan
from tmca.lab.spectral_scan.rendered import render_scan

NM = np.linspace(400, 700, 31)
SIZE = (20, 23)


def spectra(name):
    """(31, 20, 23) reflectance."""
    rng = np.random.default_rng(2)
    albedo = rng.uniform(0.3, 1, (1, *SIZE))
    lines = (NM == 480) | (NM == 590)
    own = {
        "smooth": 0.45 + 0.35 * np.sin(NM / 60)[:, None, None] * rng.uniform(0.2, 1, SIZE),
        "edge": (0.05 + 0.8 / (1 + np.exp((580 - NM) / 2)))[:, None, None] * albedo,
        "two dips": (0.8 - 0.6 * lines)[:, None, None] * albedo,
        "two lines": (0.2 + 0.6 * lines)[:, None, None] * albedo,
        "a line and a dip": (0.5 + 0.3 * (NM == 590) - 0.3 * (NM == 480))[:, None, None] * albedo,
        "grey": 0.5 * albedo * np.ones((31, 1, 1)),
    }
    return own[name]


def write(place, seen, renamed=(), kinds=("scene",)):
    """Folders of the scan, with two bands under each other's names."""
    for kind in ("scene", "white", "dark"):
        (place / kind).mkdir()
        for i, frame in enumerate(getattr(seen, kind)):
            band = renamed[1 - renamed.index(i)] if kind in kinds and i in renamed else i
            name = f"dark_{i}" if kind == "dark" else f"{kind}_{NM[band]:g}nm"
            Image.fromarray(frame).save(place / kind / f"{name}.png")
    return place / "scene", place / "dark", place / "white"


LAMPS = {"even": None, "lines": 0.3 + 0.7 * np.random.default_rng(3).uniform(size=31)}


@pytest.mark.parametrize("lamp", LAMPS)
@pytest.mark.parametrize("name", ["smooth", "edge", "two dips", "two lines", "a line and a dip", "grey"])
def test_scans_in_order_are_not_doubted(tmp_path, name, lamp):
    seen = render_scan(spectra(name), source=LAMPS[lamp])
    assert read_scan(*write(tmp_path, seen), saturation=4095).doubts == ()


@pytest.mark.parametrize("pair", [(2, 24), (0, 30), (1, 15), (10, 22)])
@pytest.mark.parametrize("kinds", [("scene",), ("scene", "white")])
def test_two_frames_under_each_others_names_are_refused(tmp_path, pair, kinds):
    folders = write(tmp_path, render_scan(spectra("smooth")), pair, kinds)
    names = " and ".join(f"scene_{NM[band]:g}nm" for band in pair)
    with pytest.raises(DataError, match=names + (", and those of the white" if len(kinds) > 1 else " under")):
        read_scan(*folders, saturation=4095)


@pytest.mark.parametrize("pair", [(2, 24), (5, 27)])
def test_where_spectra_have_lines_of_their_own_they_are_doubted_only(tmp_path, pair):
    seen = render_scan(spectra("two dips"))
    (said,) = read_scan(*write(tmp_path, seen, pair), saturation=4095).doubts
    assert all(f"scene_{NM[band]:g}nm" in said for band in pair)


def test_a_few_bands_are_not_judged(tmp_path):
    seen = render_scan(spectra("smooth")[:5])
    assert read_scan(*write(tmp_path, seen, (1, 3)), saturation=4095).doubts == ()
