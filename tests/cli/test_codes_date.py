"""Snapshots of calibrated cameras, and calibrations that are older than the codes, through the command line."""

import json
import os
from datetime import UTC, datetime

import numpy as np
import pytest
import torch

from tests.cli.calls import answer
from tests.cli.refusals import refused
from tests.lab.calibration.test_apply import dispersed, registered, with_parts
from tmca.cameras import Snapshot
from tmca.cli import main
from tmca.codes import write_codes
from tmca.lab.calibration import file as calibration_file

SIZE, SENSOR, WAVES = (24, 28), (24, 30), (400e-9, 550e-9, 700e-9)
TAKE = ["simulate", "spectral", "coffee", "--crop", "24x28", "--slots", "2", "--bands", "3", "--no-figures", "--out"]
DECODE = ("-d", "admm-tv", "--no-figures", "--truth", "coffee", "--overwrite")


@pytest.fixture
def calibrations(tmp_path, monkeypatch):
    """Of one bench, measured long ago and in times to come: its mask is aside, and the prism spreads more."""
    place = registered(SIZE, SENSOR, [[1, 0, 1.0], [0, 1, 2.0]])
    with monkeypatch.context() as then:
        for name, year in (("old", 2015), ("new", 2099)):
            then.setattr(calibration_file, "_now", lambda year=year: datetime(year, 3, 1, tzinfo=UTC))
            known = with_parts(registration=place, dispersion=dispersed((-1.6, 0.0, 1.6), wavelengths=WAVES))
            known.about["camera"].update(name="bench", sensor=list(SENSOR), codes=list(SIZE))
            known.save(name)
    return tmp_path


def quality(capsys, snapshot, *calibration):
    return answer(capsys, "reconstruct", snapshot, *DECODE, *calibration, "--out", "found.nc")["metrics"]["psnr"]


def test_a_snapshot_of_a_calibrated_camera_wants_its_calibration(capsys, calibrations):
    report = answer(capsys, *TAKE, "sim.nc", "--calibration", "old")
    assert report["codes_date"] == "2015-03-01T00:00:00+00:00"
    assert report["size"] == list(SENSOR)
    assert report["calibration"].startswith("old_2015-03-01")
    known, unknown = quality(capsys, "sim.nc", "--calibration", "old"), quality(capsys, "sim.nc")
    assert known > unknown + 3
    main([*TAKE, "again.nc", "--calibration", "old"])
    assert "reconstruct again.nc --calibration old_2015-03-01T000000.nc" in capsys.readouterr().out
    assert torch.equal(Snapshot.load("sim.nc").values, Snapshot.load("again.nc").values)


def test_a_calibration_older_than_the_codes_is_refused_from_simulation_to_capture(capsys, calibrations):
    main([*TAKE, "sim.nc"])
    date = Snapshot.load("sim.nc").notes["codes_date"]
    assert "one after the codes" in refused(capsys, "reconstruct", "sim.nc", "--calibration", "old", lines=None)
    main(["export", "sim.nc", "--device", "dli4120", "--device", "emulated-shutter", "--no-figures", "--out", "ex"])
    assert json.loads((calibrations / "ex" / "manifest.json").read_text())["codes_date"] == date
    main(["capture", "ex", "--scene", "coffee", "--out", "frames"])
    assert Snapshot.load("frames.nc").notes["codes_date"] == date
    assert "one after the codes" in refused(capsys, "reconstruct", "frames.nc", "--calibration", "old", lines=None)
    main(["reconstruct", "frames.nc", "-d", "dagger", "--no-figures", "--calibration", "new", "--out", "found.nc"])
    assert (calibrations / "found.nc").exists()


@pytest.mark.slow
def test_codes_from_files_are_as_old_as_these(capsys, calibrations):
    generator = torch.Generator().manual_seed(0)
    planes = [torch.randint(2, (2, *size), generator=generator).float() for size in (SIZE, SENSOR)]
    take = [word for word in TAKE if word not in ("--slots", "2")]
    write_codes("codes.nc", *planes, None)
    shown = ("--codes", "codes.nc", "--calibration", "old")
    assert "one after the codes" in refused(capsys, *take, "sim.nc", *shown)
    assert not os.path.exists("sim.nc")
    before = datetime(2014, 7, 1, tzinfo=UTC).timestamp()
    os.utime("codes.nc", (before, before))
    assert answer(capsys, *take, "sim.nc", *shown)["codes_date"].startswith("2014-07-01")
    write_codes("dated.nc", *planes, None, {"codes_date": "2016-01-01T00:00:00"})
    os.utime("dated.nc", (before, before))
    dated = ("--codes", "dated.nc", "--calibration")
    assert "2016-01-01" in refused(capsys, *take, "other.nc", *dated, "old")
    assert answer(capsys, *take, "other.nc", *dated, "new")["codes_date"].startswith("2016-01-01")
    write_codes("undated.nc", *planes, None, {"codes_date": "last spring"})
    assert "'last spring'" in refused(capsys, *take, "third.nc", "--codes", "undated.nc")
    np.save("mask.npy", planes[0].numpy().astype(np.uint8))
    os.utime("mask.npy", (before, before))
    report = answer(capsys, *take, "fourth.nc", "--aperture", "mask.npy", "--calibration", "old")
    assert report["codes_date"].startswith("2014-07-01")
