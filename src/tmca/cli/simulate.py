"""``tmca simulate``: a scene goes in, a coded snapshot with its codes comes out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from shlex import quote
from typing import Annotated, Any

from cyclopts import App, Parameter

from tmca.cli.cameras import BENCH, CAMERA, READING, SENSOR, CameraChoice, Faults, code_files
from tmca.cli.options.numbers import MaybeWhole, Whole, pair, size
from tmca.cli.options.output import OutputOptions, assumed, centre_assumed, check_targets, say
from tmca.cli.sweep import one_value
from tmca.errors import SettingError
from tmca.progress import progress_bar
from tmca.specs import (
    BandsReading,
    DepthReading,
    Hardware,
    LightFieldReading,
    LightFieldSpec,
    MaskPlaceSpec,
    PhaseBenchSpec,
    SensorFileSpec,
    SensorSpec,
    SpectralDepthSpec,
    SpectralSpec,
    read_sensor,
    spec_of,
)

app = App(name="simulate", help="Take a coded snapshot of a scene.")
_OUTPUT, _SENSOR = OutputOptions(), SensorSpec()
_CUBE, _VIEWS, _DEPTH = BandsReading(), LightFieldReading(), DepthReading()
_SPECTRAL, _LIGHT_FIELD, _SPECTRAL_DEPTH = SpectralSpec(), LightFieldSpec(), SpectralDepthSpec()
_PLACE, _BENCH = MaskPlaceSpec(), PhaseBenchSpec()
_SENSOR_FILE = "YAML file with the names of these options, as `tmca design` takes it; options replace its values."
_CALIBRATION = """Of a camera that was measured, by `tmca calibrate`: a file, or its name without the date for the
newest. The snapshot is what that camera takes; reconstruct it with the same --calibration."""
SensorFile = Annotated[Path | None, Parameter(name="--sensor", group=SENSOR.group, help=_SENSOR_FILE)]
Calibration = Annotated[Path | None, Parameter(help=_CALIBRATION)]


@app.command
def spectral(
    *scenes: str,
    crop: str | None = None,
    bands: MaybeWhole = None,
    all_bands: bool = False,
    motion: str | None = None,
    calibration: Calibration = None,
    reading: Annotated[BandsReading, READING] = _CUBE,
    camera: Annotated[SpectralSpec, CAMERA] = _SPECTRAL,
    sensor: Annotated[SensorSpec, SENSOR] = _SENSOR,
    sensor_file: SensorFile = None,
    hardware: Faults = None,
    output: OutputOptions = _OUTPUT,
) -> None:
    """Take a snapshot of SCENES with the spectral camera: one scene, or one for each slot of the exposure.

    The file that is written holds the snapshot and everything needed to reconstruct it: codes, displacement with
    direction and origin, wavelengths, exposure and noise.

    Args:
        scenes: a cube (.mat, ENVI, TIFF, .npy, NetCDF, HDF5, Zarr, CAVE folder) or a rendered scene such as coffee.
        crop: HEIGHTxWIDTH, the middle of the scene.
        bands: bands of the camera, nearest to even spacing from 400 to 700 nm. [default: 12, or all of fewer]
        all_bands: keep every band of the file instead.
        motion: ROWS,COLUMNS by which the scene moves within the exposure, pixels.
    """
    _check_named("spectral", scenes)
    how = {"size": size(crop, "--crop"), **reading.given()}
    how |= {"bands": None if all_bands else bands} if all_bands or bands is not None else {}
    if not (all_bands or {"bands", "range"} <= {*how}):
        how = _usual_bands(scenes, how) | how
    choice, moved = CameraChoice(camera, _sensor(sensor_file, sensor)), pair(motion, "--motion")
    taken = _taken(choice, how, scenes, calibration, hardware, output, assumed, motion=moved)
    count, there = taken[0].camera.bands, taken[0].notes.get("source_bands")
    said = f"{count} of {there} bands (--all-bands for all)" if there else f"{count} bands"
    about = {"bands": count, **({"source_bands": there} if there else {}), **_learned(choice)}
    _write(*taken, output, about, said)


def _usual_bands(scenes: Sequence[str], reading: Mapping[str, Any]) -> dict[str, Any]:
    """Bands, and range where it is not from 400 to 700 nm, which is said; see `tmca.data.fitting.usual_bands`."""
    from tmca.data.fitting import usual_bands
    from tmca.data.headers import wavelengths_of

    about = {name: reading[name] for name in ("wavelengths", "variable") if name in reading}
    there = {scene: wavelengths_of(scene, **about) for scene in scenes}
    return usual_bands(there, reading.get("range"))


@app.command
def light_field(
    *scenes: str,
    crop: str | None = None,
    motion: str | None = None,
    calibration: Calibration = None,
    reading: Annotated[LightFieldReading, READING] = _VIEWS,
    camera: Annotated[LightFieldSpec, CAMERA] = _LIGHT_FIELD,
    bench: Annotated[MaskPlaceSpec, BENCH] = _PLACE,
    sensor: Annotated[SensorSpec, SENSOR] = _SENSOR,
    sensor_file: SensorFile = None,
    hardware: Faults = None,
    output: OutputOptions = _OUTPUT,
) -> None:
    """Take a snapshot of SCENES with the light-field camera: one scene, or one for each slot of the exposure.

    A coded mask stands in front of the sensor. The file that is written holds the snapshot and everything needed to
    reconstruct it: codes, shear, vignetting, exposure and noise.

    Args:
        scenes: a folder of views, a lenslet picture, a labelled file, or a rendered scene such as coffee, or coffee:3.
        crop: HEIGHTxWIDTH, the middle of the scene; the size of a rendered one.
        motion: ROWS,COLUMNS by which the scene moves within the exposure, pixels.
    """
    _check_named("light-field", scenes)
    choice, moved = CameraChoice(camera, _sensor(sensor_file, sensor), bench), pair(motion, "--motion")
    how = {**reading.model_dump(), "size": size(crop, "--crop")}
    left_out: list[str] = []

    def said(light_field: Any) -> None:
        centre_assumed(light_field)
        if not reading.colour and light_field.attrs.get("source_colours") == 3:
            left_out.append(" in grey (--colour keeps the scene's colours)")

    taken = _taken(choice, how, scenes, calibration, hardware, output, said, motion=moved)
    views = list(taken[0].camera.views)
    about = {"views": views, **_learned(choice)}
    _write(*taken, output, about, f"{views[0]}×{views[1]} views{''.join(left_out)}")


@app.command
def spectral_depth(
    scene: str,
    /,
    *,
    crop: str | None = None,
    calibration: Calibration = None,
    reading: Annotated[DepthReading, READING] = _DEPTH,
    camera: Annotated[SpectralDepthSpec, CAMERA] = _SPECTRAL_DEPTH,
    bench: Annotated[PhaseBenchSpec, BENCH] = _BENCH,
    sensor: Annotated[SensorSpec, SENSOR] = _SENSOR,
    sensor_file: SensorFile = None,
    hardware: Faults = None,
    output: OutputOptions = _OUTPUT,
) -> None:
    """Take a snapshot of SCENE with the spectral-depth camera: a phase mask that changes within the exposure.

    The file that is written holds the snapshot and everything needed to reconstruct it: height maps, shutter, filters,
    bench, depth planes, exposure and noise. Depth is mapped onto the camera's range, evenly in inverse depth.

    Args:
        scene: a rendered scene such as motorcycle, a file or folder with a cube and its depth, an RGB-D scene with
            --from-rgb, or a cube with --placed.
        crop: HEIGHTxWIDTH, the middle of the scene.
    """
    from tmca.applications.spectral_depth import TOTAL, said_unknown

    choice = CameraChoice(camera, _sensor(sensor_file, sensor), bench)
    how = {**reading.arguments(), **choice.depth_reading(), "size": size(crop, "--crop")}
    taken, target = _taken(choice, how, (scene,), calibration, hardware, output)
    counts = {name: count for name, count in taken.notes.items() if name.startswith("unknown_")}
    height, width = taken.camera.size
    channels = f"{taken.camera.bands} bands, {taken.camera.planes.count} depth planes"
    channels += f", {said_unknown(counts, height * width)}" if counts[TOTAL] else ""
    about = {"bands": taken.camera.bands, **counts, **_learned(choice)}
    _write(taken, target, output, about, channels + _mapped(taken))


@app.default
def any_camera(
    kind: str | None = None,
    /,
    *scenes: str,
    crop: str | None = None,
    set_: Annotated[list[str] | None, Parameter(name="--set")] = None,
    seed: Whole = 0,
    sensor: Annotated[SensorSpec, SENSOR] = _SENSOR,
    sensor_file: SensorFile = None,
    hardware: Faults = None,
    output: OutputOptions = _OUTPUT,
) -> None:
    """Take a snapshot of SCENES with a camera of KIND, which has no command of its own.

    Args:
        kind: of a camera without a command of its own, such as one of another package.
        scenes: names or files of scenes: one, or one for each slot of the exposure.
        crop: HEIGHTxWIDTH, the middle of the scene.
        set_: NAME=VALUE, a number or word that the camera's constructor takes; may be given several times.
        seed: of the noise.
    """
    from tmca.applications import application_of
    from tmca.cameras import CAMERAS
    from tmca.data.fitting import middle_of
    from tmca.sensor import Sensor

    if kind is None:
        from tmca.cli.app import app as whole

        whole.help_print(["simulate"])
        return
    application, middle = application_of(kind), size(crop, "--crop")
    _check_named(kind, scenes)
    described = Sensor(**_sensor(sensor_file, sensor).model_dump())
    how: dict[str, Any] = {**application.settings_of(one_value(set_)), "sensor": described}
    read: list[Any] = [application.read(name) for name in scenes]
    read = [one if middle is None else middle_of(one, middle, name) for one, name in zip(read, scenes, strict=True)]
    camera = CAMERAS[kind](**application.parts(read[0]), **how)
    taken, target = _shot(camera, read, scenes[0], output, Hardware.read(hardware), seed=seed)
    _write(taken, target, output, {"camera": kind}, f"{kind} camera")


def _check_named(kind: str, scenes: Sequence[str]) -> None:
    """Raises SettingError where no scene is named."""
    if not scenes:
        raise SettingError(f"simulate {kind}", "no scene", "a file or a rendered scene such as coffee")


def _sensor(file: Path | None, options: SensorSpec) -> SensorSpec:
    """The sensor of a file, its values replaced by options."""
    stored = {} if file is None else read_sensor(file, SensorFileSpec).only(*SensorSpec.model_fields)
    return spec_of(SensorSpec, {**stored, **options.given()})


def _taken(
    choice: CameraChoice,
    reading: dict[str, Any],
    names: Sequence[str],
    calibration: Path | None,
    hardware: str | None,
    output: OutputOptions,
    say: Callable[[Any], None] = lambda scene: None,
    **how: Any,
) -> tuple[Any, Path]:
    """A snapshot of scenes, and the file it goes to."""
    from tmca.applications import application_of

    spec = choice.spec
    application, faults = application_of(spec.kind), Hardware.read(hardware)
    scenes = [application.read(name, **reading) for name in names]
    say(scenes[0])
    _check_target(_target(scenes, output), spec.kind, names[0], output)
    shape = {name: value for name, value in application.parts(scenes[0]).items() if name in spec.shape}
    camera = choice.build(**shape)
    how |= {"calibration": calibration, "codes": code_files(spec), "seed": getattr(spec, "seed", 0)}
    return _shot(camera, scenes, names[0], output, faults, **how)


def _shot(
    camera: Any,
    scenes: list[Any],
    name: str,
    output: OutputOptions,
    faults: Hardware,
    calibration: Path | None = None,
    codes: Sequence[Path] = (),
    **how: Any,
) -> tuple[Any, Path]:
    """What a camera takes of scenes, and the file it goes to."""
    from tmca.applications import simulate
    from tmca.lab.calibration.apply import bench_of

    target = _target(scenes, output)
    _check_target(target, camera.kind, name, output)
    placed = bench_of(camera, calibration, codes)
    with progress_bar(f"simulate: {target.name}") as progress:
        taken = simulate(scenes, placed.camera, hardware=faults, progress=progress, **how)
    return placed.recorded(taken), target


def _target(scenes: Sequence[Any], output: OutputOptions) -> Path:
    return output.out or Path(f"{scenes[0].attrs['name']}_snapshot.nc")


def _check_target(target: Path, kind: str, name: str, output: OutputOptions) -> None:
    """Refuse files that exist, before the work is done."""
    from tmca.applications.pictures import snapshot_files

    check_targets(snapshot_files(target, kind, output.figures), output.overwrite, name)


def _mapped(taken: Any) -> str:
    """Which depths of the scene lie in the camera's range, where they were mapped onto it."""
    from tmca.data.fitting import said_mapped

    said = said_mapped(taken.notes, taken.camera.planes.near, taken.camera.planes.far)
    return f", {said} (--metric-depth keeps metres)" if said else ""


def _learned(choice: CameraChoice) -> dict[str, str]:
    """The weights that brought the codes, and can decode what they take."""
    return {} if choice.name is None else {"weights": choice.name}


def _report(taken: Any, target: Path, about: dict[str, Any], written: Sequence[Path]) -> dict[str, Any]:
    """Of a snapshot, for programmes."""
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
    return report | ({"buckets": taken.camera.buckets} if taken.camera.buckets > 1 else {})


def _write(taken: Any, target: Path, output: OutputOptions, about: dict[str, Any], channels: str) -> None:
    """Write a snapshot with its pictures, and say what it is and how to go on."""
    from tmca.applications.pictures import snapshot_pictures

    written = [taken.save(target, overwrite=output.overwrite)]
    if output.figures:
        written += snapshot_pictures(taken, target, overwrite=output.overwrite)
    report = _report(taken, target, about, written)
    buckets = f", {report['buckets']} buckets" if "buckets" in report else ""
    lines = [f"{target}: {report['size'][0]}×{report['size'][1]} pixels, {channels}, K = {report['slots']}{buckets}"]
    lines += [f"taken with faults that decoders do not know: {report['hardware']}"] if report["hardware"] else []
    how = " -d admm-tv" if getattr(taken.camera, "blurred", False) and "weights" not in about else ""
    how += f" --weights {quote(about['weights'])}" if "weights" in about else ""
    how += f" --calibration {report['calibration']}" if report["calibration"] else ""
    noise = taken.camera.noise.in_words()
    noise = "no noise (--full-well, --read-noise)" if noise == "none" else f"noise: {noise}"
    lines.append(f"light throughput {report['throughput']:.1%}; {noise}")
    say(report, output.json, *lines, f"reconstruct it with: tmca reconstruct {target}{how}")
