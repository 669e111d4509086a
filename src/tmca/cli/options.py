"""Options that several commands share."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Group, Parameter

from tmca.cli.numbers import whole
from tmca.cli.patterns import codes_argument, coloured_argument, fitted
from tmca.errors import SettingError

if TYPE_CHECKING:
    import xarray as xr

    from tmca.cameras import SpectralCamera
    from tmca.sensor import Sensor

_CAMERA = Group("Camera", sort_key=1)
_SENSOR = Group("Sensor", sort_key=2)
_OUTPUT = Group("Output", sort_key=3)
_SCENE = Group("Reading the scene", sort_key=0)
_MOST_CODES = 2**33


@Parameter(name="*")
@dataclass(frozen=True)
class SceneOptions:
    """How a scene's file is read."""

    wavelengths: Annotated[str | None, Parameter(group=_SCENE)] = None
    "Of the file's bands where it does not say, in nm: FIRST:LAST:COUNT or one per band."
    variable: Annotated[str | None, Parameter(group=_SCENE)] = None
    "Which one, where the file holds several."
    scale: Annotated[float | None, Parameter(group=_SCENE)] = None
    "Stored value that is relative irradiance 1; an integer type's maximum, or that of floats above 1, without it."
    negative: Annotated[Literal["error", "clip", "keep"], Parameter(group=_SCENE)] = "error"
    "What is done with negative pixels: refused, set to 0, or kept."

    def reading(self) -> dict[str, Any]:
        """Arguments of ``load_scene``."""
        from tmca.cli.wavelengths import metres

        given = None if self.wavelengths is None else metres(self.wavelengths)
        return {"wavelengths": given, "variable": self.variable, "scale": self.scale, "negative": self.negative}


@Parameter(name="*")
@dataclass(frozen=True)
class SpectralOptions:
    """The spectral camera."""

    preset: Annotated[str | None, Parameter(group=_CAMERA)] = None
    "Start from a named camera: thesis, cassi, one-hot. Other options replace its values."
    slots: Annotated[int | None, Parameter(group=_CAMERA, converter=whole)] = None
    "Time slots K within the exposure; those of the patterns where a file is given. [default: 8]"
    aperture: Annotated[str | None, Parameter(group=_CAMERA)] = None
    "Aperture codes: random, static, open, complementary, blue-noise, or a file of patterns. [default: random]"
    shutter: Annotated[str | None, Parameter(group=_CAMERA)] = None
    "Shutter codes: random, open, one-hot, complementary, blue-noise, or a file of patterns. [default: random]"
    exposure: Annotated[str | None, Parameter(group=_CAMERA)] = None
    "equal: the slots share one exposure time; per-slot: each has its own. [default: equal]"
    dispersion: Annotated[str | None, Parameter(group=_CAMERA)] = None
    "Pixels per band, or the displacement of every band separated by commas. [default: 1]"
    disperser: Annotated[str | None, Parameter(group=_CAMERA)] = None
    "single or dual. [default: single]"
    relay_blur: Annotated[float | None, Parameter(group=_CAMERA)] = None
    "Blur of the relay optics, standard deviation in pixels. [default: 0]"
    transmittance: Annotated[float | None, Parameter(group=_CAMERA)] = None
    "Share of open aperture pixels. [default: 0.5]"
    duty: Annotated[float | None, Parameter(group=_CAMERA)] = None
    "Share of open shutter pixels. [default: 0.5]"
    coloured: Annotated[Path | None, Parameter(group=_CAMERA)] = None
    "File of a static coloured aperture, bands × rows × columns, in the place of the codes."
    period: Annotated[int | None, Parameter(group=_CAMERA, converter=whole)] = None
    "Tile of the codes in pixels; full frame without it."
    weights: Annotated[str | None, Parameter(group=_CAMERA)] = None
    "Learned codes: a file or run of `tmca train`, or default, which comes with tmca (static for --slots 1, or K = 8)."
    codes: Annotated[Path | None, Parameter(group=_CAMERA)] = None
    "Both planes from a file of `tmca design` (codes.nc), with their period."
    seed: Annotated[int, Parameter(group=_CAMERA, converter=whole)] = 0
    "Of the codes and the noise."

    def chosen(self) -> dict[str, Any]:
        """Camera arguments that were given, files read and numbers parsed."""
        if not 0 <= self.seed < 2**30:
            raise SettingError("--seed", str(self.seed), "0 or more, below 2^30")
        for name in ("transmittance", "duty"):
            share = getattr(self, name)
            if share is not None and not 0 <= share <= 1:
                raise SettingError(f"--{name}", f"{share:g}", "a share between 0 and 1")
        given = {
            name: value
            for name, value in vars(self).items()
            if value is not None and name not in ("preset", "weights", "codes")
        }
        if self.codes is not None:
            given |= self._designed(given)
        for plane in ("aperture", "shutter"):
            if isinstance(given.get(plane), str):
                given[plane] = codes_argument(given[plane], f"--{plane}")
        patterns = [value for value in given.values() if hasattr(value, "shape") and value.ndim == 3]
        if patterns and "slots" not in given:
            given["slots"] = len(patterns[0])
        if "coloured" in given:
            given["coloured"] = coloured_argument(given["coloured"])
        if "dispersion" in given:
            given["dispersion"] = numbers(given["dispersion"], "--dispersion")
        return given

    def _designed(self, given: dict[str, Any]) -> dict[str, Any]:
        """Camera arguments of a file of codes, which nothing else may set."""
        from tmca.codes import read_codes

        found = read_codes(self.codes or "").settings()
        beside: list[str] = [name for name in ("aperture", "shutter", "period", "coloured") if name in given]
        beside += ["preset"] if self.preset else ["weights"] if self.weights else []
        if beside:
            raise SettingError("--codes", f"--{beside[0]} beside it", "one of them")
        if given.get("slots", found["slots"]) != found["slots"]:
            raise SettingError("--slots", str(given["slots"]), f"{found['slots']}, as the codes have", "leave it out")
        return found


@Parameter(name="*")
@dataclass(frozen=True)
class SensorOptions:
    """The sensor."""

    read_noise: Annotated[float, Parameter(group=_SENSOR)] = 0.0
    "Standard deviation in snapshot units (1 = one band of a white scene)."
    full_well: Annotated[float | None, Parameter(group=_SENSOR)] = None
    "Electrons at full scale; switches shot noise on."
    read_noise_electrons: Annotated[float, Parameter(group=_SENSOR)] = 0.0
    "Read noise in electrons, standard deviation; needs --full-well."
    bits: Annotated[int | None, Parameter(group=_SENSOR, converter=whole)] = None
    "Bits of the analogue-to-digital converter."


@Parameter(name="*")
@dataclass(frozen=True)
class OutputOptions:
    """Where results go."""

    out: Annotated[Path | None, Parameter(group=_OUTPUT)] = None
    "File to write; a name made from the input's, in the current folder, without it."
    overwrite: Annotated[bool, Parameter(group=_OUTPUT, negative="")] = False
    "Replace files that exist."
    figures: Annotated[bool, Parameter(group=_OUTPUT)] = True
    "Write pictures beside the file."
    json: Annotated[bool, Parameter(group=_OUTPUT, negative="")] = False
    "Print JSON instead of text."


def spectral_camera(scene: xr.DataArray, camera: SpectralOptions, sensor: SensorOptions) -> SpectralCamera:
    """The camera that the options describe, for a scene of this size and these bands."""
    from tmca.cameras import SpectralCamera
    from tmca.sensor import Sensor

    if camera.weights:
        return _learned_camera(scene, camera, Sensor(**vars(sensor)))
    settings = {
        **camera.chosen(),
        "bands": scene["wavelength"].values.tolist(),
        "size": scene.shape[1:],
        "sensor": Sensor(**vars(sensor)),
    }
    check_memory(camera.slots or 1, scene.shape[1:])
    for plane in ("aperture", "shutter"):
        if plane in settings:
            settings[plane] = fitted(settings[plane], scene.shape[1:], settings, plane)
    if camera.period and camera.period > min(scene.shape[1:]):
        print(f"tmca: --period {camera.period} is larger than the scene: the codes do not repeat", file=sys.stderr)
    made = SpectralCamera.from_preset(camera.preset, **settings) if camera.preset else SpectralCamera(**settings)
    if made.throughput() == 0:
        raise SettingError("codes", "none that let light through", "some open pixels in aperture and shutter together")
    return made


def check_memory(slots: int, size: tuple[int, ...]) -> None:
    """Refuse codes that no machine holds."""
    needed = 8.0 * slots * size[0] * size[1]
    if needed > _MOST_CODES:
        found = f"{slots}: codes of {needed / 2**30:.0f} GiB at {size[0]}×{size[1]} pixels"
        raise SettingError("--slots", found, f"at most {_MOST_CODES / 2**30:.0f} GiB")


def assumed(cube: xr.DataArray) -> None:
    """Say on standard error what was taken for granted about a file."""
    origin, file = str(cube.attrs.get("wavelengths_from", "")), cube.attrs.get("source")
    if origin.startswith("known set"):
        print(f"tmca: {file}: no wavelengths in it, taken from the {origin} (--wavelengths)", file=sys.stderr)
    if cube.attrs.get("scale_from") == "maximum":
        print(f"tmca: {file}: divided by its maximum, {cube.attrs['scale']:g} (--scale)", file=sys.stderr)


def _learned_camera(scene: xr.DataArray, camera: SpectralOptions, sensor: Sensor) -> SpectralCamera:
    """The camera of some weights, at the size of a scene that has their bands."""
    from tmca.decoders import find_weights
    from tmca.decoders.neural import same_bands

    others = sorted(set(camera.chosen()) - {"slots", "seed"} | ({"preset"} if camera.preset else set()))
    if others:
        raise SettingError("--weights", f"--{others[0].replace('_', '-')} beside it", "learned codes, or chosen ones")
    weights = find_weights(camera.weights or "", camera.slots or 8)
    if camera.slots not in (None, len(weights.aperture)):
        raise SettingError(
            "--slots", f"{camera.slots}", f"{len(weights.aperture)}, as these weights have", "leave it out"
        )
    own = scene["wavelength"].values.tolist()
    if not same_bands(weights.wavelengths, own):
        bands = f"{len(weights.wavelengths)} bands, {weights.wavelengths[0] * 1e9:.4g} nm and on"
        raise SettingError("--weights", bands, f"the scene's {len(own)}, {own[0] * 1e9:.4g} nm and on")
    return weights.spectral_camera((scene.shape[1], scene.shape[2]), sensor=sensor)


def check_figure(figure: Path | None, overwrite: bool, source: str | Path = "") -> None:
    """Refuse a picture that could not be written, before the work is done."""
    if figure is not None:
        from tmca.experiments.figures import check_picture

        check_picture(figure)
        check_targets([figure], overwrite, source)


def check_targets(files: Iterable[Path], overwrite: bool, source: str | Path = "") -> None:
    """Refuse outputs that exist, have no folder, or are the input, before the work is done."""
    from tmca.data import check_target

    for file in files:
        if source and file.resolve() == Path(source).resolve():
            raise SettingError("--out", f"{file}, which is the input", "another file")
        check_target(file, overwrite)


def cluster_parameters(text: str | None) -> dict[str, Any] | None:
    """``NAME=VALUE,…`` for submitit; None without."""
    if text is None:
        return None
    import yaml

    parts = [part.partition("=") for part in text.split(",") if part]
    if not parts or not all(sign for _, sign, _ in parts):
        raise SettingError("--slurm", repr(text), "NAME=VALUE,…, such as timeout_min=60,slurm_partition=gpu")
    return {name: yaml.safe_load(value) for name, _, value in parts}


def pair(text: str | None, option: str) -> tuple[float, float]:
    """``ROWS,COLUMNS``; zeros if not given."""
    values = (0.0, 0.0) if text is None else numbers(text, option)
    if not isinstance(values, list | tuple) or len(values) != 2:
        raise SettingError(option, repr(text), "ROWS,COLUMNS in pixels, such as 0,2.5")
    return (values[0], values[1])


def numbers(text: str, option: str) -> float | list[float]:
    """One number, or several separated by commas."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        raise SettingError(option, repr(text), "a number, or numbers separated by commas") from None
    return values[0] if len(values) == 1 else values


def size(text: str | None, option: str = "--size") -> tuple[int, int] | None:
    """``HxW`` in pixels."""
    if text is None:
        return None
    try:
        height, width = (int(part) for part in text.lower().replace("×", "x").split("x"))
    except ValueError:
        raise SettingError(option, repr(text), "HEIGHTxWIDTH in pixels, such as 256x256") from None
    return height, width
