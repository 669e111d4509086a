"""The page in a browser: what it shows is what the files hold, by mouse and by keys, and its link keeps the view."""

import csv
import io

import numpy as np
import pytest
import xarray as xr

import tmca

CUBE = np.random.default_rng(2).random((7, 24, 32)).astype(np.float32)
NM = np.linspace(430, 670, 7)


def cube(values=CUBE, name="cube"):
    return tmca.data.label(values, NM * 1e-9, {"name": name})


def estimate():
    parts = {
        name: (("wavelength", "y", "x"), values) for name, values in (("estimate", CUBE), ("deviation", 0.1 * CUBE))
    }
    return xr.Dataset(parts, {"wavelength": NM * 1e-9}, {"decoder": "lmmse"})


def spot(looked, row, column, panel=0):
    """Where a pixel of a picture lies on the screen."""
    return looked.ask(
        f"""(() => {{ const panel = [...tmca.desk.panels.values()][{panel}], box = panel.box();
        const own = panel.root.getBoundingClientRect(), [rows, columns] = panel.spec.size;
        return [own.left + box.x + (({column} + 0.5) / columns) * box.w,
                own.top + box.y + (({row} + 0.5) / rows) * box.h] }})()"""
    )


def colour_at(looked, row, column):
    """What is on the screen at a pixel of the first picture, 0 to 255."""
    from PIL import Image

    x, y = spot(looked, row, column)
    looked.page.mouse.move(5, 5)
    looked.page.wait_for_timeout(250)
    return np.asarray(Image.open(io.BytesIO(looked.page.screenshot())))[round(y), round(x), :3].astype(float)


def ready(looked):
    looked.until("tmca.desk.items.every((item) => tmca.planes.whole(item.number, item.layers[0]))")


def test_bands_are_shown_in_their_grey(look):
    looked = look(cube(), hash="#colour=0&plane=2")
    ready(looked)
    low, high = looked.ask("tmca.desk.looks.now.span")
    for row, column in ((0, 0), (11, 20), (23, 31)):
        expected = 255 * np.clip((CUBE[2, row, column] - low) / (high - low), 0, 1)
        np.testing.assert_allclose(colour_at(looked, row, column), expected, atol=1.5)
    assert looked.errors == []


def test_the_spectrum_at_a_click_is_that_of_the_pixel(look):
    looked = look(cube())
    ready(looked)
    looked.page.mouse.click(*spot(looked, 9, 21))
    looked.page.mouse.move(*spot(looked, 3, 4))
    looked.until("tmca.desk.lines?.[1]?.name.endsWith('row 3, column 4')")
    kept, cursor = looked.ask("tmca.desk.lines.map((line) => Array.from(line.y))")
    np.testing.assert_allclose(kept, CUBE[:, 9, 21], rtol=1e-6)
    np.testing.assert_allclose(cursor, CUBE[:, 3, 4], rtol=1e-6)
    assert "row 9, column 21" in looked.page.inner_text("ul.places")


def test_regions_have_mean_and_spread(look):
    looked = look(cube())
    ready(looked)
    looked.page.keyboard.down("Shift")
    looked.page.mouse.move(*spot(looked, 4, 6))
    looked.page.mouse.down()
    looked.page.mouse.move(*spot(looked, 8, 9), steps=4)
    looked.page.mouse.up()
    looked.page.keyboard.up("Shift")
    looked.until("tmca.desk.lines?.[0]?.band")  # the middle's spectrum, drawn before, has none
    assert looked.ask("tmca.desk.places") == [[4, 9, 6, 10]]
    mean, spread = looked.ask("[tmca.desk.lines[0].y, tmca.desk.lines[0].band].map((one) => Array.from(one))")
    np.testing.assert_allclose(mean, CUBE[:, 4:9, 6:10].mean((1, 2)), rtol=1e-5)
    np.testing.assert_allclose(spread, CUBE[:, 4:9, 6:10].std((1, 2)), rtol=1e-4)


def test_an_estimate_has_its_deviation_around_its_spectrum_and_the_truth_beside_it(look):
    looked = look(estimate(), cube(CUBE * 0.9, "other"), hash="#points=5,6&against=1&show=difference,error,deviation")
    ready(looked)
    looked.until("tmca.desk.lines?.length === 2 && tmca.desk.lines[0].band")
    first, second = looked.ask("tmca.desk.lines.map((line) => Array.from(line.y))")
    np.testing.assert_allclose(first, CUBE[:, 5, 6], rtol=1e-6)
    np.testing.assert_allclose(second, 0.9 * CUBE[:, 5, 6], rtol=1e-6)
    np.testing.assert_allclose(looked.ask("Array.from(tmca.desk.lines[0].band)"), 0.1 * CUBE[:, 5, 6], rtol=1e-5)
    looked.until("tmca.desk.errorMap(tmca.desk.items[0]) !== null")
    error = looked.ask("Array.from(tmca.desk.errorMap(tmca.desk.items[0]).data)")
    np.testing.assert_allclose(error, np.sqrt(((0.1 * CUBE) ** 2).mean(0)).ravel(), rtol=1e-4)
    titles = looked.ask("[...tmca.desk.panels.values()].map((panel) => panel.spec.title)")
    assert titles == ["lmmse", "other", "lmmse: deviation", "lmmse − other", "lmmse: error"]
    assert looked.errors == []


def test_two_files_of_one_shape_are_compared_and_the_spectrum_is_that_of_the_middle_at_first(look):
    looked = look(estimate(), cube(CUBE * 0.9, "other"))
    ready(looked)
    looked.until("tmca.desk.lines?.length === 2")
    first, second = looked.ask("tmca.desk.lines.map((line) => Array.from(line.y))")
    middle = tuple(side // 2 for side in CUBE.shape[1:])
    np.testing.assert_allclose(first, CUBE[:, *middle], rtol=1e-6)
    np.testing.assert_allclose(second, 0.9 * CUBE[:, *middle], rtol=1e-6)
    titles = looked.ask("[...tmca.desk.panels.values()].map((panel) => panel.spec.title)")
    assert titles == ["lmmse", "other", "lmmse: error"]
    assert looked.ask("tmca.desk.select.value") == "1"
    looked.page.get_by_label("Compare with").select_option("nothing")
    looked.until("location.hash.includes('against=-1')")
    again = look(address=looked.ask("location.href"))
    ready(again)
    assert again.ask("tmca.desk.against === null")


def test_a_link_keeps_the_view(look):
    first = look(cube())
    ready(first)
    first.page.mouse.click(*spot(first, 9, 21))
    first.page.keyboard.press("b")
    first.page.keyboard.press(".")
    for _ in range(3):
        first.page.mouse.wheel(0, -300)
    first.until("location.hash.includes('view=')")
    first.page.wait_for_timeout(400)
    state = first.ask(
        "JSON.stringify([tmca.desk.index, tmca.desk.coloured, tmca.desk.places, tmca.desk.view.zoom.toFixed(3)])"
    )
    second = look(address=first.ask("location.href"))
    assert (
        second.ask(
            "JSON.stringify([tmca.desk.index, tmca.desk.coloured, tmca.desk.places, tmca.desk.view.zoom.toFixed(3)])"
        )
        == state
    )


@pytest.mark.parametrize(
    "text", ["plane=999&points=1,2;9999,3;x&view=a,b&regions=1,2", "page=7&against=12&show=&spans=a:b:c"]
)
def test_a_link_that_says_nonsense_does_no_harm(look, text):
    looked = look(cube(), hash=f"#{text}")
    ready(looked)
    assert looked.errors == []
    assert looked.ask("tmca.desk.places.every(([y, x]) => y < 24 && x < 32)")
    assert looked.ask("tmca.desk.index >= 0 && tmca.desk.index < 7")


def test_all_of_it_is_reached_by_keys(look):
    looked = look(cube())
    ready(looked)
    reached = set()
    for _ in range(30):
        looked.page.keyboard.press("Tab")
        reached.add(
            looked.ask("document.activeElement.id || document.activeElement.className || document.activeElement.type")
        )
    assert {"link", "png", "csv", "ask", "panel", "range"} <= reached
    looked.ask("document.querySelector('.panel').focus()")
    looked.page.keyboard.press("ArrowRight")
    looked.page.keyboard.press("Shift+ArrowDown")
    looked.page.keyboard.press("Enter")
    assert looked.ask("tmca.desk.places") == [[22, 17]]
    looked.page.keyboard.press("+")
    assert looked.ask("tmca.desk.view.zoom") > 1
    looked.page.keyboard.press("?")
    assert "Shift + drag" in looked.page.inner_text("dialog")
    looked.page.keyboard.press("Escape")
    assert not looked.ask("document.getElementById('help').open")


def test_tables_and_pictures_are_saved(look, tmp_path):
    from PIL import Image

    looked = look(cube(), hash="#points=9,21&colour=0")
    ready(looked)
    looked.until("tmca.desk.lines?.length === 1")
    with looked.page.expect_download() as saved:
        looked.page.click("#csv")
    saved.value.save_as(tmp_path / "curves.csv")
    rows = list(csv.reader((tmp_path / "curves.csv").open()))
    assert rows[0] == ["wavelength (nm)", "cube, row 9, column 21"]
    np.testing.assert_allclose([float(row[1]) for row in rows[1:]], CUBE[:, 9, 21], rtol=1e-5)
    for button, size in (("#png", None), (".panel .save", (32, 24))):
        with looked.page.expect_download() as saved:
            looked.page.click(button)
        saved.value.save_as(tmp_path / "picture.png")
        with Image.open(tmp_path / "picture.png") as picture:
            assert picture.getextrema()[0][1] > 100
            assert size is None or picture.size == size


def test_the_axes_are_those_of_the_cube_before_any_curve_and_stay_unless_they_are_to_fit(look):
    looked = look(cube(CUBE * np.linspace(1, 0.2, 32, dtype=np.float32)))
    ready(looked)
    begun = looked.ask("tmca.desk.plot.frame")
    assert (begun["low"], begun["high"]) == (430, 670)
    for column in (0, 31):
        looked.page.mouse.move(*spot(looked, 7, column))
        looked.until(f"tmca.desk.lines?.[0]?.name.endsWith('column {column}')")
        assert looked.ask("tmca.desk.plot.frame") == begun
    looked.page.click("text=fit")
    looked.until(f"tmca.desk.plot.frame.ceiling < {0.5 * begun['ceiling']}")


def test_curves_of_files_and_of_places_have_colours_of_their_own(look):
    looked = look(cube(), cube(CUBE * 0.9, "other"), hash="#points=1,2;3,4")
    ready(looked)
    looked.page.mouse.move(*spot(looked, 7, 9))
    looked.until("tmca.desk.lines?.length === 6")
    colours = looked.ask("tmca.desk.lines.map((line) => line.colour)")
    assert colours[0] == colours[1] != colours[2] == colours[3]
    assert len(set(colours)) == 4


def test_the_ground_is_light_where_it_is_asked_for(look):
    looked = look(cube())
    ready(looked)
    assert max(corner(looked)) < 40
    looked.page.keyboard.press("t")
    looked.until("location.hash.includes('ground=light')")
    assert corner(looked) == (255, 255, 255)
    again = look(address=looked.ask("location.href"))
    ready(again)
    assert corner(again) == (255, 255, 255)


def corner(looked):
    """The colour of the stage beside the picture."""
    from PIL import Image

    return Image.open(io.BytesIO(looked.page.screenshot())).convert("RGB").getpixel((4, 690))


def test_a_slot_is_as_wide_as_the_others(look):
    camera = tmca.SpectralCamera(3, (8, 9), slots=4, shutter="random")
    scene = tmca.data.label(np.ones((3, 8, 9), np.float32), camera.wavelengths)
    looked = look(tmca.simulate(scene, camera), hash="#page=2&points=2,3")
    looked.until("tmca.desk.lines?.length === 1")
    frame = looked.ask("tmca.desk.plot.frame")
    assert (frame["low"], frame["high"]) == (0.5, 4.5)


def test_a_file_that_vanishes_is_told_on_the_page(look, tmp_path):
    path = tmp_path / "cube.npy"
    np.save(path, np.random.default_rng(0).random((31, 8, 8), np.float32))
    looked = look(path)
    path.unlink()
    looked.ask("tmca.planes.kept.clear(), tmca.desk.move(20)")
    looked.until("document.getElementById('message').textContent.includes('it is gone')")


def test_a_picture_and_its_rulers_are_of_one_size_in_every_frame(look):
    looked = look(cube())
    ready(looked)
    next_frame = "new Promise(requestAnimationFrame)"
    shrunk = f"""(async () => {{ await {next_frame}; tmca.page.style.height = "300px"; await {next_frame};
        return [tmca.painter.canvas.height, tmca.stage.clientHeight] }})()"""
    drawn, stage = looked.ask(shrunk)
    assert drawn == stage < 300
    assert not looked.ask("tmca.painter.gl.getContextAttributes().desynchronized")
