"""Captures on the simulated bench: frames join into the camera's own snapshot; a bench that stops is gone on with."""

import json
import pickle
import shutil
import tempfile
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest
import tifffile
import torch

from tests.lab.display.test_export import mirror, small_device, snapshot, spectral
from tmca.cameras import Hardware, LightFieldCamera, SpectralCamera, imperfect
from tmca.errors import DataError, DeviceError, OutputError
from tmca.lab.acquisition.drivers import find_device
from tmca.lab.acquisition.session import capture, check_camera, joined
from tmca.lab.display.codes import read_planes
from tmca.lab.display.export import Export, export_codes
from tmca.lab.display.manifest import read_manifest
from tmca.sensor import Sensor

LATER = datetime(2099, 1, 1, tzinfo=UTC)


_EXPORTS = {}


def exported(folder, camera, *names):
    """The folder of an export, beside the snapshot taken.nc; of one camera it is made once, and copied."""
    names = names or ("dli4120", "emulated-shutter")
    key = pickle.dumps(camera.variables().to_dict()), names
    if key not in _EXPORTS:
        made = tempfile.TemporaryDirectory()
        source = snapshot(Path(made.name), camera)
        export_codes(read_planes(source), [small_device(name) for name in names], Path(made.name) / "out")
        _EXPORTS[key] = made  # which is removed with the process
    shutil.copytree(_EXPORTS[key].name, folder, dirs_exist_ok=True)
    return folder / "out"


def scene_of(camera):
    scene = torch.rand(1, *camera.scene_shape, generator=torch.Generator().manual_seed(3))
    return [scene] if not hasattr(camera, "planes") else [scene, torch.full((1, 1, *camera.size), 0.9)]


def bench_of(camera, **settings):
    return find_device("simulated", camera=camera, scene=scene_of(camera), **settings)


@pytest.mark.parametrize("shutter", [["emulated-shutter"], ["coded-exposure"], []], ids=["emulated", "coded", "none"])
@pytest.mark.parametrize(
    "camera",
    [spectral(), spectral((13, 17), exposure="per-slot"), LightFieldCamera(views=3, size=(9, 11), slots=2), mirror()],
    ids=["spectral", "per slot", "light field", "spectral-depth"],
)
def test_frames_join_into_the_snapshot_of_the_camera(tmp_path, camera, shutter):
    first = "dmp40" if hasattr(camera, "planes") else "dli4120"
    export, bench = exported(tmp_path, camera, first, *shutter), bench_of(camera, black=100)
    folder = capture(export, bench, tmp_path / "frames", gain=bench.gain)
    found = joined(folder, export, camera)
    wanted = camera(*scene_of(camera))
    step = bench.gain * (camera.slots if camera.exposure == "per-slot" else 1)
    assert float((found.values - wanted).abs().max()) <= 1.01 * step + 1e-3 * float(hasattr(camera, "planes"))
    assert bench.taken == (1 if shutter == ["coded-exposure"] else camera.slots) + 4


def test_a_bench_images_what_was_exported(tmp_path):
    """A mirror without the higher modes of a mask blurs otherwise than the mask."""
    camera = mirror(modes=range(4, 28), rms=100e-9)
    export, bench = exported(tmp_path, camera, "dmp40", "coded-exposure"), bench_of(camera)
    found = joined(capture(export, bench, tmp_path / "f", gain=bench.gain), export, camera)
    assert float((found.values - camera(*scene_of(camera))).abs().max()) > 20 * bench.gain


def test_a_bench_with_faults_is_one(tmp_path):
    camera, faults = spectral(), Hardware(misregistration=0.5, contrast_ratio=30)
    export, bench = exported(tmp_path, camera), bench_of(camera, hardware=faults)
    found = joined(capture(export, bench, tmp_path / "f", gain=bench.gain), export, camera)
    wanted = imperfect(camera, faults, outside="dark")(*scene_of(camera))
    assert float((found.values - wanted).abs().max()) <= 1.01 * bench.gain


@pytest.fixture
def taken(tmp_path):
    camera = spectral(sensor=Sensor(read_noise=0.01))
    export = exported(tmp_path, camera)
    return camera, export, capture(export, bench_of(camera), tmp_path / "frames")


def test_what_a_process_killed_behind_its_last_frame_left_is_gone_after_the_next(taken):
    camera, export, folder = taken
    files = {file.name for file in folder.iterdir()}
    left = folder / ".captures.json.0123456789ab.tmp"
    left.mkdir()
    (left / ".lock").touch()
    capture(export, bench_of(camera), folder)
    assert {file.name for file in folder.iterdir()} == files


@pytest.mark.parametrize(("damage", "said"), [
    (lambda file: file.write_bytes(file.read_bytes()[:-1]), "another content.*delete this one file"),
    (lambda file: shutil.copy(file.with_name("slot_002.tif"), file), "another content"),
    (lambda file: file.unlink(), "no such file"),
])  # fmt: skip
def test_a_frame_that_is_gone_damaged_or_anothers_is_taken_again_as_it_was_and_the_rest_stays(taken, damage, said):
    camera, export, folder = taken
    kept = {file.name: file.read_bytes() for file in folder.glob("*.tif")}
    assert len({*kept.values()}) == len(kept)
    damage(folder / "slot_001.tif")
    with pytest.raises(DataError, match=rf"slot_001\.tif: found {said}"):
        joined(folder, export, camera)
    (folder / "slot_001.tif").unlink(missing_ok=True)
    bench = bench_of(camera)
    capture(export, bench, folder)
    assert bench.taken == 1
    assert {file.name: file.read_bytes() for file in folder.glob("*.tif")} == kept
    joined(folder, export, camera)


def test_a_capture_goes_on_with_its_codes_however_often_they_are_exported(tmp_path, monkeypatch):
    camera = spectral(sensor=Sensor(read_noise=0.01))
    export = exported(tmp_path, camera)
    with pytest.raises(DeviceError):
        capture(export, bench_of(camera, stops_after=3), tmp_path / "f")
    kept = (tmp_path / "f" / "slot_001.tif").read_bytes()
    monkeypatch.setattr("tmca.lab.display.export.datetime", type("Later", (), {"now": lambda zone: LATER}))
    devices, source = [small_device(name) for name in ("dli4120", "emulated-shutter")], tmp_path / "taken.nc"
    before = read_manifest(export)
    export_codes(read_planes(source), devices, export, overwrite=True)
    assert read_manifest(export)["written"] != before["written"]
    joined(capture(export, bench_of(camera), tmp_path / "f"), export, camera)
    assert (tmp_path / "f" / "slot_001.tif").read_bytes() == kept


@pytest.mark.parametrize("change", ["codes", "order", "place", "device", "time"])
def test_a_capture_does_not_go_on_with_what_shows_otherwise(tmp_path, change):
    camera = spectral(shutter=torch.ones(3, 12, 18))
    export = exported(tmp_path, camera)
    folder = capture(export, bench_of(camera), tmp_path / "f")
    planes, how = read_planes(tmp_path / "taken.nc"), {"overwrite": True}
    aperture = planes.planes["aperture"].clone()
    if change == "codes":
        aperture[1, 5, 6] = 1 - aperture[1, 5, 6]
    if change == "order":
        aperture = aperture[[1, 0, 2]]
    how |= {"place": {"offset": (3, 0)}, "time": {"exposure": 0.3}}.get(change, {})
    first = small_device("dli4120", macro_pixel=2) if change == "device" else small_device("dli4120")
    other = replace(planes, planes={**planes.planes, "aperture": aperture})
    export_codes(other, [first, small_device("emulated-shutter")], export, **how)
    with pytest.raises(OutputError, match="a capture of"):
        capture(export, bench_of(camera), folder)
    with pytest.raises(DataError, match="a capture of"):
        joined(folder, export, camera)


def test_a_capture_of_before_is_of_the_manifest_that_it_knows(taken):
    camera, export, folder = taken
    known = json.loads((folder / "captures.json").read_text())
    assert known.pop("shown_sha256")
    (folder / "captures.json").write_text(json.dumps(known))
    joined(capture(export, bench_of(camera), folder), export, camera)


def noisy(shutter, sensor, seed=0, **settings):
    """A camera before an even scene, frames joined after a capture, and what it records without noise."""
    camera = spectral((60, 64), shutter=shutter, sensor=sensor)
    scene = torch.full((1, 3, 60, 64), 0.7)
    return (
        camera,
        find_device("simulated", camera=camera, scene=[scene], seed=seed, **settings),
        camera.operator().A(scene),
    )


@pytest.mark.parametrize("repeats", [1, 3])
def test_emulated_exposures_are_as_noisy_as_their_time_allows(tmp_path, repeats):
    """n open slots: shot noise of the light in them, read noise of n frames, and n times that of the dark ones' mean;
    and so the decoder is told."""
    camera, bench, light = noisy("random", Sensor(read_noise=0.01, full_well=3000))
    export = exported(tmp_path, camera)
    found = joined(capture(export, bench, tmp_path / "f", gain=bench.gain, repeats=repeats), export, camera)
    left, opened = found.values - light, camera.codes()[1].sum(0)
    electron = camera.white / 3000
    assert found.camera.noise.shot == pytest.approx(camera.noise.shot / repeats)
    told = 0.01**2 * (opened / repeats + opened**2 / 4).mean()
    assert found.camera.noise.read**2 == pytest.approx(float(told), rel=0.1)
    for count in (1, 2, 3):
        here = (opened == count)[None, None]
        wanted = light[here].mean() * electron / repeats + 0.01**2 * (count / repeats + count**2 / 4)
        assert float(left[here].square().mean()) == pytest.approx(float(wanted), rel=0.15)


@pytest.mark.parametrize("stop", [5, 6, 7, 8])
def test_repeats_that_were_stopped_are_counted_slot_by_slot(tmp_path, stop):
    """Stopped after a dark frame, three slots, the second dark frame and none to three slots: what is left of the
    scene's noise is what the decoder is told, and what frames of 1 and of 2 repeats leave."""
    sensor = Sensor(read_noise=0.03, full_well=500)
    camera, bench, light = noisy("random", sensor, stops_after=stop)
    export = exported(tmp_path, camera)
    with pytest.raises(DeviceError):
        capture(export, bench, tmp_path / "f", gain=bench.gain, repeats=2)
    capture(export, noisy("random", sensor)[1], tmp_path / "f", gain=bench.gain)
    found = joined(tmp_path / "f", export, camera)
    repeats = torch.tensor([2.0 if slot < stop - 5 else 1.0 for slot in range(3)])
    opened = camera.codes()[1]
    share = opened.double() / repeats[:, None, None]
    read = 0.03**2 * (share.sum(0) + opened.sum(0) ** 2 / 4)
    assert found.camera.noise.read**2 == pytest.approx(float(read.mean()), rel=0.1)
    bright = torch.stack([one_pattern(camera, pattern, torch.full((3, 60, 64), 0.7)) for pattern in camera.codes()[0]])
    shot = camera.white / 500 * (bright * share).mean(0)  # a third of the light in each, read with three times the gain
    left = (found.values - light)[0, 0]
    assert float(left.square().mean()) == pytest.approx(float((read + shot).mean()), rel=0.1)
    told = camera.white / 500 * light[0, 0].mean() / (found.camera.sensor.full_well / 500)
    assert float(told) == pytest.approx(float(shot.mean()), rel=0.05)
    assert found.notes["frames_averaged"] == pytest.approx(3 * float(opened.sum() / share.sum()))


def one_pattern(camera, pattern, scene):
    """(H, W) what the sensor sees of a scene (L, H, W) through one aperture pattern: whole pixels of dispersion."""
    found = torch.zeros(camera.snapshot_shape[1:])
    for band in range(camera.bands):
        left = int(camera.dispersion.displacement[band]) - camera.dispersion.origin
        found[:, left : left + camera.size[1]] += pattern * scene[band] * float(camera.response[band])
    return found


def test_a_sensor_that_codes_its_shutter_is_read_once(tmp_path):
    camera, bench, light = noisy("random", Sensor(read_noise=0.01))
    export = exported(tmp_path, camera, "dli4120", "coded-exposure")
    found = joined(capture(export, bench, tmp_path / "f", gain=bench.gain), export, camera)
    assert float((found.values - light).square().mean()) == pytest.approx(
        1.25 * 0.01**2, rel=0.1
    )  # its own, and the darks'
    assert found.camera.noise.read == pytest.approx(1.25**0.5 * 0.01, rel=0.1)


def test_noise_around_black_is_not_clipped(tmp_path):
    camera, bench, _ = noisy("one-hot", Sensor(read_noise=0.1))
    folder = capture(exported(tmp_path, camera), bench, tmp_path / "f")
    assert tifffile.imread(folder / "dark.tif").min() > 0


def test_a_capture_that_is_gone_on_with_is_the_one_without_a_stop(tmp_path):
    camera = spectral(sensor=Sensor(read_noise=0.01))
    export, told, bench = exported(tmp_path, camera), [], bench_of(camera)
    capture(export, bench_of(camera), tmp_path / "whole", repeats=2)
    with pytest.raises(DeviceError, match="no answer after 3 frames"):
        capture(export, bench_of(camera, stops_after=3), tmp_path / "parts", repeats=2)
    kept = sorted(file.name for file in (tmp_path / "parts").glob("*.tif"))
    assert kept == ["dark.tif", "slot_000.tif", "slot_001.tif"]
    capture(export, bench, tmp_path / "parts", repeats=2, progress=lambda *done: told.append(done))
    assert bench.taken == 10 - 3
    assert [one[:2] for one in told] == [(done, 10) for done in range(1, 11)]
    there = [name for *_, name in told if name.endswith(" (cached)")]
    assert there == ["dark (cached)", "slot_000 (cached)", "slot_001 (cached)"]
    names = sorted(file.name for file in (tmp_path / "whole").glob("*.tif"))
    slots = [f"slot_00{k}{end}.tif" for k in range(3) for end in ("", "_r1")]
    assert names == ["dark.tif", *(f"dark_r{n}.tif" for n in (1, 2, 3)), *slots]
    frames = [(tmp_path / "whole" / name).read_bytes() for name in names]
    assert frames == [(tmp_path / "parts" / name).read_bytes() for name in names]
    assert len({*frames}) == len(frames)


@pytest.mark.parametrize(("camera", "words"), [
    (spectral((20, 20)), r"aperture of \(3, 12, 16\)"),
    (SpectralCamera(bands=3, size=(12, 16), slots=3, seed=5), r"other codes in the aperture.*--like"),
    (SpectralCamera(bands=3, size=(12, 16), slots=2, seed=2), "3 slots"),
])  # fmt: skip
def test_frames_are_no_capture_of_a_camera_with_other_codes(taken, camera, words):
    _, export, folder = taken
    with pytest.raises(DataError, match=words):
        joined(folder, export, camera)


def grey(moved=0):
    aperture = torch.rand(2, 12, 16, generator=torch.Generator().manual_seed(0)).roll(moved, 2)
    return SpectralCamera(bands=3, size=(12, 16), slots=2, aperture=aperture, shutter="one-hot")


@pytest.mark.parametrize(("camera", "other", "devices"), [
    (grey(), grey(moved=1), ("pluto-2.1", "emulated-shutter")),
    (mirror(), mirror(rms=21e-9), ("dmp40", "coded-exposure")),
])  # fmt: skip
def test_codes_are_known_again_through_the_levels_of_a_display_and_the_terms_of_a_mirror(
    tmp_path, camera, other, devices
):
    export = exported(tmp_path, camera, *devices)
    check_camera(export, camera)
    with pytest.raises(DataError, match=r"other codes in the (aperture|heights)"):
        check_camera(export, other)


def test_an_aperture_that_changes_has_to_be_exported(tmp_path):
    camera = spectral()
    export = exported(tmp_path, camera, "emulated-shutter")
    with pytest.raises(DataError, match=r"no aperture.*changes from slot to slot"):
        capture(export, bench_of(camera), tmp_path / "f", camera=camera)
    assert not (tmp_path / "f").exists()
    static = SpectralCamera(bands=3, size=(12, 16), slots=2, aperture="static", seed=2)
    check_camera(exported(tmp_path / "b", static, "emulated-shutter"), static)


def test_codes_of_another_size_are_no_export_for_a_bench(tmp_path):
    export = exported(tmp_path, spectral())
    with pytest.raises(DeviceError, match="aperture of"):
        bench_of(spectral((20, 20))).load(Export(export, read_manifest(export)))
