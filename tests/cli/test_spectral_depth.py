"""``tmca simulate|reconstruct spectral-depth`` as a user calls them, and what inspect says of scenes with depth."""

import json

import numpy as np
import pytest
import torch
import xarray as xr
from PIL import Image

from tests.cli.calls import answer, said
from tests.cli.refusals import refused
from tests.data import rgbd_scenes as scenes
from tmca.cameras import SpectralDepthCamera
from tmca.cameras.phase_codes import write_phase_codes
from tmca.cli import main
from tmca.data import label_depth, label_spectral_depth, rendered_scene, write_dataset
from tmca.data.depth_scenes import load_spectral_depth
from tmca.data.fitting import fitted_depth
from tmca.optics import PhaseMaskBench, mask_heights
from tmca.priors import GaussianPrior

WAVES = (480e-9, 620e-9)
QUICK = SpectralDepthCamera.from_preset("quick", size=(32, 32)).wavelengths


def chelsea():
    """A rendered cube at the bands of the quick preset."""
    return rendered_scene("chelsea", wavelengths=QUICK, size=(60, 70))[["radiance"]]


@pytest.fixture(scope="module")
def prior(tmp_path_factory):
    learned = GaussianPrior.learn([torch.from_numpy(chelsea()["radiance"].values)], (42, 42), wavelengths=QUICK)
    return learned.save(tmp_path_factory.mktemp("prior") / "prior.nc")


SIMULATE = ("simulate", "spectral-depth", "motorcycle", "--reduce", "8", "--crop", "40x44")


def simulate(*more):
    main([*SIMULATE, *more])


@pytest.mark.slow
def test_a_scene_becomes_a_snapshot_and_again_cube_and_depth(capsys, tmp_path, prior):
    told = answer(capsys, *SIMULATE, "--read-noise", "0.002", "--shutter", "one-hot")
    assert told["bands"] == 8
    assert told["slots"] == 4
    assert told["unknown_depth_pixels"] > 0
    assert {file.name for file in tmp_path.glob("*.png")} == {
        "motorcycle_snapshot.png", "motorcycle_snapshot_codes.png", "motorcycle_snapshot_psf.png"
    }  # fmt: skip
    found = answer(capsys, "reconstruct", "motorcycle_snapshot.nc", "--prior", prior, "--truth", "motorcycle")
    assert found["decoder"] == "likelihood"
    assert found["metrics"]["psnr"] > 15
    truth = load_spectral_depth("motorcycle", WAVES, near=0.4, far=2.0, size=(40, 44), reduce=8)["depth"]
    middle = 2 / (1 / 0.4 + 1 / 2.0)
    assert found["metrics"]["depth_mae"] < 0.8 * float(abs(truth - middle).mean())
    with xr.open_dataset("motorcycle_likelihood.nc") as kept:
        assert kept["depth"].shape == (40, 44)
        assert float(kept["depth"].min()) >= 0.4 - 1e-6
        assert float(kept["depth"].max()) <= 2 + 1e-6
    assert (tmp_path / "motorcycle_likelihood.png").exists()
    again = answer(capsys, "evaluate", "motorcycle_likelihood.nc", "motorcycle", "--figure", "both.png")
    assert again == pytest.approx(found["metrics"], rel=1e-4)
    assert (tmp_path / "both.png").exists()
    assert "--scale: found 2" in refused(capsys, "evaluate", "motorcycle_likelihood.nc", "motorcycle", "--scale", "2")


@pytest.mark.parametrize("more", [(), ("--depth", "0.5,1.5", "--planes", "5", "--preset", "quick-diffractive")])
def test_a_snapshot_needs_its_camera_built_once(monkeypatch, more):
    built, make = [], SpectralDepthCamera.__new__

    def counted(cls, *arguments, **named):
        built.append(named["size"])
        return make(cls, *arguments, **named)

    monkeypatch.setattr(SpectralDepthCamera, "__new__", counted)
    simulate("--no-figures", *more)
    assert built == [(40, 44)]


def test_options_describe_the_camera(capsys):
    bench = ("--aperture", "1.5e-3", "--psf-window", "25", "--oversampling", "4", "--material", "PMMA")
    own = ("--depth", "0.5,1.5", "--planes", "5", "--mask", "rotational", "--rms-nm", "20", "--period", "40")
    simulate("--preset", "quick-diffractive", *own, *bench, "--no-figures")
    capsys.readouterr()
    main(["inspect", "motorcycle_snapshot.nc"])
    with xr.open_dataset("motorcycle_snapshot.nc") as kept:
        assert json.loads(kept.attrs["depth"]) == {"near": 0.5, "far": 1.5, "count": 5}
        told = json.loads(kept.attrs["bench"])
        assert (told["diameter"], told["window"], told["material"]) == (1.5e-3, [25, 25], "PMMA")
        assert told["oversampling"] == 4
        made = mask_heights("rotational", 1, PhaseMaskBench(**told), rms=20e-9)()
        np.testing.assert_allclose(kept["heights"], made, rtol=1e-5, atol=1e-15)
        assert "longer path" in kept["heights"].attrs["long_name"]
        assert kept["cells"].shape == kept["shutter"].shape[1:] == (40, 40)
        assert kept.attrs["inverse_depth_scale"] > 0


def test_a_cube_needs_a_depth_or_a_place(capsys, tmp_path):
    write_dataset(chelsea(), tmp_path / "cube.nc")
    take = ("simulate", "spectral-depth", "cube.nc", "--crop", "40x40")
    assert "depth" in refused(capsys, *take)
    assert "slanted" in refused(capsys, *take, "--placed", "upside-down")
    main([*take, "--placed", "slanted", "--no-figures"])
    with xr.open_dataset("cube_snapshot.nc") as kept:
        assert np.isfinite(kept["snapshot"].values).all()


def test_a_file_of_codes_names_the_option_beside_it(capsys):
    camera = SpectralDepthCamera.from_preset("quick", size=(32, 32), filters="clear", channels="monochrome")
    write_phase_codes(camera, "codes.nc", "clear", "monochrome")
    for given in (("--pitch", "5e-6"), ("--rms-nm", "20"), ("--image-formation", "linear", "--planes", "4")):
        line = refused(capsys, "simulate", "spectral-depth", "chelsea", "--codes", "codes.nc", *given)
        assert f"{given[-2]} beside it" in line


@pytest.mark.filterwarnings("ignore::tmca.optics.StrayLight")  # a narrow window is a fast one
def test_a_prior_is_learned_for_a_snapshot(capsys, tmp_path):
    simulate("--no-figures", "--channels", "monochrome", "--planes", "4", "--psf-window", "17")
    main(["simulate", "spectral", "coffee", "--crop", "32x32", "--no-figures"])
    write_dataset(chelsea(), tmp_path / "cube.nc")
    learn = ("prior", "learn", "cube.nc", "--out", "p.nc", "--like")
    assert "8 × 28 × 28" in said(capsys, *learn, "motorcycle_snapshot.nc")
    main(["reconstruct", "motorcycle_snapshot.nc", "--prior", "p.nc", "--no-figures"])
    assert "--mixture" in refused(capsys, *learn, "motorcycle_snapshot.nc", "--mixture", "--overwrite")
    assert "spectral-depth" in refused(capsys, *learn, "coffee_snapshot.nc", "--overwrite")
    assert "--window: found 12" in refused(capsys, "reconstruct", "coffee_snapshot.nc", "--window", "12")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::tmca.optics.StrayLight")  # a narrow window is a fast one
def test_codes_of_a_large_tile_are_decoded_in_windows_that_hold_it(capsys, tmp_path):
    own = ("--period", "16", "--channels", "monochrome", "--planes", "2", "--psf-window", "11", "--no-figures")
    main(["simulate", "spectral-depth", "motorcycle", "--reduce", "8", "--crop", "32x32", *own])
    write_dataset(chelsea(), tmp_path / "cube.nc")
    learn = ("prior", "learn", "cube.nc", "--out", "p.nc", "--like", "motorcycle_snapshot.nc")
    assert "8 × 26 × 26" in said(capsys, *learn)
    decode = ("reconstruct", "motorcycle_snapshot.nc", "--prior", "p.nc", "--no-figures", "--out")
    main([*decode, "usual.nc"])
    main([*decode, "given.nc", "--window", "16"])
    with xr.open_dataset("usual.nc") as usual, xr.open_dataset("given.nc") as given:
        assert np.isfinite(usual["depth"].values).all()
        xr.testing.assert_allclose(usual["depth"], given["depth"])
    capsys.readouterr()
    for window in ("12", "33"):
        line = refused(capsys, *decode, "other.nc", "--window", window)
        assert f"--window: found {window} pixels, expected 16 (the tile of the codes) to 32 (the sensor)" in line
    assert "--window: found 16 for network" in refused(capsys, *decode[:2], "--weights", "run", "--window", "16")
    assert not (tmp_path / "other.nc").exists()


def table(depth, *more, name="table.nc"):
    """The command that images a file of a textured cube with these depths."""
    cube = np.random.default_rng(0).random((8, *depth.shape)) / 2
    parts = {"radiance": (("wavelength", "y", "x"), cube), "depth": (("y", "x"), depth)}
    xr.Dataset(parts, {"wavelength": np.linspace(440e-9, 680e-9, 8)}).to_netcdf(name)
    return ("simulate", "spectral-depth", name, "--no-figures", *more)


@pytest.mark.parametrize("reduce", [1, 2])
def test_unknown_depth_is_told_by_kind_of_what_is_in_the_crop(capsys, reduce):
    depth = np.full((40, 44), 1.0)
    depth[4:8, 6:16] = [[0, np.nan, -1.0, np.inf, 9.0, 0.3, 2.0, 0.4, 0, 0]]
    depth[8, 6:10] = 2.6  # within half a bin of the farthest of eight planes
    depth[:4] = 0  # beside the crop
    crop = ("--metric-depth", "--crop", "32x32", "--reduce", str(reduce))
    printed = said(capsys, *table(np.kron(depth, np.ones((reduce, reduce))), *crop))
    assert "36 of 1024 pixels of unknown depth (12 zero, 4 negative, 8 not finite, 12 outside)" in printed
    kinds = {"zero": 12, "negative": 4, "not_finite": 8, "outside": 12, "depth_pixels": 36}
    with xr.open_dataset("table_snapshot.nc") as kept:
        assert {name: int(kept.attrs[f"unknown_{name}"]) for name in kinds} == kinds


def test_depths_are_mapped_onto_the_range_or_kept_in_metres(capsys, tmp_path):
    far = np.full((36, 40), 9.0)
    line = refused(capsys, *table(far, "--metric-depth"))
    assert "table: found 1440 of 1440 pixels of unknown depth (1440 outside)" in line
    assert not list(tmp_path.glob("*_snapshot*"))
    assert "unknown" not in said(capsys, *table(far, "--metric-depth", "--depth", "3,12", "--focus", "5"))
    room = np.linspace(2.0, 6.0, 1024).reshape(32, 32)
    assert "depths of 2 to 6 m mapped onto 0.4 to 2 m" in said(capsys, *table(room, name="room.nc"))
    assert "mapped" not in said(capsys, *table(room, "--metric-depth", "--overwrite", name="room.nc"))


def estimate_of(scene, depth, name):
    """A file of an estimate with the cube of its scene."""
    planes = '{"near": 0.4, "far": 2.0, "count": 4}'
    attrs = {"camera": "spectral-depth", "decoder": "x", "depth_planes": planes, **scene.attrs}
    parts = {"depth": (("y", "x"), depth), "confidence": (("y", "x"), np.ones(depth.shape))}
    write_dataset(scene[["radiance"]].assign(parts).assign_attrs(attrs), name)


def test_a_depth_that_says_no_more_than_a_constant_is_told(capsys):
    scene = load_spectral_depth("coffee", WAVES, near=0.4, far=2.0, size=(20, 30), reduce=8)
    write_dataset(scene, "scene.nc")
    estimate_of(scene, np.full((20, 30), 1.9), "flat.nc")
    estimate_of(scene, scene["depth"].values, "true.nc")
    line = "the depth says less than a constant guess, mean error"
    assert line in said(capsys, "evaluate", "flat.nc", "coffee")
    assert "constant guess, mean" not in said(capsys, "evaluate", "true.nc", "coffee")
    both = said(capsys, "evaluate", "true.nc", "flat.nc", "coffee")
    assert f"flat.nc: {line}" in both
    assert "true.nc: the" not in both


@pytest.mark.filterwarnings("ignore:truth")
def test_a_truth_that_is_smaller_than_the_estimate_is_named(capsys):
    scene = load_spectral_depth("coffee", WAVES, near=0.4, far=2.0, size=(20, 30), reduce=8)
    estimate_of(scene, scene["depth"].values, "true.nc")
    write_dataset(load_spectral_depth("coffee", WAVES, near=0.4, far=2.0, size=(96, 96), reduce=1), "small.nc")
    line = refused(capsys, "evaluate", "true.nc", "small.nc")
    read = "12×12 pixels (each the mean of 8×8, as the estimate's scene was read)"
    assert f"small.nc: found {read}, expected at least the 20×30 of the estimate; name the scene" in line


def test_a_mapped_depth_is_said_to_be_one(capsys):
    scene = rendered_scene("coffee", size=(20, 30))[["radiance", "depth"]]
    mapped, about = fitted_depth(scene["depth"], 0.4, 2.0)
    write_dataset(scene.assign(depth=mapped).assign_attrs(about), "mapped.nc")
    near, far = (f"{end(scene['depth'].values):.3g}" for end in (np.min, np.max))
    line = f"metres are those of the mapped scene: depths of {near} to {far} m mapped onto 0.4 to 2 m"
    assert line in said(capsys, "inspect", "mapped.nc")


def test_an_rgbd_scene_is_told_in_figures(capsys, tmp_path):
    text = said(capsys, "inspect", scenes.open3d(tmp_path))
    assert "RGB-D scene (Open3D)" in text
    assert "rgb: 3 × 40 × 60" in text
    assert "5 of 2400 pixels unknown (0.2%: 5 zero)" in text
    stem, _ = scenes.hole_filled(tmp_path / "art")
    assert "depth: known only up to an affine map of inverse depth; 1 of" in said(capsys, "inspect", stem)
    depth = answer(capsys, "inspect", stem)["depth"]
    assert not {"near", "far"} & set(depth)
    assert depth["unknown_pixels"] == 1


def test_a_spectral_scene_with_depth_is_told_in_figures(capsys):
    write_dataset(rendered_scene("coffee", size=(20, 30)), "coffee.nc")
    text = said(capsys, "inspect", "coffee.nc")
    assert "wavelengths: 31 bands, 400 to 700 nm" in text
    assert "0 of 600 pixels unknown" in text


@pytest.mark.parametrize("kind", ["rgbd", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("cube", "folder"))])
def test_the_picture_shows_scene_and_depth(capsys, tmp_path, kind):
    if kind == "rgbd":
        path = scenes.nyuv2(tmp_path)
    else:
        scene = rendered_scene("coffee", size=(20, 30))
        path = tmp_path / "coffee.nc"
        if kind == "cube":
            write_dataset(label_spectral_depth(scene["radiance"], label_depth(scene["depth"].values, "")), path)
        else:
            path = tmp_path / "scene"
            path.mkdir()
            write_dataset(scene["radiance"], path / "cube.nc")
            np.save(path / "depth.npy", scene["depth"].values)
    assert "figure: seen.png" in said(capsys, "inspect", path, "--figure", "seen.png")
    with Image.open("seen.png") as picture:
        assert picture.width > 1.5 * picture.height
        colours = np.asarray(picture.convert("RGB")).reshape(-1, 3)
    assert len(np.unique(colours, axis=0)) > 500


def test_the_spectral_camera_refuses_rgb(capsys, tmp_path):
    stem = scenes.open3d(tmp_path)
    for path in (stem, tmp_path / "room_color_3.png"):
        assert "an RGB picture with depth, expected a spectral scene" in refused(capsys, "simulate", "spectral", path)
    assert "reflectances: --from-rgb" in refused(capsys, "simulate", "spectral-depth", stem)
    scenes.write_picture(tmp_path / "alone.png", scenes.picture())
    assert "colour channels, expected a spectral cube" in refused(capsys, "simulate", "spectral", "alone.png")
