"""Files of the bench: calibrations, manifests, captures, devices, exported decoders, ground truth."""

from __future__ import annotations

import functools
import shutil
import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
import torch
from PIL import Image

from studies.rendered_table import bench, render_scan
from tests.fuzz.kinds import kind
from tests.fuzz.kinds_formats import NM, cube
from tests.fuzz.kinds_own import BANDS, NET, _snapshot, _spectral
from tests.lab.calibration.test_buckets import two_buckets
from tests.lab.calibration.test_file import version_0_1, whole
from tests.lab.live.test_recording import CAMERA, shown
from tests.lab.test_deploy import written_weights
from tmca.cameras import Snapshot, SpectralCamera
from tmca.data import read_array, write_dataset, write_json
from tmca.decoders import Weights, build_network
from tmca.lab.acquisition.captures import CaptureFrame, keep, read_captures, said_sources
from tmca.lab.calibration.captures import taken_with
from tmca.lab.calibration.file import load_calibration
from tmca.lab.deploy import export_decoder, read_description
from tmca.lab.display.codes import Terms, read_planes, read_table, table
from tmca.lab.display.devices import DeviceDescription, device_named, response
from tmca.lab.display.export import export_codes
from tmca.lab.display.manifest import (
    device_of,
    exposed_whole,
    frame_time,
    placement_of,
    read_export,
    read_manifest,
    shown_digest,
)
from tmca.lab.frames import read_frames, write_frames
from tmca.lab.ground_truth import geometry
from tmca.lab.ground_truth.fringes import FringePlan, load_plan, read_capture, write_fringes
from tmca.lab.ground_truth.join import open_cube
from tmca.lab.ground_truth.scan import measure_reflectance, read_scan
from tmca.lab.ground_truth.spectra import read_spectra
from tmca.lab.live import Recording, recorded
from tmca.lab.loading import load_exported
from tmca.lab.notes import date_of_frames
from tmca.tuning.folder import find_pairs
from tmca.tuning.pairs import read_pair


def _calibration(path: Path, buckets: bool = False) -> None:
    with tempfile.TemporaryDirectory() as folder:
        saved = (two_buckets() if buckets else whole()).save(Path(folder) / "bench").path
        assert saved is not None
        shutil.copy(saved, path)


def _calibration_1(path: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        saved = version_0_1(Path(folder))
        shutil.copy(saved.with_suffix(".nc"), path.with_suffix(".nc"))
        shutil.copy(saved.with_suffix(".json"), path.with_suffix(".json"))


def _read_calibration(path: Path) -> Any:
    found = load_calibration(path)
    return found.parts, found.about, found.codes_seen


def _device(path: Path) -> None:
    path.write_text(
        "kind: lcos\nsize: [6, 7]\npitch_um: 8.0\nbits: 8\nflip: [rows]\nmacro_pixel: 2.0\ngamma: 2.2\n"
        "pattern_rate_hz: 60.0\nmemory_patterns: 24\n"
    )


def _read_device(path: Path) -> Any:
    device = device_named(str(path))
    return device.model_dump(), response(device)


def _response(path: Path) -> None:
    path.write_text("grey,light\n" + "".join(f"{grey},{(grey / 255) ** 2:g}\n" for grey in range(0, 256, 51)))


def _read_response(path: Path) -> Any:
    return response(DeviceDescription(name="slm", kind="lcos", size=(4, 4), bits=8, lut=str(path)))


def _terms(path: Path) -> None:
    path.write_text(table(Terms((4, 6), np.array([[1e-7, 2e-8], [3e-8, -1e-8]]), np.zeros(2))))


def _read_terms(path: Path) -> Any:
    terms = read_table(path)
    return terms.noll, terms.rms


def _spectra(path: Path) -> None:
    path.write_text("nm,red,blue\n" + "".join(f"{nm},{nm / 1000},{1 - nm / 1000}\n" for nm in range(400, 701, 50)))


def _read_spectra(path: Path) -> Any:
    spectra = read_spectra(path)
    return spectra.nm, spectra.values, spectra.at(np.array([500.0, 600.0]), 20.0)


def _frames(path: Path) -> None:
    path.mkdir()
    rng = np.random.default_rng(0)
    for n in range(2):
        tifffile.imwrite(path / f"frame_{n}.tif", rng.integers(0, 4000, (6, 7), dtype=np.uint16))
        Image.fromarray(rng.integers(0, 4000, (6, 7), dtype=np.uint16)).save(path / f"frame_{n + 2}.png")


def _capture(path: Path) -> None:
    record: dict[str, Any] = {
        "export": "shown", "export_sha256": "0" * 64, "shown_sha256": "0" * 64,
        "taken_with": {"gain": 1.0, "saturation": 4095.0, "driver": "mine"}, "frames": {},
    }  # fmt: skip
    rng = np.random.default_rng(0)
    for slot, name in ((None, "dark"), (0, "slot_000"), (1, "slot_001")):
        values = rng.integers(10, 20 if slot is None else 4000, (6, 7))
        keep(values, CaptureFrame(name, slot, name), record, path)
    write_json(record, path / "captures.json", overwrite=True)


def _read_capture(path: Path) -> Any:
    record = read_captures(path)
    said = taken_with(path), date_of_frames([path]), said_sources(path)
    return record, said, [read_array(path / f"{name}.tif") for name in record["frames"]]


@functools.cache
def _exported(name: str) -> Path:
    """The folder of an exported decoder in a format."""
    folder = Path(tempfile.mkdtemp())
    export_decoder(written_weights(folder, kind="unet"), folder / "out", (name,))
    return folder / "out"


def _decoder(path: Path) -> None:
    shutil.copy(_exported("torch" if path.suffix == ".pt2" else "onnx") / path.name, path)


def _read_decoder(path: Path) -> Any:
    return load_exported(path)(torch.full((1, 1, 24, 24), 0.5))


def _description(path: Path) -> None:
    path.mkdir()
    shutil.copy(_exported("torch") / "decoder.json", path / "decoder.json")


def _read_description(path: Path) -> Any:
    return read_description(path).model_dump()


def _export(path: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        _response(Path(folder) / "response.csv")
        codes = read_planes(_snapshot(_spectral(buckets=2)).save(Path(folder) / "taken.nc"))
        display = DeviceDescription(
            name="display", kind="lcos", size=(16, 20), bits=8, macro_pixel=2.0, lut=str(Path(folder) / "response.csv")
        )
        sensor = DeviceDescription(name="sensor", kind="coded-exposure", buckets=2, tile=(9, 12))
        export_codes(codes, [display, sensor], path)


def _read_export(path: Path) -> Any:
    return read_export(path).planes


def _manifest(path: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        _export(Path(folder) / "shown")
        shutil.copy(Path(folder) / "shown" / path.name, path)


def _read_manifest(path: Path) -> Any:
    manifest = read_manifest(path.parent)
    devices = [device_of(plane, path).model_dump() for plane in manifest["planes"]]
    placed = [vars(placement_of(plane, path)) for plane in manifest["planes"]]
    return shown_digest(manifest), exposed_whole(manifest), frame_time(manifest), devices, placed


def _recording(path: Path) -> None:
    with Recording(path, CAMERA, estimates=True) as recording:
        for number in range(3):
            recording.add(shown(number))


def _read_recording(path: Path) -> Any:
    return list(recorded(path))


kind("calibration.nc", _calibration, _read_calibration, infinite=True)
kind("buckets-calibration.nc", functools.partial(_calibration, buckets=True), _read_calibration, infinite=True)
kind("calibration1.nc", _calibration_1, _read_calibration, infinite=True)
kind("device.yaml", _device, _read_device)
kind("response.csv", _response, _read_response)
kind("terms.csv", _terms, _read_terms)
kind("spectra.csv", _spectra, _read_spectra)
kind("frames", _frames, read_frames)
kind("capture", _capture, _read_capture)
kind("decoder.pt2", _decoder, _read_decoder)
kind("described-decoder", _description, _read_description)
kind("export", _export, _read_export)
kind("manifest.json", _manifest, _read_manifest)
kind("recording.zarr", _recording, _read_recording)
if find_spec("onnxruntime"):
    kind("decoder.onnx", _decoder, _read_decoder)


def _fringes(path: Path) -> None:
    plan = FringePlan(size=(8, 64), fringes=(1, 4), steps=3)
    write_fringes(plan, path)
    phase = 2 * np.pi * np.linspace(0, 1, 13) * np.ones((6, 1))
    seen = [
        1000 + 800 * np.cos(count * phase - 2 * np.pi * step / plan.steps)
        for count in plan.fringes
        for step in range(plan.steps)
    ]
    write_frames(path / "captured", dict(zip(plan.names, np.array(seen).astype(np.uint16), strict=True)))


def _read_fringes(path: Path) -> Any:
    plan = load_plan(path)
    return plan, read_capture(path / "captured", plan)


def _projector(path: Path) -> None:
    bench((12, 16), (32, 64)).save(path)


def _read_projector(path: Path) -> Any:
    calibration = geometry.load_calibration(path)
    return calibration, geometry.camera_rays(calibration)


def _scan(path: Path) -> None:
    seen = render_scan(0.2 + 0.6 * cube().astype(np.float64), bits=16, darks=2)
    path.mkdir()
    for name, frames in (("scene", seen.scene), ("white", seen.white)):
        write_frames(path / name, {f"{name}_{nm:g}nm": frame for nm, frame in zip(NM, frames, strict=True)})
    write_frames(path / "dark", {f"dark_{index}": frame for index, frame in enumerate(seen.dark)})


def _read_scan(path: Path) -> Any:
    return measure_reflectance(read_scan(path / "scene", path / "dark", path / "white"))


def _measured(path: Path) -> None:
    _scan(path.with_suffix(""))
    write_dataset(_read_scan(path.with_suffix("")), path)
    shutil.rmtree(path.with_suffix(""))


def _pairs(path: Path) -> None:
    path.mkdir()
    torch.manual_seed(0)
    camera = SpectralCamera(BANDS, (6, 7), 2, period=3)
    Weights.of(build_network("unet", bands=3, start="dagger", **NET), camera).save(path / "weights.safetensors")
    for name in ("first", "second"):
        scene = torch.rand(1, *camera.scene_shape)
        Snapshot(camera(scene), camera, {}).save(path / f"{name}.nc")
        write_dataset(camera.label(scene), path / f"{name}_truth.nc")


def _read_pairs(path: Path) -> Any:
    weights = Weights.load(path / "weights.safetensors")
    return [read_pair(files, weights, None)[0] for files in find_pairs(path)]


kind("fringes", _fringes, _read_fringes)
kind("projector.json", _projector, _read_projector)
kind("scan", _scan, _read_scan, infinite=True)
kind("spectra.nc", _measured, open_cube, infinite=True)
kind("tuning", _pairs, _read_pairs)
