"""``tmca simulate``: a scene goes in, a coded snapshot with its codes comes out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from tmca.cli.options.bench import BenchOptions
from tmca.cli.options.cameras import LightFieldOptions, SpectralOptions, light_field_camera, spectral_camera
from tmca.cli.options.hardware import HardwareOptions
from tmca.cli.options.light_field import LightFieldSceneOptions
from tmca.cli.options.light_field_bench import LightFieldBenchOptions
from tmca.cli.options.numbers import Whole, pair, size
from tmca.cli.options.output import OutputOptions, check_targets
from tmca.cli.options.scenes import SceneOptions, assumed, centre_assumed
from tmca.cli.options.sensor import SensorOptions
from tmca.cli.spectral_depth import DepthSceneOptions, SpectralDepthOptions, take
from tmca.errors import SettingError

app = App(name="simulate", help="Take a coded snapshot of a scene.")
_OUTPUT, _CAMERA, _SENSOR, _SCENE = OutputOptions(), SpectralOptions(), SensorOptions(), SceneOptions()
_VIEWS, _MASK, _PLACED = LightFieldSceneOptions(), LightFieldOptions(), LightFieldBenchOptions()
_DEPTH, _BENCH, _OPTICS = DepthSceneOptions(), SpectralDepthOptions(), BenchOptions()
_HARDWARE = HardwareOptions()


@app.command
def spectral(
    *scenes: str,
    bands: Whole = 12,
    all_bands: Annotated[bool, Parameter(negative="")] = False,
    crop: str | None = None,
    motion: str | None = None,
    reading: SceneOptions = _SCENE,
    camera: SpectralOptions = _CAMERA,
    sensor: SensorOptions = _SENSOR,
    calibration: Path | None = None,
    hardware: HardwareOptions = _HARDWARE,
    output: OutputOptions = _OUTPUT,
) -> None:
    """Take a snapshot of SCENES with the spectral camera: one scene, or one for each slot of the exposure.

    The file that is written holds the snapshot and everything needed to reconstruct it: codes, displacement with
    direction and origin, wavelengths, exposure and noise.

    Args:
        scenes: a cube (.mat, ENVI, TIFF, .npy, NetCDF, HDF5, Zarr, CAVE folder) or a rendered scene such as coffee.
        bands: bands of the camera, nearest to even spacing from 400 to 700 nm.
        all_bands: keep every band of the file instead.
        crop: HEIGHTxWIDTH, the middle of the scene.
        motion: ROWS,COLUMNS by which the scene moves within the exposure, pixels.
        calibration: of a camera that was measured, by `tmca calibrate`: a file, or its name without the date for the
            newest. The snapshot is what that camera takes; reconstruct it with the same --calibration.
    """
    from tmca.applications import simulate
    from tmca.applications.pictures import snapshot_files
    from tmca.data.scenes import load_scene

    kept = None if all_bands else bands
    if not scenes:
        raise SettingError("simulate spectral", "no scene", "a cube file or a rendered scene such as coffee")
    cubes = [load_scene(scene, bands=kept, size=size(crop, "--crop"), **reading.reading()) for scene in scenes]
    cube, moved, faults = cubes[0], pair(motion, "--motion"), hardware.faults()
    assumed(cube)
    known = spectral_camera(cube, camera, sensor)
    target = output.out or Path(f"{cube.attrs['name']}_snapshot.nc")
    check_targets(snapshot_files(target, "spectral", output.figures), output.overwrite, scenes[0])
    bench = _bench_of(known, calibration, camera.files())
    taken = bench.recorded(simulate(cubes, bench.camera, seed=camera.seed, motion=moved, hardware=faults))
    how = " -d admm-tv" if taken.camera.blurred else ""
    _write(taken, target, output, {"bands": taken.camera.bands}, f"{taken.camera.bands} bands", how)


@app.command
def light_field(
    scene: str,
    /,
    *,
    crop: str | None = None,
    reading: LightFieldSceneOptions = _VIEWS,
    camera: LightFieldOptions = _MASK,
    bench: LightFieldBenchOptions = _PLACED,
    sensor: SensorOptions = _SENSOR,
    calibration: Path | None = None,
    hardware: HardwareOptions = _HARDWARE,
    output: OutputOptions = _OUTPUT,
) -> None:
    """Take a snapshot of SCENE with the light-field camera: a coded mask in front of the sensor.

    The file that is written holds the snapshot and everything needed to reconstruct it: codes, shear, vignetting,
    exposure and noise.

    Args:
        scene: a folder of views, a lenslet picture, a labelled file, or a rendered scene such as coffee, or coffee:3.
        crop: HEIGHTxWIDTH, the middle of the scene; the size of a rendered one.
        calibration: of a camera that was measured, by `tmca calibrate`: a file, or its name without the date for the
            newest. The snapshot is what that camera takes; reconstruct it with the same --calibration.
    """
    from tmca.applications import simulate
    from tmca.applications.pictures import snapshot_files
    from tmca.data.light_field_scenes import load_light_field

    field = load_light_field(scene, size=size(crop, "--crop"), **reading.reading())
    centre_assumed(field)
    target = output.out or Path(f"{field.attrs['name']}_snapshot.nc")
    check_targets(snapshot_files(target, "light-field", output.figures), output.overwrite, scene)
    known = light_field_camera(field, camera, bench, sensor)
    placed = _bench_of(known, calibration, camera.files())
    taken = placed.recorded(simulate(field, placed.camera, seed=camera.seed, hardware=hardware.faults()))
    views = list(taken.camera.views)
    _write(taken, target, output, {"views": views}, f"{views[0]}×{views[1]} views", "")


@app.command
def spectral_depth(
    scene: str,
    /,
    *,
    crop: str | None = None,
    reading: DepthSceneOptions = _DEPTH,
    camera: SpectralDepthOptions = _BENCH,
    bench: BenchOptions = _OPTICS,
    sensor: SensorOptions = _SENSOR,
    calibration: Path | None = None,
    hardware: HardwareOptions = _HARDWARE,
    output: OutputOptions = _OUTPUT,
) -> None:
    """Take a snapshot of SCENE with the spectral-depth camera: a phase mask that changes within the exposure.

    The file that is written holds the snapshot and everything needed to reconstruct it: height maps, shutter, filters,
    bench, depth planes, exposure and noise. Depth is mapped onto the camera's range, evenly in inverse depth.

    Args:
        scene: a rendered scene such as motorcycle, a file or folder with a cube and its depth, an RGB-D scene with
            --from-rgb, or a cube with --placed.
        crop: HEIGHTxWIDTH, the middle of the scene.
        calibration: of a camera that was measured, by `tmca calibrate`: a file, or its name without the date for the
            newest. The snapshot is what that camera takes; reconstruct it with the same --calibration.
    """
    from tmca.applications.unknown_depth import TOTAL, said_unknown

    taken, target = take(scene, crop, reading, camera, bench, sensor, hardware, output, calibration)
    counts = {name: count for name, count in taken.notes.items() if name.startswith("unknown_")}
    about, (height, width) = {"bands": taken.camera.bands, **counts}, taken.camera.size
    channels = f"{taken.camera.bands} bands, {taken.camera.planes.count} depth planes"
    channels += f", {said_unknown(counts, height * width)}" if counts[TOTAL] else ""
    channels += _mapped(taken)
    _write(taken, target, output, about, channels, "")


def _mapped(taken: Any) -> str:
    """Which depths of the scene lie in the camera's range, where they were mapped onto it."""
    if "inverse_depth_scale" not in taken.notes:
        return ""
    scale, shift = taken.notes["inverse_depth_scale"], taken.notes["inverse_depth_shift"]
    planes = taken.camera.planes
    inverse = [(1 / end - shift) / scale for end in (planes.near, planes.far)]
    own = [1 / value if value > 1e-9 else float("inf") for value in inverse]
    kept = f"{planes.near:g} to {planes.far:g} m (--metric-depth keeps metres)"
    return f", depths of {own[0]:.3g} to {own[1]:.3g} m mapped onto {kept}"


def _bench_of(camera: Any, calibration: Path | None, codes: list[Path]) -> Any:
    from tmca.lab.calibration.apply import bench_of

    return bench_of(camera, calibration, codes)


def _write(
    taken: Any,
    target: Path,
    output: OutputOptions,
    about: dict[str, Any],
    channels: str,
    how: str,
) -> None:
    """Write a snapshot with its pictures, and say what it is and how to go on."""
    from tmca.applications.pictures import snapshot_pictures

    written = [taken.save(target, overwrite=output.overwrite)]
    if output.figures:
        written += snapshot_pictures(taken, target, overwrite=output.overwrite)
    report: dict[str, Any] = {
        "snapshot": str(target),
        "size": list(taken.camera.snapshot_shape[1:]),
        **about,
        "slots": taken.camera.slots,
        "throughput": taken.camera.throughput(),
        "noise": vars(taken.camera.noise),
        "hardware": taken.notes.get("hardware", ""),
        "calibration": taken.notes.get("simulated_calibration", ""),
        "codes_date": taken.notes["codes_date"],
        "files": [str(file) for file in written],
    }
    if output.json:
        print(json.dumps(report, indent=1))
        return
    print(f"{target}: {report['size'][0]}×{report['size'][1]} pixels, {channels}, K = {report['slots']}")
    if "hardware" in taken.notes:
        print(f"taken with faults that decoders are not told of: {taken.notes['hardware']}")
    if "simulated_calibration" in taken.notes:
        how += f" --calibration {taken.notes['simulated_calibration']}"
    print(f"light throughput {report['throughput']:.1%}; reconstruct it with: tmca reconstruct {target}{how}")
