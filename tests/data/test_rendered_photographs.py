"""Photographs of one's own: rendered by path and by the folder, resumed, refused where they are none."""

from __future__ import annotations

from functools import wraps

import numpy as np
import pytest
from PIL import Image

from tmca.data import load_scene, read_dataset, read_split, render_folder, rendered_light_field, rendered_scene
from tmca.data.rendering import photographs as engine
from tmca.data.rendering.own import photographs_in
from tmca.data.rendering.photographs import PHOTOGRAPHS, GreyPhotograph, linear_rgb, photograph
from tmca.errors import DataError, OutputError, SettingError


def pixels(seed=0, size=(45, 61)):
    """Coloured patches with a slope over them, (H, W, 3) of 8 bits."""
    rng = np.random.default_rng(seed)
    patches = rng.integers(30, 250, (4, 5, 3)).repeat(-(-size[0] // 4), 0).repeat(-(-size[1] // 5), 1)
    return (patches[: size[0], : size[1]] * np.linspace(0.4, 1, size[1])[:, None]).astype(np.uint8)


def picture(path, seed=0, size=(45, 61), **how):
    Image.fromarray(pixels(seed, size)).save(path, **how)
    return path


@pytest.fixture
def folder(tmp_path):
    place = tmp_path / "photographs"
    (place / "more").mkdir(parents=True)
    for index, name in enumerate(("one.png", "two.bmp", "more/three.png")):
        picture(place / name, index)
    (place / "notes.txt").write_text("no photograph")
    (place / ".hidden.png").write_text("no photograph")
    return place


def test_a_photograph_of_odd_size_is_rendered_by_its_path(tmp_path):
    scene = rendered_scene(picture(tmp_path / "cup.png"), wavelengths=[450e-9, 550e-9, 650e-9])
    assert scene.radiance.shape == (3, 45, 61)
    assert 0 <= float(scene.radiance.min()) < float(scene.radiance.max()) <= 1
    assert scene.attrs["name"] == "cup"
    assert (scene.attrs["photograph"], scene.attrs["split"]) == ("cup.png", "train")
    views = rendered_light_field(tmp_path / "cup.png", views=3, size=(33, 40), seed=2)
    assert views.light_field.shape == (3, 3, 33, 40)
    assert (views.attrs["name"], views.attrs["split"]) == ("cup_2", "train")


def test_content_and_seed_draw_the_scene_and_the_name_does_not(tmp_path):
    first = rendered_scene(picture(tmp_path / "a.png"), size=(20, 20))
    same = rendered_scene(picture(tmp_path / "b.png"), size=(20, 20))
    np.testing.assert_array_equal(first.radiance, same.radiance)
    entries = [photograph(tmp_path / "a.png", seed) for seed in range(8)]
    assert len({entry.illuminant for entry in entries}) > 1
    assert len({entry.near for entry in entries}) == 8
    picture(tmp_path / "b.png", 1)
    other = rendered_scene(tmp_path / "b.png", size=(20, 20))
    assert float(np.abs(first.radiance - other.radiance).max()) > 0.05
    assert all(entry.near < entry.far for entry in entries)


def test_a_name_stays_a_name_and_has_its_own_light(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    picture(tmp_path / "coffee.png")
    assert photograph("coffee", 3) is PHOTOGRAPHS["coffee"]
    assert photograph("coffee.png").source == "coffee.png"


def test_pixels_are_the_same_in_eight_and_sixteen_bits_and_with_alpha(tmp_path):
    import tifffile

    seen = pixels()
    Image.fromarray(seen).save(tmp_path / "a.png")
    Image.fromarray(np.dstack([seen, np.full(seen.shape[:2], 9, np.uint8)])).save(tmp_path / "b.png")
    tifffile.imwrite(tmp_path / "c.tif", seen, photometric="rgb")
    tifffile.imwrite(tmp_path / "d.tif", 257 * seen.astype(np.uint16), photometric="rgb")
    first, *others = (linear_rgb(photograph(path)) for path in sorted(tmp_path.iterdir()))
    for other in others:
        np.testing.assert_allclose(other, first, atol=1e-6)


def test_large_photographs_are_halved(tmp_path):
    assert linear_rgb(photograph(picture(tmp_path / "wide.png", size=(64, 1302)))).shape == (32, 651, 3)
    assert engine.rendered_size(6000, 4000) == (750, 500)
    assert engine.rendered_size(40, 9000) == (40, 9000)


def test_drawn_light_darkens_and_leaves_the_reflectance(tmp_path):
    path = picture(tmp_path / "cup.png", size=(64, 80))
    flat, drawn = (rendered_scene(path, light=light, seed=1) for light in ("flat", "drawn"))
    assert drawn.attrs["light"] == "drawn"
    assert "light" not in flat.attrs
    assert float(drawn.radiance.median()) < float(flat.radiance.median())
    assert 0 <= float(drawn.radiance.min()) <= float(drawn.radiance.max()) <= 1
    assert float(np.abs(drawn.reflectance.mean(("y", "x")) - flat.reflectance.mean(("y", "x"))).max()) < 0.02
    assert np.isfinite(drawn.radiance.values).all()
    again = rendered_scene(path, light="drawn", seed=1)
    np.testing.assert_array_equal(again.radiance, drawn.radiance)


def test_grey_photographs_are_rendered_and_said(tmp_path):
    Image.fromarray(pixels()[..., 0]).save(tmp_path / "grey.png")
    with pytest.warns(GreyPhotograph, match=r"grey\.png: a picture without colours"):
        scene = rendered_scene(tmp_path / "grey.png", size=(20, 20))
    assert float(scene.radiance.max()) > 0.05


def stored(shown, orientation):
    """The pixels of a file whose orientation shows them upright, by Pillow's own turns."""
    back = (None, "FLIP_LEFT_RIGHT", "ROTATE_180", "FLIP_TOP_BOTTOM", "TRANSPOSE", "ROTATE_90", "TRANSVERSE",
            "ROTATE_270")[orientation - 1]  # fmt: skip
    image = Image.fromarray(shown)
    return image if back is None else image.transpose(Image.Transpose[back])


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_photographs_are_rendered_upright(orientation, suffix, tmp_path):
    exif, place = Image.Exif(), tmp_path / "phone"
    exif[274] = orientation
    place.mkdir()
    stored(pixels(size=(45, 64)), orientation).save(place / f"photo{suffix}", exif=exif)
    known = photograph(str(picture(tmp_path / "upright.png", size=(45, 64))))
    assert np.array_equal(linear_rgb(photograph(str(place / f"photo{suffix}"))), linear_rgb(known))
    assert len(render_folder(place, tmp_path / "scenes", size=(40, 60))) == 1


@pytest.mark.parametrize("orientation", [0, 9])
def test_orientations_that_there_are_not_turn_nothing(orientation, tmp_path):
    exif = Image.Exif()
    exif[274] = orientation
    file = picture(tmp_path / "photo.jpg", size=(45, 64), exif=exif)
    assert linear_rgb(photograph(str(file))).shape == (45, 64, 3)


def test_damaged_exif_turns_nothing(tmp_path):
    file = picture(tmp_path / "photo.jpg", size=(45, 64), exif=b"Exif\0\0no header of it")
    assert linear_rgb(photograph(str(file))).shape == (45, 64, 3)


def test_what_is_no_photograph_is_refused(tmp_path):
    (tmp_path / "text.png").write_text("no picture")
    whole = picture(tmp_path / "whole.png").read_bytes()
    (tmp_path / "cut.png").write_bytes(whole[: len(whole) // 2])
    picture(tmp_path / "tiny.png", size=(20, 90))
    Image.fromarray(np.zeros((40, 40, 4), np.uint8), "CMYK").save(tmp_path / "inks.jpg")
    (tmp_path / "scene.nc").write_text("no picture")
    found = {
        "text.png": "unreadable", "cut.png": "unreadable", "tiny.png": "20×90 pixels", "inks.jpg": "inks",
        "scene.nc": "a file .nc", "gone.png": "no such file", ".": "a folder",
    }  # fmt: skip
    for name, said in found.items():
        with pytest.raises(DataError, match=said):
            rendered_scene(tmp_path / name)
    with pytest.raises(SettingError, match="the path of a photograph"):
        rendered_scene("cofee")


def test_a_folder_is_rendered_and_its_split_read(folder, tmp_path):
    files = render_folder(folder, tmp_path / "scenes", size=(16, 18), light="drawn", seed=1)
    assert [file.name for file in files] == ["more_three.nc", "one.nc", "two.nc"]
    assert read_split(tmp_path / "scenes" / "scenes.txt") == files
    assert load_scene(files[0], bands=4).shape == (4, 16, 18)
    assert {path.name for path in (tmp_path / "scenes").iterdir()} == {*(f.name for f in files), "scenes.txt"}


def test_what_was_stopped_goes_on(folder, tmp_path, monkeypatch):
    calls, told = [], []
    render = rendered_scene

    @wraps(rendered_scene)
    def stops(path, **how):
        calls.append(path.name)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return render(path, **how)

    monkeypatch.setattr("tmca.data.rendered_folders.rendered_scene", stops)
    out, how = tmp_path / "scenes", {"size": (16, 18), "progress": lambda *said: told.append(said)}
    with pytest.raises(KeyboardInterrupt):
        render_folder(folder, out, **how)
    assert [path.name for path in out.iterdir()] == ["more_three.nc"]
    before = (out / "more_three.nc").stat().st_mtime_ns
    assert len(render_folder(folder, out, **how)) == 3
    assert (out / "more_three.nc").stat().st_mtime_ns == before
    assert calls == ["three.png", "one.png", "one.png", "two.bmp"]
    assert told[-1] == (0.5, None, "two")


def test_a_larger_number_keeps_the_scenes_of_a_smaller_one(folder, tmp_path):
    out, how = tmp_path / "scenes", {"size": (16, 18)}
    two = render_folder(folder, out, number=2, **how)
    assert {*two} < {*render_folder(folder, out, number=3, **how)}
    with pytest.raises(OutputError, match="other scenes"):
        render_folder(folder, out, number=2, **how)
    with pytest.raises(SettingError, match="number: found 4"):
        render_folder(folder, out, number=4, **how)


def test_a_folder_with_other_scenes_is_refused(folder, tmp_path):
    out = tmp_path / "scenes"
    render_folder(folder, out, number=1, size=(16, 18))
    with pytest.raises(OutputError, match=r'a scene rendered by \{"light": "drawn", "seed": 0, "size": \[16, 18\]\}'):
        render_folder(folder, out, number=1, size=(16, 17))
    (only,) = render_folder(folder, out, number=1, size=(16, 17), overwrite=True)
    assert read_dataset(only).sizes["x"] == 17
    picture(photographs_in(folder)[only.stem], 7)
    with pytest.raises(OutputError, match="another photograph"):
        render_folder(folder, out, number=1, size=(16, 17))


def test_a_folder_that_cannot_be_rendered_is_refused_before_anything_is(folder, tmp_path):
    out = tmp_path / "scenes"
    with pytest.raises(DataError, match=r"45×61 pixels, expected 50×50 or more"):
        render_folder(folder, out, size=(50, 50))
    (folder / "zz.png").write_text("no picture")
    with pytest.raises(DataError, match=r"zz\.png: found an unreadable"):
        render_folder(folder, out)
    picture(folder / "one.jpg")
    with pytest.raises(DataError, match="the scene's name one"):
        render_folder(folder, out)
    (tmp_path / "empty").mkdir()
    for place in ("empty", "gone", "photographs/notes.txt"):
        with pytest.raises(DataError, match=r"expected (files|a folder of photographs)"):
            render_folder(tmp_path / place, out)
    assert not out.exists()


def test_pictures_in_inks_are_refused(tmp_path):
    Image.fromarray(pixels()).convert("CMYK").save(tmp_path / "print.tif")
    with pytest.raises(DataError, match=r"inks \(CMYK\)"):
        rendered_scene(tmp_path / "print.tif")


def test_arguments_of_another_engine_are_refused(folder, tmp_path):
    with pytest.raises(SettingError, match="illuminant"):
        render_folder(folder, tmp_path / "out", views=3, illuminant="A")
    assert not (tmp_path / "out").exists()
