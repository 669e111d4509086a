"""``tmca live`` on the simulated bench and on frames of other software."""

import time

import numpy as np
import pytest
import torch
import xarray as xr

from tests.cli.calls import answer, run, said
from tests.cli.refusals import refused
from tests.lab.acquisition.test_capture import bench_of, exported
from tests.lab.display.test_export import spectral
from tmca.cli import main
from tmca.cli.lab.live import _run
from tmca.data import write_dataset
from tmca.lab.acquisition.session import capture
from tmca.lab.calibration.apply import calibrated
from tmca.lab.calibration.file import Calibration
from tmca.lab.calibration.registration import Registration
from tmca.lab.live import Shown, recorded
from tmca.sensor import Sensor


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A folder with an export, its snapshot, and a scene before the bench."""
    folder, camera = tmp_path_factory.mktemp("live"), spectral(sensor=Sensor(read_noise=0.01))
    exported(folder, camera, "dli4120", "coded-exposure")
    scene = bench_of(camera).scene[0]
    for name in ("scene.nc", "scene.zarr"):
        write_dataset(camera.label(scene).to_dataset(name="scene"), folder / name)
    return folder, camera


@pytest.fixture
def live(bench):
    """The command before the scene, without a page."""
    folder, _ = bench
    return ("live", folder / "out", "--like", folder / "taken.nc", "--scene", folder / "scene.nc", "--no-page")


HOW = ("-d", "dagger", "--rate", "50")


def test_exposures_are_decoded_and_recorded(capsys, live, tmp_path):
    keep = ("--record", tmp_path / "r.zarr")
    report = answer(capsys, *live, *HOW, "--drift", "0,1", "--exposures", "4", *keep)
    assert report["estimates"] == 4
    assert report["decoder"] == "dagger"
    assert set(report["ms"]) == {"capture", "wait", "decode", "residual", "give"}
    frames = list(recorded(tmp_path / "r.zarr"))
    assert len(frames) == 4
    assert frames[-1].notes["number"] == 3 + frames[-1].notes["dropped"]


@pytest.mark.filterwarnings("default::tmca.lab.quality.NotMeasured")
def test_a_calibrated_bench_is_decoded_by_its_camera(capsys, bench, live, tmp_path):
    _, camera = bench
    registered = Registration(np.eye(2, 3), np.zeros((2, 3)), 0.3, 0.0, camera.size, camera.snapshot_shape[1:], 550e-9)
    known = Calibration.empty().with_part("registration", registered, {}).save(tmp_path / "bench")
    keep = ("--exposures", "1", "--record", tmp_path / "r.zarr")
    assert "not measured: " in run(capsys, *live, *HOW, *keep, "--calibration", tmp_path / "bench").err
    (frame,) = recorded(tmp_path / "r.zarr")
    wanted = calibrated(camera, known)
    assert torch.equal(frame.camera.codes()[0], wanted.codes()[0])
    assert frame.values.shape[1:] == wanted.snapshot_shape


def test_estimates_of_a_scene_that_moves_are_recorded(capsys, live, tmp_path):
    keep = ("--record", tmp_path / "r.zarr", "--record-estimates")
    said(capsys, *live, "--exposures", "1", "-d", "space-time-dct", *keep)
    assert "slot" in xr.open_zarr(tmp_path / "r.zarr", group="frames")["estimate"].dims


def test_the_page_is_told_and_the_end_too(capsys, live):
    captured = run(capsys, *live[:-1], "--exposures", "2", *HOW)
    assert "page: http://127.0.0.1:" in captured.err
    assert "estimates a second" in captured.err
    assert captured.out.startswith("2 estimates by dagger")


def test_without_the_packages_of_the_page_the_loop_goes_on_unless_it_is_asked_for(capsys, live, monkeypatch):
    monkeypatch.setattr("tmca.viewer.viewing.find_spec", lambda name: None)
    captured = run(capsys, *live[:-1], "--exposures", "1", *HOW)
    assert captured.out.startswith("1 estimates by dagger")
    assert "no page without fastapi and uvicorn: pip install 'tmca[view]'" in captured.err
    assert "tmca[view]" in refused(capsys, *live[:-1], "--page", *HOW)


def test_frames_of_other_software_are_decoded_to_their_end(capsys, bench, live, tmp_path):
    folder, camera = bench
    frames = capture(folder / "out", bench_of(camera), tmp_path / "f", gain=None, camera=camera, repeats=3)
    how = ("--device", "folder", "--set", f"path={frames}", "--no-page", *HOW)
    assert "3 estimates by dagger" in said(capsys, *live[:4], *how)


def test_a_bench_that_stops_leaves_the_recording_whole_and_its_summary_is_told(capsys, live, tmp_path):
    how = ("--stops-after", "9", "--rate", "10", "-d", "dagger", "--record", tmp_path / "r.zarr")
    with pytest.raises(SystemExit, match="2"):
        main([str(word) for word in (*live, *how)])
    captured = capsys.readouterr()
    assert "estimates by dagger" in captured.out
    assert "no answer after 9 frames" in captured.err.splitlines()[-1]
    assert 1 <= len(list(recorded(tmp_path / "r.zarr"))) <= 5


def test_the_end_of_a_slow_bench_is_not_part_of_the_rate():
    class Loop:
        dropped = 0

        def __iter__(self):
            yield Shown(0, None, None, 0.0, 0.0, 0, {}, 0.0)
            time.sleep(0.5)

    summary, failure = _run(Loop(), [lambda shown: time.sleep(0.01)], None)
    assert summary["estimates"] == 1
    assert summary["seconds"] < 0.3
    assert failure is None


def test_a_bank_that_no_next_start_could_read_is_refused(capsys, tmp_path):
    exported(tmp_path, spectral(), "dli4120", "coded-exposure")
    how = ("--scene", "coffee", "--like", tmp_path / "taken.nc", "--bank", tmp_path / "b.safetensors")
    assert "--read-noise" in refused(capsys, "live", tmp_path / "out", *how, lines=None)


@pytest.mark.parametrize(("options", "words"), [
    ((), "--scene"),
    (("--scene", "coffee", "--exposures", "0"), "--exposures"),
    (("--scene", "coffee", "--drift", "1"), "--drift"),
    (("--scene", "coffee", "--drift", "nan,1"), "--drift"),
    (("--scene", "coffee", "--drift", "1e300,1"), "--drift"),
    (("--scene", "coffee", "--rate", "0"), "rate"),
    (("--scene", "scene.nc", "--record-estimates"), "--record-estimates"),
    (("--scene", "scene.nc", "--record", "none/r.zarr"), "no such folder"),
    (("--scene", "scene.nc", "--record", "scene.zarr", "--overwrite"), "no recording"),
    (("--device", "folder", "--drift", "0,1"), "simulated bench"),
    (("--scene", "scene.nc", "--record", "r.nc"), ".zarr"),
    (("--scene", "scene.nc", "-d", "nonsense"), "decoder"),
    (("--scene", "scene.nc", "--port", "70000"), "port"),
])  # fmt: skip
def test_what_cannot_be_is_one_line(capsys, bench, monkeypatch, options, words):
    folder, _ = bench
    monkeypatch.chdir(folder)
    assert words in refused(capsys, "live", "out", "--like", "taken.nc", *options, lines=None)
