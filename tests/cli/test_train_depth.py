"""``tmca train spectral-depth``, and what its weights are for, as a user calls them."""

import json

import numpy as np
import pytest
import torch
import xarray as xr

from tests.cli.calls import answer
from tests.cli.refusals import refused
from tmca.cameras import SpectralDepthCamera
from tmca.cli import main
from tmca.data import label, write_dataset

SMALL = ("camera.channels=monochrome", "camera.filters=clear", "camera.planes=3", "camera.size=[32,32]",
         "camera.learn=[mask]", "data.patch=32", "data.batch=2", "precision=32-true", "optimiser.mask_rate=0.5",
         "decoder={kind: two-headed, start: snapshot, widths: [6, 8], blocks: 1}")  # fmt: skip
TAKEN = ("--read-noise", "0.01", "--crop", "36x33", "--no-figures")


@pytest.fixture(autouse=True)
def scenes(tmp_path, monkeypatch):
    """Textured cubes (8, 68, 72) before a slope: learned.nc, checked.nc; bare.nc without depth; and small.nc."""
    monkeypatch.chdir(tmp_path)
    waves = np.array(SpectralDepthCamera.from_preset("quick", size=(32, 32)).wavelengths)
    for seed, name in enumerate(("learned", "checked", "bare", "small")):
        size = (20, 22) if name == "small" else (68, 72)
        coarse = torch.rand(1, 8, 12, 13, generator=torch.Generator().manual_seed(seed))
        fine = torch.nn.functional.interpolate(coarse, size=size, mode="bicubic").clamp(0, 1)[0]
        depth = (1 / np.linspace(0.6, 2.4, size[1])[None].repeat(size[0], 0)).astype(np.float32)
        parts = {"radiance": label(fine.numpy(), waves)}
        parts |= {} if name == "bare" else {"depth": (("y", "x"), depth, {"units": "m"})}
        write_dataset(xr.Dataset(parts), tmp_path / f"{name}.nc")


def arguments(*more, train="learned.nc", validation="checked.nc", start=()):
    settings = [part for setting in (*SMALL, *start) for part in ("--set", setting)]
    lists = ["--train", train, "--validation", validation]
    return ["train", "spectral-depth", "--preset", "quick", "--out", "run", "--steps", "2", *lists, *settings, *more]


@pytest.mark.slow
@pytest.mark.filterwarnings("default::tmca.decoders.nets.weights.OtherCodes")
@pytest.mark.filterwarnings("ignore::tmca.optics.StrayLight")  # masks that learn this fast are rough
@pytest.mark.filterwarnings("ignore::tmca.optics.Undersampled")
def test_what_is_learned_takes_snapshots_and_decodes_them(capsys, tmp_path):
    main([*arguments(), "--json"])
    said = capsys.readouterr()
    assert json.loads(said.out)["steps"] == 2
    assert "learned.nc read" in said.err
    made = {"weights.safetensors", "log.csv", "run.json", "curve.png", "codes.png", "psf.png"}
    assert made <= {file.name for file in (tmp_path / "run").iterdir()}
    main(["simulate", "spectral-depth", "checked.nc", "--weights", "run", *TAKEN, "--out", "taken.nc"])
    assert "reconstruct it with: tmca reconstruct taken.nc --weights run\n" in capsys.readouterr().out
    capsys.readouterr()
    main(["reconstruct", "taken.nc", "--weights", "run", "--truth", "checked.nc", "--out", "found.nc", "--json"])
    said = capsys.readouterr()
    assert "trained for" not in said.err  # the codes are the network's own
    metrics = json.loads(said.out)["metrics"]
    assert answer(capsys, "evaluate", "found.nc", "checked.nc") == pytest.approx(metrics, rel=1e-4)
    with xr.open_dataset("found.nc") as kept:
        assert kept["radiance"].shape == (8, 36, 33)
        assert 0.4 - 1e-6 <= float(kept["depth"].min()) <= float(kept["depth"].max()) <= 2 + 1e-6
    own = ["--channels", "monochrome", "--planes", "3", "--filters", "clear"]
    main(["simulate", "spectral-depth", "checked.nc", *own, "--depth", "0.8,5", *TAKEN, "--out", "other.nc"])
    main(["reconstruct", "other.nc", "--weights", "run", "--no-figures"])
    assert "other heights, shutter, depth than" in capsys.readouterr().err
    main(["simulate", "spectral-depth", "checked.nc", *own[2:], *TAKEN, "--out", "rgb.nc"])
    assert "channels = 1, expected 3" in refused(capsys, "reconstruct", "rgb.nc", "--weights", "run")
    assert "planes = 8, expected 3" in refused(capsys, "reconstruct", "taken.nc", "--weights", "default")
    said = refused(capsys, "simulate", "spectral-depth", "checked.nc", "--codes", "run", "--slots", "2")
    assert "--slots: found 2, expected 4, as these weights have" in said


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"train": "bare.nc"}, ("bare.nc", "without depth", "--placed random")),
        ({"train": "motorcycle.nc"}, ("motorcycle.nc", "no such file")),
        ({"validation": "small.nc"}, ("small.nc", "20×22", "at least 64×64")),
        ({"start": ["codes.start=bare.nc"]}, ("bare.nc", "heights")),
    ],
)
def test_what_cannot_be_trained_is_one_line(capsys, tmp_path, more, words):
    line = refused(capsys, *arguments(**more), lines=None)
    assert all(word in line for word in words), line
    assert not (tmp_path / "run" / "weights.safetensors").exists()
