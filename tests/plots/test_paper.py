"""Figures for a paper: as wide as a column or a page, texts of 7 points that do not lie on each other."""

from itertools import combinations

import numpy as np
import pytest
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

from tmca.metrics import psnr
from tmca.plots.paper import COLUMN, PAGE, paper_figure
from tmca.plots.side_by_side import _cubes, side_by_side
from tmca.plots.style import save_figure

WAVES = np.linspace(4.2e-7, 6.8e-7, 5)


def cube(seed, size=(24, 30)):
    values = np.random.default_rng(seed).random((5, *size)).astype(np.float32)
    return xr.Dataset({"estimate": (("wavelength", "y", "x"), values)}, coords={"wavelength": WAVES})


def cubes(codes, decoders):
    names = [(f"code number {code}", f"decoder {row}") for code in range(codes) for row in range(decoders)]
    return {name: cube(seed) for seed, name in enumerate(names)}


def outside(figure):
    """Numbers beyond the ends of axes, which are not drawn."""
    sides = [side for axis in figure.axes for side in (axis.xaxis, axis.yaxis)]
    ends = [(side, *sorted(side.get_view_interval())) for side in sides]
    ticks = [tick for side, low, high in ends for tick in side.get_major_ticks() if not low <= tick.get_loc() <= high]
    return [label for tick in ticks for label in (tick.label1, tick.label2)]


def texts(figure):
    """(text, box in pixels) of all that is written."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    written = [one for one in figure.findobj(Text) if one.get_text().strip() and one.get_visible()]
    shown = [one for one in written if one not in outside(figure)]
    return [(one, one.get_window_extent(canvas.get_renderer())) for one in shown]


@pytest.mark.parametrize(("codes", "decoders", "width"), [(1, 1, COLUMN), (2, 2, COLUMN), (4, 2, PAGE), (7, 1, PAGE)])
def test_texts_are_legible_and_keep_clear_of_each_other(codes, decoders, width):
    figure = side_by_side(cubes(codes, decoders), cube(99)["estimate"])
    assert figure.get_figwidth() * 25.4 == pytest.approx(width)
    written = texts(figure)
    assert min(one.get_fontsize() for one, _ in written) >= 7
    whole = figure.bbox
    for one, box in written:
        assert whole.x0 - 1 <= box.x0 <= box.x1 <= whole.x1 + 1, one.get_text()
        assert whole.y0 - 1 <= box.y0 <= box.y1 <= whole.y1 + 1, one.get_text()
    shrunk = [(one.get_text(), box.padded(-1)) for one, box in written]
    assert [(a, b) for (a, one), (b, other) in combinations(shrunk, 2) if one.overlaps(other)] == []


LARGE = [(3, 5, ""), (3, 9, "Error maps"), (7, 9, "rows alone")]


@pytest.mark.parametrize(
    ("codes", "decoders", "left_out"),
    [(3, 3, ""), *(pytest.param(*one, marks=pytest.mark.slow) for one in LARGE)],
)
def test_a_figure_with_many_decoders_fits_a_page_and_says_what_it_leaves_out(codes, decoders, left_out):
    figure = side_by_side({name: cube(7, (24, 24)) for name in cubes(codes, decoders)}, cube(99, (24, 24))["estimate"])
    assert figure.get_figwidth() * 25.4 == pytest.approx(PAGE)
    assert figure.get_figheight() * 25.4 <= 220
    assert left_out in figure.get_label()
    assert bool(left_out) == bool(figure.get_label())
    pictures = [axis for axis in figure.axes if axis.images and axis.bbox.height > 20]
    assert min(axis.bbox.width / figure.dpi * 25.4 for axis in pictures) >= 23.9
    written = [(one.get_text(), box.padded(-1)) for one, box in texts(figure)]
    assert [(a, b) for (a, one), (b, other) in combinations(written, 2) if one.overlaps(other)] == []


def test_fonts_of_a_pdf_are_true_type(tmp_path):
    figure = side_by_side(cubes(1, 1), cube(99)["estimate"])
    content = save_figure(figure, tmp_path / "figure.pdf").read_bytes()
    assert b"/Subtype /TrueType" in content or b"/CIDFontType2" in content
    assert b"/Subtype /Type3" not in content


def test_pictures_say_the_psnr_and_failed_ones_that_they_failed():
    some, truth = cubes(2, 2), cube(99)["estimate"]
    some.pop(("code number 1", "decoder 1"))
    said = [one.get_text() for one, _ in texts(side_by_side(some, truth))]
    for one in some.values():
        assert f"{psnr(one['estimate'].values, truth.values):.1f} dB" in said
    assert [one.endswith(" dB") for one in said].count(True) == len(some)
    assert said.count("failed") == 1


def test_a_column_of_which_nothing_is_there_keeps_its_place():
    names = [*cubes(3, 1)]
    some = {name: one for name, one in cubes(3, 1).items() if name != names[1]}
    written = texts(side_by_side(some, None, names))
    heads = {one.get_text().replace("\n", " "): box.x0 for one, box in written}
    assert heads["code number 0"] < heads["code number 1"] < heads["code number 2"]
    assert [one.get_text() for one, _ in written].count("failed") == 1


def test_the_spectra_are_those_of_the_best_decoder_of_every_code():
    truth = cube(99)["estimate"].values
    values = {("a", "far"): truth + 0.3, ("a", "near"): truth + 0.1, ("b", "far"): truth + 0.2}
    curves = _cubes(values, truth, WAVES.tolist()).curves
    assert list(curves[0].lines) == ["truth", "a, near", "b, far"]
    assert all(np.allclose(one.lines["a, near"], one.lines["truth"] + 0.1) for one in curves)


@pytest.mark.parametrize("known", [True, False])
def test_views_depth_and_other_scenes_are_drawn_too(known):
    rng = np.random.default_rng(0)
    field = xr.Dataset({"estimate": (("view_v", "view_u", "y", "x"), rng.random((3, 3, 20, 24)))})
    depth = xr.Dataset(
        {
            "radiance": (("wavelength", "y", "x"), rng.random((5, 20, 24))),
            "depth": (("y", "x"), rng.random((20, 24)) + 1),
        },
        coords={"wavelength": WAVES},
    )
    other = xr.Dataset({"estimate": (("y", "x"), rng.random((20, 24)))})
    for one, truth in ((field, field["estimate"]), (depth, depth), (other, other["estimate"])):
        figure = side_by_side({("a", ""): one, ("b", ""): one}, truth if known else None)
        said = [text.get_text() for text, _ in texts(figure)]
        assert ("truth" in said) == known


def test_every_picture_stands_in_a_place_of_its_own():
    figure = paper_figure(_cubes({(str(n), "x"): np.ones((5, 8, 8)) for n in range(8)}, None, WAVES.tolist()))
    boxes = [axis.get_position() for axis in figure.axes]
    assert not any(one.padded(-1e-6).overlaps(other.padded(-1e-6)) for one, other in combinations(boxes, 2))


def test_one_bad_decoder_does_not_make_the_errors_of_the_others_black():
    truth = cube(99)["estimate"]
    levels = {"good": 0.02, "fair": 0.03, "bad": 40.0}
    some = {("code", name): (truth + level).to_dataset(name="estimate") for name, level in levels.items()}
    figure = side_by_side(some, truth)
    (scale,) = [one for one in texts(figure) if one[0].get_text().startswith("error")]
    assert " ".join(scale[0].get_text().split()) == "error, rms, up to 3 × the best"
    maps = [axis.images[0] for axis in figure.axes if axis.images and axis.images[0].get_clim()[1] < 0.9]
    assert [one.get_clim()[1] for one in maps] == pytest.approx(3 * [0.06], rel=1e-5)
    some.pop(("code", "bad"))
    assert [one.get_text() for one in side_by_side(some, truth).findobj(Text)].count("error, rms") == 1


def test_many_decoders_of_few_codes_stand_beside_each_other():
    truth = cube(99)["estimate"]
    figure = side_by_side(cubes(1, 3), truth)
    written = texts(figure)
    heads = [box.x0 for one, box in written if one.get_text().replace("\n", " ").startswith("decoder")]
    assert len(heads) == 3
    assert heads == sorted(set(heads))
    assert figure.get_figheight() < side_by_side(cubes(3, 3), truth).get_figheight()
