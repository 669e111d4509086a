"""``tmca reconstruct --register auto``: a bench whose mask is displaced, decoded without a calibration."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
import xarray as xr

import tmca
from tests.cli.calls import answer, run
from tests.cli.refusals import refused

BENCH = [
    "--bands",
    "4",
    "--crop",
    "96x120",
    "--slots",
    "1",
    "--shutter",
    "open",
    "--read-noise",
    "0.01",
    "--no-figures",
]


@pytest.fixture
def displaced(capsys):
    run(
        capsys,
        "simulate",
        "spectral",
        "coffee",
        *BENCH,
        "--hardware",
        "misregistration=0.8:-1.1,rotation=0.2",
        "--out",
        "s.nc",
    )
    return "s.nc"


def test_the_mask_is_found_and_the_scene_is_better(displaced, capsys):
    how = ["reconstruct", displaced, "--truth", "coffee", "--no-figures"]
    drawn = answer(capsys, *how, "--out", "drawn.nc")
    found = answer(capsys, *how, "--register", "auto", "--out", "found.nc")
    assert found["metrics"]["psnr"] > drawn["metrics"]["psnr"] + 3
    assert found["registered"]["converged"]
    assert found["registered"]["shift"][0] == pytest.approx(0.8, abs=0.1)
    shown = run(capsys, *how, "--register", "auto", "--out", "again.nc").out
    assert "mask +0.8" in shown
    assert "times as bright as the prior" in shown
    assert f"± {found['registered']['std']['down']:.3f} and" in shown


@pytest.mark.filterwarnings("always")
def test_where_nothing_stands_out_it_is_said_and_the_estimate_is_that_of_the_mask_as_drawn(displaced, capsys):
    wrong = tmca.Snapshot.load(displaced)
    noise = torch.rand(wrong.values.shape, generator=torch.Generator().manual_seed(0))
    replace(wrong, values=noise).save("noise.nc")
    how = ["reconstruct", "noise.nc", "--no-figures"]
    answer(capsys, *how, "--out", "drawn.nc")
    shown = run(capsys, *how, "--register", "auto", "--out", "found.nc", "--json")
    assert "warning: not registered: no place of the mask stands out" in shown.err
    found = json.loads(shown.out)
    assert not found["registered"]["converged"]
    assert found["registered"]["std"]["down"] is None
    np.testing.assert_array_equal(*(xr.load_dataset(file)["estimate"] for file in ("drawn.nc", "found.nc")))


def test_another_word_is_refused(displaced, capsys):
    told = refused(capsys, "reconstruct", displaced, "--register", "by hand")
    assert "--register: found 'by hand', expected one of auto" in told
