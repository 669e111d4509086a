"""Bad input: one clear line (file, found, expected, what to do), exit code 2, nothing lost, nothing half-written."""

import errno
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import torch
import xarray as xr

from tests.cli.refusals import refused
from tmca.cameras import Snapshot, SpectralCamera
from tmca.cli import main


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def cube(name, values, **variables):
    scipy.io.savemat(name, {"cube": np.asarray(values), **variables})


def small_snapshot(name="s_snapshot.nc"):
    camera = SpectralCamera(bands=12, size=(8, 20), slots=2)
    return Snapshot(torch.rand(1, *camera.snapshot_shape), camera).save(name)


def good():
    return np.random.default_rng(0).random((12, 14, 31))


def write_bad(kind):
    values = good()
    if kind == "nan.mat":
        values[3, 4, 5] = np.nan
    if kind == "negative.mat":
        values[3, 4, 5] = -0.5
    if kind == "bands.mat":
        values = np.random.default_rng(0).random((40, 41, 7))
    cube(kind, values)
    if kind == "truncated.mat":
        whole = Path(kind).read_bytes()
        Path(kind).write_bytes(whole[: len(whole) // 2])
    return kind


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("nan.mat", ["nan.mat", "NaN"]),
        ("negative.mat", ["negative.mat", "negative", "-0.5"]),
        ("bands.mat", ["bands.mat", "7", "wavelengths"]),
        ("truncated.mat", ["truncated.mat"]),
    ],
)
def test_cubes_that_cannot_be_used(capsys, tmp_path, kind, words):
    write_bad(kind)
    line = refused(capsys, "simulate", "spectral", kind)
    assert all(word in line for word in words), line
    assert sorted(p.name for p in tmp_path.iterdir()) == [kind]


def test_too_few_bands_for_the_camera(capsys):
    cube("seven.mat", np.random.default_rng(0).random((40, 41, 7)))
    line = refused(capsys, "simulate", "spectral", "seven.mat", "--wavelengths", "400:700:7", "--bands", 12)
    assert "seven.mat" in line
    assert "12" in line
    assert "7" in line


def test_wrong_number_of_wavelengths(capsys):
    cube("seven.mat", np.random.default_rng(0).random((40, 41, 7)))
    line = refused(capsys, "simulate", "spectral", "seven.mat", "--wavelengths", "400:700:9")
    assert "7" in line
    assert "9" in line


def test_empty_folder_and_missing_file(capsys, tmp_path):
    (tmp_path / "empty").mkdir()
    assert "empty" in refused(capsys, "simulate", "spectral", "empty")
    assert "nothing.mat" in refused(capsys, "simulate", "spectral", "nothing.mat")
    assert "coffe" in refused(capsys, "simulate", "spectral", "coffe")
    assert "nothing.nc" in refused(capsys, "reconstruct", "nothing.nc")
    assert "nothing.nc" in refused(capsys, "inspect", "nothing.nc")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["simulate", "spectral", "coffee", "--slotz", "4"], ["--slotz", "--slots"]),
        (["simulate", "spektral", "coffee"], ["spektral", "spectral"]),
        (["recnstruct", "x.nc"], ["recnstruct", "reconstruct"]),
        (["simulate", "spectral", "coffee", "--slots", "many"], ["slots", "many"]),
        (["simulate", "spectral"], ["scene"]),
        (["simulate", "spectral", "coffee", "--shutter", "onehot"], ["onehot", "one-hot"]),
        (["simulate", "spectral", "coffee", "--preset", "tesis"], ["tesis", "thesis"]),
        (["simulate", "spectral", "coffee", "--crop", "64"], ["64", "HEIGHTxWIDTH"]),
        (["simulate", "spectral", "coffee", "--crop", "6400x64"], ["6400×64", "400×600", "coffee"]),
        (["simulate", "spectral", "coffee", "--crop", "16x40", "--dispersion", "1,2"], ["--dispersion", "12"]),
        (["simulate", "spectral", "coffee", "--crop", "16x40", "--read-noise=-1"], ["--read-noise", "-1"]),
        (["simulate", "spectral", "coffee", "--crop", "16x40", "--slots", "0"], ["slots", "0"]),
        (["simulate", "spectral", "coffee", "--crop", "16x40", "--exposure", "mean"], ["mean", "per-slot"]),
    ],
)
def test_wrong_options_suggest_the_right_ones(capsys, arguments, words):
    line = refused(capsys, *arguments)
    assert all(word.lower() in line.lower() for word in words), line


def test_an_output_that_exists_is_kept(capsys, tmp_path):
    arguments = ["simulate", "spectral", "coffee", "--crop", "16x40", "--out", "s.nc", "--no-figures"]
    main(arguments)
    before = (tmp_path / "s.nc").read_bytes()
    assert "s.nc" in refused(capsys, *arguments)
    assert (tmp_path / "s.nc").read_bytes() == before
    main([*arguments, "--overwrite", "--seed", "1"])
    assert (tmp_path / "s.nc").read_bytes() != before


def test_codes_of_another_size(capsys):
    np.save("codes.npy", np.ones((8, 10, 10)))
    line = refused(capsys, "simulate", "spectral", "coffee", "--crop", "16x40", "--aperture", "codes.npy")
    assert "10×10" in line
    assert "16×40" in line


def test_a_snapshot_without_its_codes(capsys, tmp_path):
    with xr.open_dataset(small_snapshot()) as dataset:
        dataset.load().drop_vars(["aperture", "shutter"]).to_netcdf("bare.nc", engine="h5netcdf")
    line = refused(capsys, "reconstruct", "bare.nc")
    assert "bare.nc" in line
    assert "aperture" in line
    assert not (tmp_path / "bare_lmmse.nc").exists()


def test_a_full_disk_leaves_nothing_half_written(capsys, tmp_path, monkeypatch):
    def full(*arguments, **options):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    line = refused(capsys, "simulate", "spectral", "coffee", "--crop", "16x40", "--out", "s.nc", "--no-figures")
    assert "s.nc" in line
    assert "space" in line.lower()
    assert list(tmp_path.iterdir()) == []


def test_decoder_and_prior_that_do_not_fit(capsys):
    small_snapshot()
    assert "admm-tv" in refused(capsys, "reconstruct", "s_snapshot.nc", "--decoder", "lmsse")
    np.save("p.npy", np.ones(3))
    assert "p.npy" in refused(capsys, "reconstruct", "s_snapshot.nc", "--prior", "p.npy")


def test_the_input_is_never_overwritten(capsys, tmp_path):
    before = small_snapshot().read_bytes()
    line = refused(capsys, "reconstruct", "s_snapshot.nc", "-d", "dagger", "--out", "s_snapshot.nc", "--overwrite")
    assert "input" in line
    assert (tmp_path / "s_snapshot.nc").read_bytes() == before


def test_a_prior_at_other_bands_and_options_that_do_not_apply(capsys):
    from tmca.data import rendered_scene, select_bands
    from tmca.priors import learn_prior

    small_snapshot()
    example = select_bands(rendered_scene("astronaut", size=(48, 48))["radiance"], 12)
    shifted = example.assign_coords(wavelength=example["wavelength"] + 20e-9)
    learn_prior([shifted], extent=11, block=(2, 30)).save("prior.nc")
    assert "420" in refused(capsys, "reconstruct", "s_snapshot.nc", "--prior", "prior.nc")
    assert "prior" in refused(capsys, "reconstruct", "s_snapshot.nc", "-d", "dagger", "--prior", "prior.nc")
    assert "--tv-weight" in refused(capsys, "reconstruct", "s_snapshot.nc", "-d", "dagger", "--tv-weight", "0.1")


@pytest.mark.parametrize("option", ["--dispersion=1e6", "--relay-blur=-1", "--seed=99999999999999999999"])
def test_impossible_numbers(capsys, tmp_path, option):
    refused(capsys, "simulate", "spectral", "coffee", "--crop", "16x40", option)
    assert list(tmp_path.iterdir()) == []


def test_closed_codes_and_a_file_for_a_folder(capsys, tmp_path):
    np.save("dark.npy", np.zeros((8, 16, 40)))
    assert "light" in refused(capsys, "simulate", "spectral", "coffee", "--crop", "16x40", "--aperture", "dark.npy")
    assert "dark.npy" in refused(capsys, "demo", "--out", "dark.npy", "--size", "40x48")


def test_truth_of_another_size_or_bands(capsys):
    small_snapshot()
    cube("tiny.mat", np.random.default_rng(0).random((5, 6, 31)))
    line = refused(capsys, "reconstruct", "s_snapshot.nc", "-d", "dagger", "--truth", "tiny.mat")
    assert "tiny.mat" in line
    assert "8×20" in line


@pytest.mark.parametrize("damage", ["missing", "altered"])
def test_a_split_that_names_a_missing_or_altered_cube(capsys, tmp_path, damage):
    from tmca.data import write_split

    for name in ("a.mat", "b.mat"):
        cube(name, good())
    write_split([tmp_path / "a.mat"], tmp_path / "train.txt")
    write_split([tmp_path / "b.mat"], tmp_path / "test.txt")
    if damage == "missing":
        (tmp_path / "b.mat").unlink()
    else:
        cube("b.mat", good() * 0.5)
    arguments = ["compare", "spectral", "--train", "train.txt", "--test", "test.txt", "--decoders", "admm-tv"]
    assert "b.mat" in refused(capsys, *arguments, "--out", "results", "--work", "work")
    assert not (tmp_path / "results").exists()
