"""A bench that runs: an exposure is what a capture gives; nothing is dropped in silence."""

import time
from itertools import pairwise
from threading import Event
from types import SimpleNamespace

import pytest
import torch

from tests.lab.acquisition.test_capture import bench_of, exported, scene_of
from tests.lab.display.test_export import mirror, spectral
from tmca.cameras import Hardware, LightFieldCamera
from tmca.decoders import make_decoder
from tmca.errors import DataError, DeviceError, SettingError
from tmca.lab.acquisition.drivers import find_device
from tmca.lab.acquisition.session import capture, joined
from tmca.lab.calibration.apply import calibrated_snapshot
from tmca.lab.calibration.capturing import capture_step
from tmca.lab.calibration.file import Calibration
from tmca.lab.calibration.shots import Asked
from tmca.lab.calibration.steps import measure_all
from tmca.lab.live import Exposures, Live, Recording, recorded
from tmca.lab.live.loop import residual_of
from tmca.lab.quality import NotMeasured
from tmca.sensor import Sensor

CAMERAS = {
    "spectral": spectral(sensor=Sensor(read_noise=0.01)),
    "per slot": spectral((13, 17), exposure="per-slot", sensor=Sensor(read_noise=0.01)),
    "two buckets": spectral(buckets=2, shutter="balanced", sensor=Sensor(read_noise=0.01)),
    "light field": LightFieldCamera(views=3, size=(9, 11), slots=2, sensor=Sensor(read_noise=0.01)),
    "spectral-depth": mirror().replace(sensor=Sensor(read_noise=0.01)),
}


def devices(camera, shutter):
    shutter = "coded-exposure-two-bucket" if camera.buckets == 2 else shutter
    return "dmp40" if hasattr(camera, "planes") else "dli4120", shutter


@pytest.mark.parametrize("shutter", ["emulated-shutter", "coded-exposure"])
@pytest.mark.parametrize("name", CAMERAS)
def test_an_exposure_is_the_snapshot_of_a_capture(tmp_path, name, shutter):
    camera = CAMERAS[name]
    export = exported(tmp_path, camera, *devices(camera, shutter))
    frames = capture(export, bench_of(camera), tmp_path / "frames", gain=None, camera=camera)
    wanted = joined(frames, export, camera)
    with Exposures(export, bench_of(camera), camera) as exposures:
        first, second = exposures.take(), exposures.take()
    torch.testing.assert_close(first.values, wanted.values)
    assert (first.number, second.number) == (0, 1)
    assert not torch.equal(first.values, second.values)  # other noise
    assert first.saturated == 0


@pytest.mark.parametrize("shutter", ["emulated-shutter", "coded-exposure"])
def test_exposures_before_a_calibrated_camera_are_corrected_as_a_capture_is(tmp_path, shutter):
    camera, hardware = spectral((24, 26), sensor=Sensor(read_noise=0.002)), Hardware(misregistration=(0.5, -0.5))
    export = exported(tmp_path, camera, *devices(camera, shutter))
    asked = Asked(frames=2, wavelengths=tuple(camera.wavelengths[1:2]))
    for step in ("dark", "flat", "white", "registration"):
        before = find_device("simulated", camera=camera, scene=[], hardware=hardware, whole=shutter == "coded-exposure")
        capture_step(step, export, before, tmp_path / "steps", camera, asked)
    *_, (_, known) = measure_all(tmp_path / "steps", Calibration.empty())
    bench = {"hardware": hardware, "whole": shutter == "coded-exposure"}
    frames = capture(export, bench_of(camera, **bench), tmp_path / "frames", gain=None, camera=camera)
    with pytest.warns(NotMeasured):
        wanted = calibrated_snapshot(joined(frames, export, camera), known)
    running = Exposures(export, bench_of(camera, **bench), camera, calibration=known)
    with pytest.warns(NotMeasured), running as exposures:
        found = exposures.take()
    torch.testing.assert_close(found.values, wanted.values)
    torch.testing.assert_close(exposures.camera.codes()[0], wanted.camera.codes()[0])
    left = [(one.A(scene_of(camera)[0]) - found.values).norm() for one in (camera, exposures.camera)]
    assert left[1] < 0.3 * left[0]


def test_a_calibration_of_another_camera_is_refused_before_the_first_frame(tmp_path):
    other = Calibration({}, {"camera": {"name": "", "sensor": [5, 5], "codes": None}, "steps": {}})
    with pytest.raises(DataError, match="5×5"):
        running(tmp_path, calibration=other)


def test_the_scene_of_the_simulated_bench_drifts(tmp_path):
    camera = spectral()
    export = exported(tmp_path, camera, "dli4120", "coded-exposure")
    bench = bench_of(camera, drift=(1, -2))
    scene = bench.scene[0]
    with Exposures(export, bench, camera) as exposures:
        for place in range(3):
            wanted = camera(scene.roll((place, -2 * place), (-2, -1)))
            assert float((exposures.take().values - wanted).abs().max()) <= 1.01 * bench.gain


def test_noise_is_measured_where_the_camera_knows_none(tmp_path):
    known, silent = spectral(sensor=Sensor(read_noise=0.02)), spectral()
    export = exported(tmp_path, known, "dli4120", "coded-exposure")
    with Exposures(export, bench_of(known), known) as exposures:
        assert exposures.camera.noise.read == 0.02
    with Exposures(export, bench_of(known), silent) as exposures:
        assert exposures.camera.noise.read == pytest.approx(0.02, rel=0.3)


CAMERA = CAMERAS["spectral"]


def running(tmp_path, bench=None, **how):
    export = exported(tmp_path, CAMERA, "dli4120", "coded-exposure")
    return Exposures(export, bench or bench_of(CAMERA), CAMERA, **how)


def recordings(tmp_path, repeats):
    """A bench of frames that were there before."""
    export = exported(tmp_path, CAMERA, "dli4120", "coded-exposure")
    frames = capture(export, bench_of(CAMERA), tmp_path / "frames", gain=None, camera=CAMERA, repeats=repeats)
    return find_device("folder", path=str(frames))


class Slow:
    """A prepared decoder that takes its time."""

    def __init__(self, prepared, seconds):
        self.prepared, self.camera, self.seconds = prepared, prepared.camera, seconds

    def __call__(self, values):
        time.sleep(self.seconds)
        return self.prepared(values)


class Hanging:
    """A driver that answers no more after some frames; a bench behind it takes them."""

    def __init__(self, bench, frames):
        self.bench, self.left = bench, iter(range(frames))

    def __getattr__(self, name):
        return getattr(self.bench, name)

    def capture(self, whole=False):
        return Event().wait() if next(self.left, None) is None else self.bench.capture(whole)


def loop_of(exposures, seconds=0.0):
    return Live(exposures, Slow(make_decoder("dagger", "spectral").prepare(exposures.camera), seconds))


def first(count, loop):
    return [shown for shown, _ in zip(loop, range(count), strict=False)]


def test_estimates_are_those_of_the_decoder(tmp_path):
    with running(tmp_path, rate=50) as exposures:
        prepared = make_decoder("tikhonov", "spectral").prepare(exposures.camera)
        seen = first(3, Live(exposures, prepared))
    for shown in seen:
        again = prepared(shown.values)
        assert torch.equal(shown.estimate.values, again.values)
        wanted = (exposures.camera.A(again.values) - shown.values).norm() / shown.values.norm()
        assert shown.residual == pytest.approx(float(wanted))
        assert set(shown.seconds) == {"capture", "wait", "decode", "residual"}
    assert [shown.number for shown in seen] == sorted({shown.number for shown in seen})
    assert seen[-1].rate > 0


def test_exposures_that_come_meanwhile_are_dropped_and_counted(tmp_path):
    with running(tmp_path, rate=100) as exposures:
        seen = first(4, loop_of(exposures, 0.2))
    assert seen[-1].dropped > 0
    for before, after in pairwise(seen):
        assert after.number - before.number - 1 == after.dropped - before.dropped


def test_frames_that_were_recorded_are_all_decoded_and_then_it_ends(tmp_path):
    with running(tmp_path, recordings(tmp_path, 5)) as exposures:
        loop = loop_of(exposures, 0.02)
        assert [shown.number for shown in loop] == [0, 1, 2, 3, 4]
    assert loop.dropped == 0


def test_a_bench_that_stops_in_the_middle_ends_its_loop_with_its_error_and_not_the_next_one(tmp_path):
    bench = bench_of(CAMERA, stops_after=4 + 3)
    with running(tmp_path, bench, rate=50) as exposures:
        loop = loop_of(exposures)
        with pytest.raises(DeviceError, match="no answer after 7 frames"):
            list(loop)
        assert 1 <= exposures.number <= 3
        bench.stops_after = None
        assert next(iter(loop)).values.shape == (1, *CAMERA.snapshot_shape)


def test_a_bench_that_hangs_in_the_middle_leaves_the_recording_whole(tmp_path):
    bench = Hanging(bench_of(CAMERA), 4 + 2)
    late = pytest.raises(DeviceError, match=r"no answer in 0\.5 s, .*--timeout")
    kept = Recording(tmp_path / "r.zarr", CAMERA)
    with running(tmp_path, bench, rate=4, timeout=0.5) as exposures, late, kept:
        list(map(kept.add, loop_of(exposures)))
    assert [frame.notes["number"] for frame in recorded(tmp_path / "r.zarr")] == [0, 1]


def test_a_prepared_decoder_takes_the_exposures_of_a_bench(tmp_path):
    with running(tmp_path, recordings(tmp_path, 3)) as exposures:
        estimates = list(make_decoder("dagger", "spectral").prepare(exposures.camera).stream(exposures))
    assert [one.values.shape for one in estimates] == 3 * [(1, *CAMERA.scene_shape)]


def test_a_loop_that_is_left_stops_the_bench(tmp_path):
    with running(tmp_path, rate=100) as exposures:
        loop = iter(loop_of(exposures))
        next(loop)
        loop.close()
        number = exposures.number
        time.sleep(0.1)
        assert exposures.number <= number + 1


def test_a_slow_bench_is_not_waited_for_at_the_end(tmp_path):
    with running(tmp_path, rate=1e-320) as exposures:
        loop = iter(loop_of(exposures))
        next(loop)
        begun = time.monotonic()
        loop.close()
        assert time.monotonic() - begun < 1
        exposures.rate = None
        assert next(iter(loop_of(exposures))).number >= 1  # another loop goes on


def test_a_second_loop_goes_on_and_ends_the_first(tmp_path):
    with running(tmp_path, rate=100) as exposures:
        loop = loop_of(exposures)
        seen = first(2, loop)
        before, after = iter(loop), iter(loop)
        assert next(before).number > seen[-1].number
        assert next(after).rate == 0
        assert len(list(before)) <= 1
        before.close()
        numbers = [next(after).number for _ in range(3)]
        assert numbers == sorted(set(numbers))


def test_recorded_frames_of_a_loop_that_another_one_ends_keep_nobody_waiting(tmp_path):
    with running(tmp_path, recordings(tmp_path, 9)) as exposures:
        loop = loop_of(exposures)
        before = iter(loop)
        next(before)
        assert [shown.number for shown in loop][-1] == 8


def test_refusals(tmp_path):
    with pytest.raises(SettingError, match="rate"):
        running(tmp_path, rate=0)
    other = spectral((13, 17), sensor=Sensor(read_noise=0.01))
    with pytest.raises(DataError):
        Exposures(exported(tmp_path, spectral(), "dli4120", "coded-exposure"), bench_of(other), other)


def test_the_residual_of_depth_and_of_frames():
    camera = CAMERAS["spectral-depth"]
    scene, depth = torch.rand(1, *camera.scene_shape), torch.full((1, 1, *camera.size), 0.9)
    snapshot = camera.A(scene, depth)

    assert residual_of(camera, SimpleNamespace(values=scene, depth=depth), snapshot) < 1e-5
    half = SimpleNamespace(values=0.5 * scene, depth=depth)
    assert residual_of(camera, half, snapshot) == pytest.approx(0.5, rel=1e-4)
    flat = CAMERAS["spectral"]
    cube = torch.rand(1, *flat.scene_shape)
    moving = SimpleNamespace(values=torch.stack((0.5 * cube, 1.5 * cube), 1), depth=None)
    assert residual_of(flat, moving, flat.A(cube)) < 1e-5
