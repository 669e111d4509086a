"""Recordings are whole up to their last frame, open in xarray, and what is damaged is refused."""

import json
import os
import shutil
import signal
import subprocess
import sys
import warnings
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest
import torch
import xarray as xr

from tests.lab.display.test_export import spectral
from tmca.cli import main
from tmca.decoders import Estimate
from tmca.errors import DataError, OutputError, TmcaError
from tmca.lab.live import Recording, Shown, last_recorded, recorded
from tmca.sensor import Sensor
from tmca.viewer.opening import open_items

CAMERA = spectral(sensor=Sensor(read_noise=0.01))


def shown(number):
    values = torch.full((1, *CAMERA.snapshot_shape), float(number))
    estimate = Estimate(torch.full((1, *CAMERA.scene_shape), 0.5 * number), CAMERA, "dagger")
    return Shown(
        number, values, estimate, 0.0, 0.1, 2, {"capture": 0.01, "wait": 0.02, "decode": 0.03, "residual": 0.01}, 9.0
    )


@pytest.fixture(scope="module")
def three_frames(tmp_path_factory):
    path = tmp_path_factory.mktemp("recorded") / "r.zarr"
    with Recording(path, CAMERA, estimates=True) as recording:
        for number in (0, 1, 3):
            recording.add(shown(number))
    return path


@pytest.fixture
def written(three_frames, tmp_path):
    """A recording of the test's own."""
    return shutil.copytree(three_frames, tmp_path / "r.zarr")


def test_what_is_recorded_is_read_again(written):
    frames = list(recorded(written))
    assert [float(frame.values.mean()) for frame in frames] == [0, 1, 3]
    assert [frame.notes["number"] for frame in frames] == [0, 1, 3]
    assert frames[0].notes["decode_s"] == pytest.approx(0.03)
    assert frames[0].camera.noise.read == CAMERA.noise.read
    assert torch.equal(frames[0].camera.codes()[0], CAMERA.codes()[0])


def test_xarray_opens_it(written, recwarn):
    dataset = xr.open_zarr(written, group="frames")
    assert dataset.sizes["frame"] == 3
    np.testing.assert_allclose(dataset["estimate"].mean(("wavelength", "y", "x")), [0, 0.5, 1.5])
    assert "aperture" in xr.open_zarr(written)
    assert not [warning for warning in recwarn if issubclass(warning.category, RuntimeWarning)]


def test_the_group_of_frames_knows_its_axes(written):
    dataset = xr.open_zarr(written, group="frames")
    np.testing.assert_allclose(dataset["wavelength"], CAMERA.wavelengths)
    assert float(dataset["log"].sel(field="number")[2]) == 3


def test_a_recording_is_inspected_and_its_last_estimate_viewed(written, capsys):
    main(["inspect", str(written)])
    told = capsys.readouterr().out
    assert f"{written}: recording (Zarr)" in told
    assert "frames: 3 " in told
    assert "variable=" not in told
    with ExitStack() as stack:
        estimate, snapshot, codes = open_items(written, stack)
    assert [estimate.kind, snapshot.kind, codes.kind] == ["cube", "snapshot", "codes"]
    assert (estimate.layers[0].plane(1) == 1.5).all()
    assert (snapshot.layers[0].plane(0) == 3).all()


def test_frames_of_a_scene_that_moves_are_recorded_by_slot(tmp_path):
    path, shape = tmp_path / "m.zarr", (4, *CAMERA.scene_shape)
    estimate = Estimate(torch.rand(1, *shape), CAMERA, "space-time-lmmse")
    with Recording(path, CAMERA, estimates=True, scene_shape=shape) as recording:
        recording.add(replace(shown(2), estimate=estimate))
    kept = xr.open_zarr(path, group="frames")["estimate"]
    assert kept.dims == ("frame", "slot", "wavelength", "y", "x")
    np.testing.assert_array_equal(kept[0], estimate.values[0])
    np.testing.assert_array_equal(last_recorded(path)[1], estimate.values[0, 2])


def test_one_that_exists_is_kept(written):
    with pytest.raises(OutputError, match="existing"), Recording(written, CAMERA):
        pass
    with Recording(written, CAMERA, overwrite=True) as recording:
        recording.add(shown(7))
    assert [frame.notes["number"] for frame in recorded(written)] == [7]
    with pytest.raises(OutputError, match=r"\.zarr"):
        Recording(written.with_suffix(".nc"), CAMERA)


KILLED = """
import sys
sys.path.insert(0, {tests!r})
from tests.lab.live.test_recording import CAMERA, shown
from tmca.lab.live import Recording
with Recording({path!r}, CAMERA) as recording:
    for number in range(10000):
        recording.add(shown(number))
        print(number, flush=True)
"""


@pytest.mark.slow
def test_a_killed_process_leaves_all_frames_but_the_last(tmp_path):
    path = tmp_path / "k.zarr"
    code = KILLED.format(tests=os.getcwd(), path=str(path))
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        for line in process.stdout:
            if int(line) >= 70:  # arrays have grown twice
                process.send_signal(signal.SIGKILL)
                break
    last = int(line)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert xr.open_zarr(path, group="frames").sizes["frame"] == 128
    numbers = [int(frame.notes["number"]) for frame in recorded(path)]
    assert numbers == list(range(len(numbers)))
    assert len(numbers) >= last + 1


def test_xarray_opens_arrays_that_are_of_unequal_length_for_a_moment(tmp_path):
    with Recording(tmp_path / "r.zarr", CAMERA) as recording:
        recording.add(shown(0))
        recording._arrays["snapshot"].resize((128, *CAMERA.snapshot_shape))  # as where the process is killed here
        assert xr.open_zarr(tmp_path / "r.zarr", group="frames").sizes["frame"] == 64
        assert len(list(recorded(tmp_path / "r.zarr"))) == 1


def test_a_frame_without_a_time_is_not_there(written):
    import zarr

    zarr.open_group(written / "frames", mode="r+")["log"][1, -1] = np.nan
    assert [frame.notes["number"] for frame in recorded(written)] == [0, 3]


def test_arrays_of_unequal_length_are_read_as_far_as_both_go(written):
    import zarr

    zarr.open_group(written / "frames", mode="r+")["snapshot"].resize((200, *CAMERA.snapshot_shape))
    assert len(list(recorded(written))) == 3


def change(file, **entries):
    file.write_text(json.dumps({**json.loads(file.read_text()), **entries}))


DAMAGES = {
    "no frames": lambda path: shutil.rmtree(path / "frames"),
    "another shape": lambda path: change(
        path / "frames" / "snapshot" / ".zarray", shape=[3, 1, 2, 2], chunks=[1, 1, 2, 2]
    ),
    "no chunks": lambda path: change(path / "frames" / "snapshot" / ".zarray", chunks=[0, 1, 1, 1]),
    "a codec that can run code": lambda path: change(path / "frames" / "log" / ".zarray", filters=[{"id": "pickle"}]),
    "no recording": lambda path: change(path / ".zattrs", recording="something else"),
    "no array": lambda path: shutil.rmtree(path / "frames" / "log"),
    "a cut chunk": lambda path: next((path / "frames" / "snapshot").glob("0*")).write_bytes(b"abc"),
    "other chunks": lambda path: change(path / "frames" / "log" / ".zarray", chunks=[2, 2]),
    "a group": lambda path: (path / "frames" / "log" / ".zarray").write_text("{}"),
    "whole numbers": lambda path: change(path / "frames" / "log" / ".zarray", dtype="<i8"),
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_what_is_damaged_is_refused(written, damage):
    damage(written)
    with pytest.raises(TmcaError):
        list(recorded(written))


def test_codecs_that_are_said_elsewhere_than_where_they_are_checked_count_for_nothing(written):
    import zarr

    zarr.consolidate_metadata(written / "frames")
    said = json.loads((written / "frames" / ".zmetadata").read_text())
    for name in ("log", "snapshot"):
        said["metadata"][f"{name}/.zarray"]["filters"] = [{"id": "pickle"}]
    (written / "frames" / ".zmetadata").write_text(json.dumps(said))
    assert len(list(recorded(written))) == 3


def test_what_is_no_recording_is_refused(tmp_path):
    with pytest.raises(DataError):
        list(recorded(tmp_path / "none.zarr"))
    CAMERA.variables().to_zarr(tmp_path / "c.zarr", zarr_format=2, consolidated=True)
    with pytest.raises(DataError):
        list(recorded(tmp_path / "c.zarr"))


def test_one_process_records_at_a_time(tmp_path):
    path = tmp_path / "r.zarr"
    with Recording(path, CAMERA) as recording:
        second = Recording(path, CAMERA, overwrite=True)
        with pytest.raises(OutputError, match="going on"):
            second.__enter__()
        recording.add(shown(0))
    assert [file.name for file in tmp_path.iterdir()] == ["r.zarr"]
    assert len(list(recorded(path))) == 1


def test_what_is_no_recording_is_not_replaced(tmp_path):
    path = tmp_path / "c.zarr"
    CAMERA.variables().to_zarr(path, zarr_format=2, consolidated=True)
    with pytest.raises(OutputError, match="no recording"), Recording(path, CAMERA, overwrite=True):
        pass
    assert "aperture" in xr.open_zarr(path)
