"""``tmca design spectral-depth`` as a user meets it, and its codes in ``tmca simulate``."""

import json

import numpy as np
import pytest
import torch
import xarray as xr

from tests.cli.calls import answer
from tests.cli.refusals import refused
from tmca.cli import main
from tmca.data import rendered_scene, write_dataset
from tmca.priors import GaussianPrior

WAVES = (440e-9, 680e-9)
QUICK = {"--bands": 2, "--planes": 3, "--window": 3, "--starts": 2, "--steps": 1, "--read-noise": 0.002}


def words(**changes):
    """Options, with other values of some."""
    given = QUICK | {f"--{name}": value for name, value in changes.items()}
    return [str(word) for pair in given.items() for word in pair]


SMALL = words()


@pytest.fixture(scope="module")
def prior(tmp_path_factory):
    cube = rendered_scene("chelsea", wavelengths=WAVES, size=(60, 70))["radiance"].values
    learned = GaussianPrior.learn([torch.from_numpy(cube)], (34, 34), wavelengths=WAVES)
    return learned.save(tmp_path_factory.mktemp("prior") / "prior.nc")


@pytest.mark.slow
def test_a_design_leaves_masks_that_can_be_taken_along(capsys, tmp_path, prior):
    own = ["--slots", "2", "--stroke", "4e-7", "--aperture", "1.5e-3", "--filters", "gaussian", "--channels", "rgb"]
    found = answer(capsys, "design", "spectral-depth", "--prior", prior, *words(starts=1, steps=3), *own, "--out", "d")
    assert json.loads((tmp_path / "d" / "design.json").read_text())["advice"] == found["advice"]
    assert [row["slots"] for row in found["designs"]] == [1, 2]
    assert all(row["confusion"] < 0.99 * row["random_confusion"] for row in found["designs"])
    assert all(row["seconds"] > 0 for row in found["designs"])
    pictures = {"fisher.png", "distances.png", "masks_k1.png", "masks_k2.png", "psf_k1.png", "psf_k2.png"}
    codes = {"codes.nc", "codes_k1.nc", "codes_k2.nc"}
    assert {file.name for file in (tmp_path / "d").iterdir()} == {"design.json", "design.html", *pictures, *codes}
    page = (tmp_path / "d" / "design.html").read_text()
    assert page.count(";base64,") == 6
    assert "far too optimistic" in page
    with xr.open_dataset("d/codes.nc") as best, xr.open_dataset(f"d/codes_k{found['slots']}.nc") as same:
        np.testing.assert_array_equal(best["heights"], same["heights"])
        assert "longer path" in best["heights"].attrs["long_name"]
    take = ["simulate", "spectral-depth", "motorcycle", "--reduce", "8", "--crop", "40x44", "--no-figures"]
    main([*take, "--codes", "d/codes_k2.nc", "--out", "s.nc"])
    with xr.open_dataset("d/codes_k2.nc") as codes, xr.open_dataset("s.nc") as taken:
        for name in ("heights", "shutter", "cells"):
            np.testing.assert_allclose(codes[name], taken[name], rtol=1e-6)
        assert float(np.ptp(codes["heights"].values)) <= 4e-7 * (1 + 1e-5)
        assert json.loads(taken.attrs["bench"])["diameter"] == 1.5e-3
        assert json.loads(taken.attrs["depth"])["count"] == 3
        assert taken.sizes["wavelength"] == 8
        assert taken.sizes["channel"] == 3
        assert taken.sizes["filter"] == 4
    capsys.readouterr()
    for given, message in ((("--planes", "4"), "--planes"), (("--slots", "4"), "2, as the codes have")):
        assert message in refused(capsys, *take, "--codes", "d/codes_k2.nc", "--out", "t.nc", *given)
    assert "earlier results" in refused(capsys, "design", "spectral-depth", "--prior", prior, *SMALL, "--out", "d")


@pytest.mark.slow
def test_masks_of_two_buckets_are_taken_along_to_an_estimate(capsys, tmp_path, prior):
    (tmp_path / "sensor.yaml").write_text("buckets: 2\n")
    how = ["--slots", "2", "--sensor", "sensor.yaml", "--out", "d"]
    main(["design", "spectral-depth", "--prior", str(prior), *words(starts=1, steps=2), *how])
    said = capsys.readouterr().out
    assert "| readings of a pixel |" in said
    assert "burst of two frames" in said
    take = ["spectral-depth", "motorcycle", "--reduce", "8", "--crop", "40x44", "--no-figures"]
    main(["simulate", *take, "--codes", "d/codes_k2_two_buckets.nc", "--out", "s.nc"])
    waves = np.linspace(*WAVES, 8)
    cube = rendered_scene("chelsea", wavelengths=waves, size=(60, 70))["radiance"].values
    GaussianPrior.learn([torch.from_numpy(cube)], (34, 34), wavelengths=waves).save("p.nc")
    main(["reconstruct", "s.nc", "--prior", "p.nc", "--window", "4", "--no-figures", "--out", "e.nc"])
    with xr.open_dataset("s.nc") as taken, xr.open_dataset("e.nc") as estimate:
        assert taken["snapshot"].sizes["bucket"] == 2
        assert np.isfinite(estimate["depth"].values).all()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--window", "9"], "larger blocks"),
        (["--bands", "3"], "2 channels"),
        (["--bands", "1"], "2 or more"),
        (["--planes", "2"], "3 or more"),
        (["--steps", "0"], "steps: found 0"),
        (["coffee"], "one of them"),
    ],
)
def test_what_cannot_be_designed_is_one_line(capsys, tmp_path, prior, options, words):
    small = [word for name, value in QUICK.items() if name not in options for word in (name, value)]
    said = refused(capsys, "design", "spectral-depth", "--prior", prior, *small, "--out", "d", *options)
    assert words in said
    assert not (tmp_path / "d").exists()


@pytest.mark.slow
def test_example_scenes_judge_designs_with_windows_of_a_tile_at_least(capsys, tmp_path):
    scene = rendered_scene("chelsea", wavelengths=WAVES, size=(80, 90))
    write_dataset(scene[["radiance"]], tmp_path / "large.nc")
    how = ("--slots", "2", "--depth", "0.5,inf", "--out", "d")
    found = answer(capsys, "design", "spectral-depth", "large.nc", *SMALL, *how)
    assert all(0 < row["judged"] <= row["random_judged"] for row in found["designs"])
    assert "on the example scenes" in found["advice"]
    assert found["caveat"].startswith("The error on example scenes")


def test_scenes_of_other_bands_or_too_small_are_refused(capsys, tmp_path):
    for name, waves, size in (("blue", (420e-9, 440e-9), (60, 70)), ("small", WAVES, (20, 70))):
        write_dataset(rendered_scene("chelsea", wavelengths=waves, size=size)[["radiance"]], tmp_path / f"{name}.nc")
    common = ("design", "spectral-depth", *SMALL, "--out", "d")
    for scenes, words in ((["blue.nc"], "440 to 680 nm"), (["small.nc"], "20"), (["blue.nc", "blue.nc"], "twice")):
        assert words in refused(capsys, *common, *scenes, lines=None)
    assert not (tmp_path / "d").exists()


def test_codes_that_are_none_are_refused(capsys):
    take = ("simulate", "spectral-depth", "motorcycle", "--reduce", "8", "--crop", "40x44", "--codes", "c.nc")
    about = dict.fromkeys(("bench", "depth", "filters", "channels", "exposure", "energy"), "{}")
    parts = {"heights": (("slot", "a", "b"), np.zeros((2, 4, 4))), "cells": (("y", "x"), np.zeros((2, 2)))}
    parts["shutter"] = (("slot_", "y", "x"), np.ones((3, 2, 2)))
    for attrs, words in (({}, "no attribute bench"), (about, "no attribute depth.near")):
        write_dataset(xr.Dataset(parts, attrs=attrs), "c.nc", overwrite=True)
        assert words in refused(capsys, *take)
