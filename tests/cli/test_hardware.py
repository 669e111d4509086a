"""`--hardware` of `tmca simulate`, and faults in sweeps."""

import pytest
import torch

from tests.cli.calls import answer
from tmca.cameras import Snapshot
from tmca.cli import main

SMALL = {
    "spectral": ["coffee", "--crop", "24x28", "--slots", "2", "--bands", "3", "--no-figures"],
    "light-field": ["coffee", "--crop", "24x28", "--slots", "2", "--views", "3", "--no-figures"],
    "spectral-depth": ["coffee", "--crop", "32x32", "--reduce", "4", "--no-figures"],
}


def taken(camera, name, *options):
    main(["simulate", camera, *SMALL[camera], "--out", name, *options])
    return Snapshot.load(name)


@pytest.mark.parametrize("camera", SMALL)
def test_the_file_keeps_the_camera_that_is_known(camera):
    perfect, faulty = taken(camera, "a.nc"), taken(camera, "b.nc", "--hardware", "delay=0.3,leakage=0.05")
    assert not torch.equal(perfect.values, faulty.values)
    for known, same in zip(perfect.camera.codes(), faulty.camera.codes(), strict=True):
        assert torch.equal(known, same)
    assert faulty.notes["hardware"] == "leakage = 0.05, delay = 0.3"
    assert "hardware" not in perfect.notes


def test_faults_come_from_a_file_too(tmp_path):
    (tmp_path / "bench.yaml").write_text("misregistration: [0.5, -1]\ncontrast_ratio: 40\n")
    one = taken("spectral", "a.nc", "--hardware", "bench.yaml")
    other = taken("spectral", "b.nc", "--hardware", "misregistration=0.5:-1,contrast_ratio=40")
    assert torch.equal(one.values, other.values)


def test_a_scene_that_moves_is_a_fault_as_well():
    one, other = taken("spectral", "a.nc", "--hardware", "motion=2:1"), taken("spectral", "b.nc", "--motion", "2,1")
    assert torch.equal(one.values, other.values)


def test_a_sweep_decodes_what_a_faulty_bench_took_with_the_camera_that_is_known(capsys):
    sweep = ("sweep", "spectral", "coffee", "--crop", "24x24", "--bands", "4", "--decoder", "admm-tv", "--out", "s")
    how = ("--set", "slots=2", "--set", "motion=0:0.5", "--vary", "misregistration=0,0:1,1:0,1")
    rows = answer(capsys, *sweep, *how)["rows"]
    assert [row["misregistration"] for row in rows] == [0.0, "0:1", "1:0", 1.0]
    assert len({row["psnr"] for row in rows}) == 4
    assert rows[0]["psnr"] > rows[-1]["psnr"] + 0.5
