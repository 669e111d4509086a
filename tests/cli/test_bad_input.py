"""Bad input: one clear line (file, found, expected, what to do), exit code 2, nothing lost, nothing half-written."""

import errno
import shlex
from pathlib import Path

import numpy as np
import pytest
import tifffile
import torch

from tests.cli.refusals import refused
from tests.cli.small_files import cube, good, labelled, small_snapshot
from tests.lab.calibration.test_buckets import two_buckets
from tmca.cameras import Snapshot, SpectralCamera
from tmca.cli import main
from tmca.data import read_dataset, rendered_scene, select_bands, write_split
from tmca.priors import learn_prior

WAVES = np.linspace(400, 700, 31)
MEANINGS = ("sensor", "exposure", "disperser", "full_scale", "origin")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A folder of cubes, codes, snapshots and a prior, good and bad."""
    folder, values = tmp_path_factory.mktemp("files"), good()
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        Path("empty").mkdir()
        cubes(values)
        snapshots()
        buckets()
        np.save("codes.npy", np.ones((8, 10, 10)))
        np.save("dark.npy", np.zeros((8, 16, 40)))
        np.save("patterns.npy", np.eye(40)[None, :16].repeat(3, 0).astype(np.uint8))
        np.save("colours.npy", np.ones((12, 24, 24), np.float32))
        example = select_bands(rendered_scene("astronaut", size=(48, 48))["radiance"], 12)
        shifted = example.assign_coords(wavelength=example["wavelength"] + 20e-9)
        learn_prior([shifted], extent=11, block=(2, 30)).save("prior.nc")
    return folder


def cubes(values):
    spoilt = values.copy()
    spoilt[3, 4, 5] = np.nan
    cube("good.mat", values)
    cube("nan.mat", spoilt)
    cube("seven.mat", np.random.default_rng(0).random((40, 41, 7)))
    cube("small.mat", values[:6])
    Path("truncated.mat").write_bytes(Path("good.mat").read_bytes()[:3000])
    np.save("negative.npy", values - 0.1)
    np.save("five.npy", values[..., :5])
    labelled("few.nc", values[..., ::3], WAVES[::3])
    labelled("five.nc", values[..., :5], [400.0, 450.0, 500.0, 600.0, 700.0])
    for bands in (31, 20):
        labelled(f"zero{bands}.nc", values[..., :bands], np.zeros(bands))
        labelled(f"nan{bands}.nc", values[..., :bands], np.where(np.arange(bands) == 2, np.nan, WAVES[:bands]))


def snapshots():
    whole = read_dataset(small_snapshot("s.nc"))
    whole.drop_vars(["aperture", "shutter"]).to_netcdf("bare.nc", engine="h5netcdf")
    whole.assign_attrs(full_scale=3.0).to_netcdf("wrong.nc")
    for name in MEANINGS:
        silent = whole.copy()
        del silent.attrs[name]
        silent.to_netcdf(f"no_{name}.nc")


def buckets():
    """A snapshot of two buckets, its export, a calibration, and frames without one of them, or with both exchanged."""
    two = SpectralCamera(3, (16, 18), slots=2, buckets=2)
    Snapshot(torch.zeros(1, *two.snapshot_shape), two).save("two.nc")
    devices = "--device dli4120 --device coded-exposure-two-bucket"
    main(shlex.split(f"export two.nc {devices} --no-figures --out shown"))
    two_buckets().save("two")
    Path("first").mkdir()
    for number, name in enumerate(["exposure", *(f"dark{n}" for n in range(4))]):
        tifffile.imwrite(f"first/{name}.tif", np.full((16, 20), 90 + number, np.uint16))
    Path("swapped").mkdir()
    for bucket in range(2):
        frame = np.full((2, 5, 7), 90, np.uint16)
        frame[1 - bucket] = 2000
        tifffile.imwrite(f"swapped/bucket_{bucket}_0.tif", frame)


TAKE = "simulate spectral coffee --crop 16x40"
REFUSED = {
    "simulate spectral nan.mat": ("nan.mat", "NaN"),
    "simulate spectral seven.mat": ("seven.mat", "7", "wavelengths"),
    "simulate spectral seven.mat --wavelengths 400:700:7 --bands 12": ("seven.mat", "12", "7"),
    "simulate spectral seven.mat --wavelengths 400:700:9": ("7", "9"),
    "simulate spectral truncated.mat": ("truncated.mat",),
    "simulate spectral negative.npy --wavelengths 400:700:31": ("--negative clip",),
    "simulate spectral empty": ("empty",),
    **{f"simulate spectral {name}.nc --bands 3": ("a wavelength from the file that is not a positive number",)
       for name in ("zero31", "zero20", "nan31", "nan20")},
    f"{TAKE} --aperture codes.npy": ("10×10", "16×40"),
    f"{TAKE} --aperture dark.npy": ("light",),
    f"{TAKE} --aperture patterns.npy --slots 5": ("--slots 3",),
    f"{TAKE} --coloured colours.npy": ("--coloured", "(12, 16, 40)"),
    "simulate spectral coffee chelsea --crop 24x24": ("slots",),
    "demo --out dark.npy --size 40x48": ("dark.npy",),
    "evaluate good.mat few.nc": ("few.nc: found 11 bands, expected 31",),
    "evaluate s.nc good.mat": ("s.nc: found a snapshot", "tmca reconstruct"),
    "evaluate good.mat s.nc": ("s.nc: found a snapshot, expected a scene; name one",),
    "simulate light-field s.nc": ("s.nc: found a snapshot, expected a scene; name one",),
    "evaluate good.mat small.mat": ("small.mat: found 6×14 (y, x)",),
    "evaluate five.npy five.nc": ("--wavelengths in nm",),
    "inspect s.nc --figure s.foo": (".png .pdf .svg",),
    "reconstruct bare.nc": ("bare.nc", "aperture"),
    "reconstruct wrong.nc -d dagger": ("full_scale 3, expected 12",),
    **{f"reconstruct no_{name}.nc -d dagger": (f"no_{name}.nc: found no attribute {name}",) for name in MEANINGS},
    "reconstruct s.nc --decoder lmsse": ("admm-tv", "did you mean lmmse?"),
    "reconstruct s.nc --decoder likelihood": ("which is for spectral-depth cameras",),
    "reconstruct s.nc -d admm-tv --set iterations=2.5": ("a whole number",),
    "reconstruct s.nc -d admm-tv --set tv_wieght=2": ("did you mean tv_weight?",),
    "reconstruct s.nc --prior codes.npy": ("codes.npy",),
    "reconstruct s.nc --prior prior.nc": ("420",),
    "reconstruct s.nc -d dagger --prior prior.nc": ("prior",),
    "reconstruct s.nc -d dagger --dictionary codes.npy": ("--dictionary",),
    "reconstruct s.nc -d dagger --tv-weight 0.1": ("--tv-weight",),
    "reconstruct s.nc -d dagger --truth small.mat": ("small.mat", "8×20"),
    "reconstruct s.nc -d dagger --truth good.mat --pattern {row}_{column}.png": ("--pattern",),
    "reconstruct s.nc -d dagger --out s.nc --overwrite": ("input",),
    "export two.nc --device coded-exposure --out e": ("coded-exposure: found codes of 2 buckets, expected 1",),
    "export s.nc --device coded-exposure-two-bucket --out e": ("closed slots to a drain, expected 2",),
    "export two.nc --device coded-exposure-two-bucket --exposure 1e-5 --out e": ("39000 at most",),
    "capture shown --device folder --set path=first --out c": ("a frame of 16×20, expected 2×16×20", "buckets"),
    "calibrate buckets swapped --onto two": ("of a bucket's light in others", "exchanged"),
    "calibrate dark first --onto two": ("frames of 16×20 pixels, expected 2×5×7",),
    "reconstruct s.nc -d dagger --calibration two": ("sensor of 2×5×7 pixels",),
}  # fmt: skip


@pytest.mark.parametrize("command", REFUSED)
def test_what_cannot_be_used_is_named_and_every_file_stays(capsys, monkeypatch, files, command):
    monkeypatch.chdir(files)
    before = {file: file.stat().st_mtime_ns for file in files.rglob("*")}
    line = refused(capsys, *shlex.split(command))
    assert all(word in line for word in REFUSED[command]), line
    assert {file: file.stat().st_mtime_ns for file in files.rglob("*")} == before


def test_an_output_that_exists_is_kept(capsys, tmp_path):
    arguments = ["simulate", "spectral", "coffee", "--crop", "16x40", "--out", "s.nc", "--no-figures"]
    main(arguments)
    before = (tmp_path / "s.nc").read_bytes()
    assert "s.nc" in refused(capsys, *arguments)
    assert (tmp_path / "s.nc").read_bytes() == before
    main([*arguments, "--overwrite", "--seed", "1"])
    assert (tmp_path / "s.nc").read_bytes() != before


def test_a_full_disk_leaves_nothing_half_written(capsys, tmp_path, monkeypatch):
    def full(*arguments, **options):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("tmca.data.atomic._place", full)
    line = refused(capsys, *shlex.split(TAKE), "--out", "s.nc", "--no-figures")
    assert "s.nc" in line
    assert "space" in line.lower()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("damage", ["missing", "altered"])
def test_a_split_that_names_a_missing_or_altered_cube(capsys, tmp_path, damage):
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
