"""``tmca reconstruct --register auto``: a bench whose mask is displaced, decoded without a calibration."""

import pytest

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
    assert found["registered"].startswith("mask +0.8")
    assert "mask +0.8" in run(capsys, *how, "--register", "auto", "--out", "again.nc").out


def test_another_word_is_refused(displaced, capsys):
    told = refused(capsys, "reconstruct", displaced, "--register", "by hand")
    assert "--register: found 'by hand', expected one of auto" in told
