"""What objects say of themselves: short, in one way for all, with a picture that a notebook can hold."""

import base64
import re
from functools import cache
from io import BytesIO

import numpy as np
import pytest
import torch
from PIL import Image

import tmca
from tmca import dbd
from tmca.applications.point_clouds import PointCloud
from tmca.lab.calibration.file import Calibration
from tmca.lab.calibration.sensor import DarkField
from tmca.plots.style import blank_figure
from tmca.plots.thumbnails import Panel, row_figure
from tmca.priors import GaussianPrior
from tmca.summaries import MOST_CHARACTERS, as_numpy, data_uri


@cache
def things():
    """One of every class that is shown."""
    camera = tmca.SpectralCamera(bands=3, size=(12, 16), slots=2, sensor=tmca.Sensor(full_well=1e4, bits=10))
    snapshot = tmca.Snapshot(camera(torch.rand(1, 3, 12, 16), generator=0), camera, {"scene": "a <b> scene"})
    prior = GaussianPrior.learn([torch.rand(3, 20, 30)], (4, 8), wavelengths=camera.wavelengths, sources=["one"])
    places = np.random.default_rng(0).random((50, 3), np.float32) - np.array([0, 0, 3], np.float32)
    points = PointCloud(places, np.full((50, 3), 99, np.uint8), 80.0, True)
    dark = DarkField(np.full((6, 8), 64.0), np.full((6, 8), 2.0), np.zeros((6, 8), np.uint8), 16)
    return {
        "camera": camera,
        "light field": tmca.LightFieldCamera(views=3, size=(12, 16), slots=2),
        "spectral-depth": tmca.SpectralDepthCamera.from_preset("quick", size=(32, 32)),
        "sensor": camera.sensor,
        "snapshot": snapshot,
        "estimate": tmca.reconstruct(snapshot, "lmmse", prior=prior, uncertainty=True),
        "prior": prior,
        "calibration": Calibration.empty("bench").with_part("dark", dark, {"noise": 2.0}, sensor=(6, 8)),
        "recovery": dbd.solve(dbd.simulate(M=9, P=5, J=2, targets=2, paths=1, seed=2)),
        "problem": dbd.simulate(M=9, P=5, J=2, targets=2, paths=1, seed=2),
        "points": points,
    }


NAMES = [
    "camera",
    "light field",
    "spectral-depth",
    "sensor",
    "snapshot",
    "estimate",
    "prior",
    "calibration",
    "recovery",
    "problem",
    "points",
]


@pytest.mark.parametrize("name", NAMES)
def test_a_text_is_some_short_lines_without_numbers_of_an_array(name):
    thing = things()[name]
    lines = repr(thing).splitlines()
    assert lines[0] == type(thing).__name__
    assert 2 <= len(lines) <= 9
    assert max(map(len, lines)) <= 120
    assert "tensor(" not in repr(thing)
    assert "array(" not in repr(thing)


@pytest.mark.parametrize("name", NAMES)
def test_a_page_has_the_facts_of_the_text_and_a_picture_of_bounded_size(name):
    thing = things()[name]
    page = thing._repr_html_()
    address = re.search(r'src="(data:image/png;base64,([^"]+))"', page)
    assert len(address[1]) <= MOST_CHARACTERS
    picture = Image.open(BytesIO(base64.b64decode(address[2])))
    assert 150 < picture.width < 900
    assert np.ptp(np.asarray(picture.convert("L"))) > 100
    assert len(page) - len(address[1]) < 4000
    assert page.count("<tr") == len(repr(thing).splitlines()) - 1


@pytest.mark.parametrize("name", NAMES)
def test_they_are_drawn(name):
    assert things()[name].plot().axes


def test_texts_of_a_page_cannot_be_markup():
    assert "a &lt;b&gt; scene" in things()["snapshot"]._repr_html_()


def test_labelled_data_hold_what_the_file_does(tmp_path):
    prior, calibration, recovery = (things()[name] for name in ("prior", "calibration", "recovery"))
    np.testing.assert_array_equal(prior.to_xarray()["mean"], prior.mean)
    np.testing.assert_array_equal(calibration.to_xarray()["dark"]["mean"], calibration.part("dark").mean)
    paths = recovery.to_xarray()
    assert paths.sizes["path"] == 3
    assert paths["source"].values.tolist() == ["radar", "radar", "communications"]
    np.testing.assert_allclose(paths["delay"], np.asarray(recovery)[:, 0])


@pytest.mark.parametrize("name", ["snapshot", "estimate"])
def test_numpy_takes_the_values(name):
    thing = things()[name]
    assert np.array_equal(np.asarray(thing), thing.values.numpy())
    assert np.shares_memory(np.asarray(thing), thing.values.numpy())
    assert not np.shares_memory(np.array(thing, copy=True), thing.values.numpy())
    assert np.asarray(thing, dtype=np.float64).dtype == np.float64
    assert np.mean(thing) == pytest.approx(float(thing.values.mean()))


def test_a_conversion_without_a_copy_is_refused_where_it_needs_one():
    values = torch.rand(3)
    assert as_numpy(values, copy=False).base is not None
    assert as_numpy(values.requires_grad_(), np.float32).dtype == np.float32
    with pytest.raises(ValueError, match="copy=False"):
        as_numpy(values, np.float64, copy=False)


def test_a_picture_that_is_hard_to_pack_stays_below_the_bound():
    noise = np.random.default_rng(0).random((300, 300, 3))
    assert len(data_uri(row_figure([Panel("noise", noise)] * 3))) <= MOST_CHARACTERS


def test_a_figure_shows_itself_in_a_notebook():
    figure = blank_figure(3.0, 2.0)
    figure.subplots().plot([0, 1])
    with Image.open(BytesIO(figure._repr_png_())) as picture:
        assert picture.size == (330, 220)


def test_a_scenario_says_its_targets_and_paths():
    text = repr(dbd.read_scenario("road"))
    assert "150 m at -35 m/s" in text
    assert "10 MHz at 77 GHz" in text
