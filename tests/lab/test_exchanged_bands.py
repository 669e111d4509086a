"""Scans of which two frames were named after each other, and scans in order whose spectra have edges and lines."""

import warnings
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tmca.lab.frames import Frames
from tmca.lab.spectral_scan import read_scan
from tmca.lab.spectral_scan.exchanged import doubt_exchanged
from tmca.lab.spectral_scan.rendered import render_scan

NM = np.linspace(400, 700, 31)
LEDS = np.array([405.0, 470, 505, 525, 590, 625, 660, 735])
UNEVEN = np.array([365.0, 450, 470, 490, 505, 525, 560, 590, 625, 660])
GRIDS = {"8 LEDs": LEDS, "10 uneven": UNEVEN, "8 even": np.linspace(400, 700, 8), "31 even": NM}
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


def doubts(nm, reflectance, seed=0, noise=5.0):
    """Of a scan of 12 bits whose (L, 20, 23) reflectance, or (L,) of a uniform tile, is seen in order of its names."""
    rng = np.random.default_rng(seed)
    tile = np.reshape(reflectance, (len(nm), *(np.shape(reflectance)[1:] or (1, 1)))) * np.ones(SIZE)
    names = tuple(f"scene_{wave:g}nm" for wave in nm)
    seen = [
        np.round(100 + 3000 * part + noise * rng.standard_normal(tile.shape)) for part in (tile, np.ones_like(tile))
    ]
    scene, white = (Frames(Path("scan"), names, part.astype(np.float32), part > 1e9) for part in seen)
    return doubt_exchanged(scene, white, np.full((1, *SIZE), 100.0), nm)


LAMPS = {"even": None, "lines": 0.3 + 0.7 * np.random.default_rng(3).uniform(size=31)}


@pytest.mark.parametrize("lamp", LAMPS)
@pytest.mark.parametrize("name", ["smooth", "edge", "two dips", "two lines", "a line and a dip", "grey"])
def test_scans_in_order_are_not_doubted(tmp_path, name, lamp):
    seen = render_scan(spectra(name), source=LAMPS[lamp])
    assert read_scan(*write(tmp_path, seen), saturation=4095).doubts == ()


@pytest.mark.parametrize("pair", [(2, 24), (5, 27), (1, 15), (10, 22)])
@pytest.mark.parametrize("kinds", [("scene",), ("scene", "white")])
def test_two_frames_under_each_others_names_are_named(tmp_path, pair, kinds):
    (said,) = read_scan(*write(tmp_path, render_scan(spectra("smooth")), pair, kinds), saturation=4095).doubts
    names = " and ".join(f"scene_{NM[band]:g}nm" for band in pair)
    assert names + (", and those of the white, may" if len(kinds) > 1 else " may") in said


def test_a_uniform_tile_under_eight_leds_is_not_doubted():
    purplish_blue = [0.268, 0.345, 0.184, 0.125, 0.086, 0.085, 0.123, 0.149]
    assert all(doubts(LEDS, purplish_blue, seed) == () for seed in range(10))


@pytest.mark.parametrize("grid", GRIDS)
def test_grey_scenes_under_a_lamp_that_drifts_are_not_doubted(grid):
    nm = GRIDS[grid]
    albedo = np.kron(np.random.default_rng(1).uniform(0.1, 0.9, (4, 23)), np.ones((5, 1)))
    for seed in range(60 if len(nm) < 20 else 10):
        drift = 1 + 0.005 * np.random.default_rng(seed).standard_normal(len(nm))
        assert doubts(nm, albedo * drift[:, None, None], seed) == ()


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("rest", [0.02, 0.5, 0.873])
def test_one_band_that_is_brighter_than_the_others_is_not_doubted(grid, rest):
    nm = GRIDS[grid]
    for band in range(len(nm)):
        assert doubts(nm, np.where(np.arange(len(nm)) == band, 0.9, rest)) == ()


@pytest.mark.parametrize("grid", GRIDS)
def test_identical_frames_are_not_doubted(grid):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert doubts(GRIDS[grid], np.full(len(GRIDS[grid]), 0.5), noise=0.0) == ()


def test_a_corner_that_the_light_does_not_reach_hides_no_exchange():
    order = np.arange(31)
    order[[2, 24]] = 24, 2
    seen = spectra("smooth")[order]
    names = tuple(f"scene_{wave:g}nm" for wave in NM)
    lit = np.ones(SIZE)
    lit[:5, :5] = 0
    rng = np.random.default_rng(0)
    values = [3000 * lit * part + 5 * rng.standard_normal(seen.shape) for part in (seen, np.ones_like(seen))]
    scene, white = (Frames(Path("scan"), names, part.astype(np.float32), part > 1e9) for part in values)
    (said,) = doubt_exchanged(scene, white, np.zeros((1, *SIZE)), NM)
    assert said.startswith("scan: scene_420nm and scene_640nm")


def test_a_few_bands_are_not_judged(tmp_path):
    seen = render_scan(spectra("smooth")[:5])
    assert read_scan(*write(tmp_path, seen, (1, 3)), saturation=4095).doubts == ()
