"""Options and commands of the spectral-depth camera: scenes with depth go in, cube and depth come out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Group, Parameter

from tmca.cli.options.bench import BenchOptions
from tmca.cli.options.hardware import HardwareOptions
from tmca.cli.options.numbers import numbers, size, whole
from tmca.cli.options.output import OutputOptions, check_targets
from tmca.cli.options.sensor import SensorOptions
from tmca.cli.progress import progress_bar
from tmca.errors import SettingError

if TYPE_CHECKING:
    import xarray as xr

    from tmca.cameras import SpectralDepthCamera

_SCENE = Group("Reading the scene", sort_key=0)
_CAMERA = Group("Camera", sort_key=1)
_MOST_NM = 1e5
"""Of random heights: a tenth of a millimetre."""


@Parameter(name="*")
@dataclass(frozen=True)
class DepthSceneOptions:
    """How a scene with depth is read."""

    reduce: Annotated[int, Parameter(group=_SCENE, converter=whole)] = 1
    "Whole number of pixels per axis that are averaged into one."
    placed: Annotated[str | None, Parameter(group=_SCENE)] = None
    "Put a cube without depth at drawn depths: plane, slanted, staged, smooth, pieces or random."
    from_rgb: Annotated[bool, Parameter(group=_SCENE, negative="")] = False
    "Make up spectra of measured reflectances for an RGB-D scene."
    materials: Annotated[Literal["train", "test"], Parameter(group=_SCENE)] = "train"
    "Half of the measured reflectances that spectra are made up of; test for scenes that are held out."
    metric_depth: Annotated[bool, Parameter(group=_SCENE, negative="")] = False
    "Keep depth in metres, instead of mapping inverse depth onto the camera's range; what is outside is masked."
    scene_seed: Annotated[int, Parameter(group=_SCENE, converter=whole)] = 0
    "Of what is drawn for the scene: made-up spectra, depths."

    def load(self, source: str, camera: SpectralDepthCamera, crop: tuple[int, int] | None) -> xr.Dataset:
        """The scene at bands and depth range of a camera."""
        from tmca.data.depth_scenes import load_spectral_depth

        for name, value, least in (("--reduce", self.reduce, 1), ("--scene-seed", self.scene_seed, 0)):
            if value < least:
                raise SettingError(name, str(value), f"{least} or more")
        self._check_pairs()
        return load_spectral_depth(
            source, camera.wavelengths, near=camera.planes.near, far=camera.planes.far, size=crop,
            reduce=self.reduce, placed=self.placed, from_rgb=self.from_rgb, materials=self.materials,
            fitted=not self.metric_depth, seed=self.scene_seed,
        )  # fmt: skip

    def _check_pairs(self) -> None:
        """Refuses options that no kind of scene uses together."""
        if self.materials != "train" and not self.from_rgb:
            known = "beside --from-rgb alone, which makes spectra up of them"
            raise SettingError("--materials", self.materials, known, "leave it out, or add --from-rgb")
        for name, given in (("--from-rgb", self.from_rgb), ("--metric-depth", self.metric_depth)):
            if given and self.placed is not None:
                known = "one of them: --placed is for cubes, which have spectra and no depth"
                raise SettingError(name, f"--placed {self.placed} beside it", known, "leave one of the two out")


@Parameter(name="*")
@dataclass(frozen=True)
class SpectralDepthOptions:
    """The spectral-depth camera."""

    preset: Annotated[str, Parameter(group=_CAMERA)] = "quick"
    "Start from a named camera: thesis, diffractive (its phase mask alone), quick, quick-diffractive."
    slots: Annotated[int | None, Parameter(group=_CAMERA, converter=whole)] = None
    "Time slots K within the exposure."
    depth: Annotated[str | None, Parameter(group=_CAMERA)] = None
    "NEAR,FAR of the depth planes, metres. [default: 0.4,2]"
    planes: Annotated[int | None, Parameter(group=_CAMERA, converter=whole)] = None
    "Number of depth planes, even in inverse depth."
    mask: Annotated[str | None, Parameter(group=_CAMERA)] = None
    "Phase mask: flat, zernike, free-form, rotational or lens."
    rms_nm: Annotated[float | None, Parameter(group=_CAMERA)] = None
    "Of a random mask's heights, nm. [default: 100]"
    modes: Annotated[int | None, Parameter(group=_CAMERA, converter=whole)] = None
    "Zernike modes of a random mask, from defocus on. [default: 18]"
    shutter: Annotated[str | None, Parameter(group=_CAMERA)] = None
    "Shutter codes: random, open, one-hot, complementary or blue-noise."
    filters: Annotated[str | None, Parameter(group=_CAMERA)] = None
    "Colour filters over the pixels: clear, gaussian or rgbw."
    channels: Annotated[str | None, Parameter(group=_CAMERA)] = None
    "Of the sensor: monochrome or rgb."
    period: Annotated[int | None, Parameter(group=_CAMERA, converter=whole)] = None
    "Tile of shutter and filters, pixels."
    exposure: Annotated[str | None, Parameter(group=_CAMERA)] = None
    "equal: the slots share one exposure time; per-slot: each has its own."
    image_formation: Annotated[str | None, Parameter(group=_CAMERA)] = None
    "linear, or occlusion: near layers hide far ones."
    codes: Annotated[Path | None, Parameter(group=_CAMERA)] = None
    """Masks, shutter, filters and their bench from a file of `tmca design` (codes.nc), the bands are then the preset's;
    or all of the camera from weights of `tmca train`."""
    seed: Annotated[int, Parameter(group=_CAMERA, converter=whole)] = 0
    "Of the codes and the noise."

    def camera(self, sensor: SensorOptions, bench: BenchOptions, crop: tuple[int, int]) -> SpectralDepthCamera:
        """The camera that is described, of this size."""
        from tmca.cameras import SpectralDepthCamera
        from tmca.optics import changed_bench
        from tmca.sensor import Sensor

        own = ("preset", "codes", "rms_nm")
        given = {name: value for name, value in vars(self).items() if value is not None and name not in own}
        if self.depth is not None:
            given["depth"] = depth_range(self.depth)
        given |= self._drawn()
        if self.codes is not None and self.codes.suffix != ".nc":
            return self._trained(sensor, bench, crop)
        if changes := bench.changes():
            given["bench"] = changed_bench(SpectralDepthCamera.preset(self.preset)["bench"], changes)
        if self.codes is not None:
            given |= self._designed(given, bench)
        return SpectralDepthCamera.from_preset(self.preset, size=crop, sensor=Sensor(**vars(sensor)), **given)

    def _drawn(self) -> dict[str, float]:
        """What random masks are drawn with."""
        without = {"rms_nm": ("flat", "lens"), "modes": ("flat", "lens", "rotational")}
        for name, families in without.items():
            if getattr(self, name) is not None and self.mask in families:
                option, found = f"--{name.replace('_', '-')}", f"a mask that is {self.mask}"
                raise SettingError(option, found, "a random mask that has it", "leave one of the two out")
        if self.rms_nm is None:
            return {}
        if not 0 <= self.rms_nm <= _MOST_NM:
            raise SettingError("--rms-nm", f"{self.rms_nm:g} nm", f"0 to {_MOST_NM:g}")
        return {"rms": self.rms_nm * 1e-9}

    def _trained(self, sensor: SensorOptions, bench: BenchOptions, crop: tuple[int, int]) -> SpectralDepthCamera:
        """The camera of a trained network, which nothing else may set."""
        from tmca.decoders import Weights
        from tmca.sensor import Sensor

        plain = vars(SpectralDepthOptions())
        beside = [name for name, value in vars(self).items() if name not in ("codes", "seed") and value != plain[name]]
        if named := [*(f"--{name.replace('_', '-')}" for name in beside), *bench.named()]:
            raise SettingError("--codes", f"{named[0]} beside weights", "one of them", "leave one of the two out")
        weights = Weights.load(self.codes or "")
        weights.check_kind("spectral-depth")
        camera: SpectralDepthCamera = weights.camera_for(crop, sensor=Sensor(**vars(sensor)))
        return camera

    def _designed(self, given: dict[str, Any], bench: BenchOptions) -> dict[str, Any]:
        """Camera arguments of a file of codes, which nothing else may set."""
        from tmca.cameras.phase_codes import read_phase_codes

        found = read_phase_codes(self.codes or "")
        beside = [name for name in given if name in (*found, "rms", "modes") and name != "slots"]
        if beside:
            own = {"rms": "--rms-nm", "bench": next(iter(bench.named()), "")}
            option = own.get(beside[0], f"--{beside[0].replace('_', '-')}")
            raise SettingError("--codes", f"{option} beside it", "one of them")
        if given.get("slots", found["slots"]) != found["slots"]:
            raise SettingError("--slots", str(given["slots"]), f"{found['slots']}, as the codes have", "leave it out")
        return found


def depth_range(text: str) -> tuple[float, float]:
    """``NEAR,FAR`` in metres."""
    values = numbers(text, "--depth")
    if not isinstance(values, list) or len(values) != 2:
        raise SettingError("--depth", repr(text), "NEAR,FAR in metres, such as 0.4,2")
    return (values[0], values[1])


def take(
    scene: str,
    crop: str | None,
    reading: DepthSceneOptions,
    options: SpectralDepthOptions,
    bench: BenchOptions,
    sensor: SensorOptions,
    hardware: HardwareOptions,
    output: OutputOptions,
    calibration: Path | None = None,
) -> tuple[Any, Path]:
    """A snapshot of a scene, and where it goes."""
    from tmca.applications import simulate
    from tmca.applications.pictures import snapshot_files
    from tmca.cameras.spectral_depth import PROBE
    from tmca.lab.calibration.apply import bench_of

    probe, faults = options.camera(sensor, bench, PROBE), hardware.faults()
    loaded = reading.load(scene, probe, size(crop, "--crop"))
    target = output.out or Path(f"{loaded.attrs['name']}_snapshot.nc")
    check_targets(snapshot_files(target, "spectral-depth", output.figures), output.overwrite, scene)
    camera = options.camera(sensor, bench, (loaded.sizes["y"], loaded.sizes["x"]))
    placed = bench_of(camera, calibration, [] if options.codes is None else [options.codes])
    with progress_bar(f"simulate: {target.name}") as progress:
        taken = simulate(loaded, placed.camera, seed=options.seed, hardware=faults, progress=progress)
    return placed.recorded(taken), target
