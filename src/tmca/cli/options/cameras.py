"""Options that describe a camera, and the cameras that they describe."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter

from tmca.cli.options.numbers import numbers, whole
from tmca.cli.options.patterns import codes_argument, coloured_argument, fitted
from tmca.cli.options.sensor import SensorOptions
from tmca.errors import SettingError, TmcaError

if TYPE_CHECKING:
    import xarray as xr

    from tmca.cameras import LightFieldCamera, SpectralCamera
    from tmca.cli.options.light_field_bench import LightFieldBenchOptions
    from tmca.decoders import Weights
    from tmca.sensor import Sensor

_CAMERA = Group("Camera", sort_key=1)
_MOST_CODES = 2**33
_FROM_FILES = {
    "aperture": ("aperture", "codes"),
    "shutter": ("shutter", "codes"),
    "codes": ("codes", "aperture", "shutter"),
    "vignetting": ("vignetting",),
    "coloured": ("coloured",),
}
"""What an error is about → the options whose file may have brought it."""


@Parameter(name="*")
@dataclass(frozen=True)
class CodeOptions:
    """Codes of a camera, and the exposure."""

    slots: Annotated[int | None, Parameter(group=_CAMERA, converter=whole)] = None
    "Time slots K within the exposure; those of the patterns where a file is given. [default: 8]"
    aperture: Annotated[str | None, Parameter(group=_CAMERA)] = None
    "Aperture codes: random, static, open, complementary, blue-noise, or a file of patterns. [default: random]"
    shutter: Annotated[str | None, Parameter(group=_CAMERA)] = None
    "Shutter codes: random, open, one-hot, complementary, blue-noise, or a file of patterns. [default: random]"
    exposure: Annotated[str | None, Parameter(group=_CAMERA)] = None
    "equal: the slots share one exposure time; per-slot: each has its own. [default: equal]"
    transmittance: Annotated[float | None, Parameter(group=_CAMERA)] = None
    "Share of open aperture pixels. [default: 0.5]"
    duty: Annotated[float | None, Parameter(group=_CAMERA)] = None
    "Share of open shutter pixels. [default: 0.5]"
    period: Annotated[int | None, Parameter(group=_CAMERA, converter=whole)] = None
    "Tile of the codes in pixels; full frame without it."
    codes: Annotated[Path | None, Parameter(group=_CAMERA)] = None
    "Both planes from a file of `tmca design` (codes.nc), with their period."
    seed: Annotated[int, Parameter(group=_CAMERA, converter=whole)] = 0
    "Of the codes and the noise."
    weights: Annotated[str | None, Parameter(group=_CAMERA)] = None
    "Learned codes: a file or run of `tmca train`."
    preset: Annotated[str | None, Parameter(group=_CAMERA)] = None
    """Start from a named camera: thesis, one-hot, and of the spectral camera cassi (static), of the light field clfp
    (static) and quick. Other options replace its values."""

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
        return given

    def files(self) -> list[Path]:
        """Files that the codes come from; weights that come with tmca are none, they may be of any camera."""
        named = [getattr(self, name, None) for name in ("aperture", "shutter", "codes", "coloured", "weights")]
        given = [Path(name) for name in named if name is not None]
        return [path for path in given if path.suffix or path.is_dir()]

    def alone(self) -> None:
        """Raises SettingError if chosen codes stand beside learned ones."""
        others = sorted(set(self.chosen()) - {"slots", "seed"} | ({"preset"} if self.preset else set()))
        if others:
            found = f"--{others[0].replace('_', '-')} beside it"
            raise SettingError("--weights", found, "learned codes, or chosen ones")

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
class SpectralOptions(CodeOptions):
    """The spectral camera."""

    dispersion: Annotated[str | None, Parameter(group=_CAMERA)] = None
    "Pixels per band, or the displacement of every band separated by commas. [default: 1]"
    disperser: Annotated[str | None, Parameter(group=_CAMERA)] = None
    "single or dual. [default: single]"
    relay_blur: Annotated[float | None, Parameter(group=_CAMERA)] = None
    "Blur of the relay optics, standard deviation in pixels. [default: 0]"
    coloured: Annotated[Path | None, Parameter(group=_CAMERA)] = None
    "File of a static coloured aperture, bands × rows × columns, in the place of the codes."
    weights: Annotated[str | None, Parameter(group=_CAMERA)] = None
    "Learned codes: a file or run of `tmca train`, or default, which comes with tmca (static for --slots 1, or K = 8)."

    def chosen(self) -> dict[str, Any]:
        """Camera arguments that were given, files read and numbers parsed."""
        given = super().chosen()
        if "coloured" in given:
            given["coloured"] = coloured_argument(given["coloured"])
        if "dispersion" in given:
            given["dispersion"] = numbers(given["dispersion"], "--dispersion")
        return given


@Parameter(name="*")
@dataclass(frozen=True)
class LightFieldOptions(CodeOptions):
    """The light-field camera."""

    shear: Annotated[str | None, Parameter(group=_CAMERA)] = None
    "Mask pixels per view, one number or ALONG_Y,ALONG_X. [default: 1]"
    mask_scale: Annotated[float | None, Parameter(group=_CAMERA)] = None
    "Mask pixels per sensor pixel as the sensor sees them; 1 for a mask of pitch (1-s)·p. [default: 1]"
    vignetting: Annotated[Path | None, Parameter(group=_CAMERA)] = None
    "File with the share of light of every view, rows × columns."

    def chosen(self) -> dict[str, Any]:
        """Camera arguments that were given, files read and numbers parsed."""
        given = super().chosen()
        if "shear" in given:
            given["shear"] = shear_argument(given["shear"])
        if "vignetting" in given:
            from tmca.data import read_array

            given["vignetting"] = read_array(given["vignetting"]).copy()
        return given


def shear_argument(text: str) -> tuple[float, float]:
    """Mask pixels per view along y and x, from one number or two."""
    values = numbers(text, "--shear")
    found = [values, values] if isinstance(values, float) else values
    if len(found) != 2:
        raise SettingError("--shear", repr(text), "one number, or two separated by a comma")
    return (found[0], found[1])


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
    warn_of_period(camera, scene.shape[1:])
    make = partial(SpectralCamera.from_preset, camera.preset) if camera.preset else SpectralCamera
    with naming_files(camera):
        return lit(make(**settings))


def light_field_camera(
    scene: xr.DataArray, camera: LightFieldOptions, bench: LightFieldBenchOptions, sensor: SensorOptions
) -> LightFieldCamera:
    """The camera that the options describe, for a light field of this size and these views."""
    from tmca.cameras import LightFieldCamera
    from tmca.sensor import Sensor

    views, size = (scene.sizes["view_v"], scene.sizes["view_u"]), (scene.sizes["y"], scene.sizes["x"])
    if camera.weights:
        camera.alone()
        if bench.given():
            raise SettingError("--weights", "beside a bench", "one of them", "weights have the shear they learned with")
        from tmca.decoders import Weights

        weights = _of_slots(Weights.load(camera.weights), camera)
        weights.check_kind("light-field")
        made: LightFieldCamera = weights.camera_for(size, sensor=Sensor(**vars(sensor)))
        return made
    own = bench.chosen(views, camera.chosen())
    settings = {**own, "views": views, "size": size, "sensor": Sensor(**vars(sensor))}
    check_memory(camera.slots or 1, size)
    warn_of_period(camera, size)
    make = partial(LightFieldCamera.from_preset, camera.preset) if camera.preset else LightFieldCamera
    with naming_files(camera):
        return lit(make(**settings))


@contextmanager
def naming_files(camera: CodeOptions) -> Iterator[None]:
    """Errors about what stands in a file of the options name option and file."""
    try:
        yield
    except TmcaError as error:
        given = {name: Path(getattr(camera, name, None) or "") for name in _FROM_FILES.get(error.where, ())}
        named = [f"--{name} {file}" for name, file in given.items() if file.suffix]  # families of codes have none
        if not named:
            raise
        raise type(error)(named[0], error.found, error.expected, error.remedy) from error


def lit(camera: Any) -> Any:
    """The camera, unless no light gets through its codes."""
    if camera.throughput() == 0:
        raise SettingError(
            "--aperture", "none that let light through", "some open pixels in aperture and shutter together"
        )
    return camera


def warn_of_period(camera: CodeOptions, size: tuple[int, ...]) -> None:
    """Say on standard error that a tile does not fit the scene."""
    if camera.period and camera.period > min(size):
        print(f"tmca: --period {camera.period} is larger than the scene: the codes do not repeat", file=sys.stderr)


def check_memory(slots: int, size: tuple[int, ...]) -> None:
    """Refuse codes that no machine holds."""
    needed = 8.0 * slots * size[0] * size[1]
    if needed > _MOST_CODES:
        found = f"{slots}: codes of {needed / 2**30:.0f} GiB at {size[0]}×{size[1]} pixels"
        raise SettingError("--slots", found, f"at most {_MOST_CODES / 2**30:.0f} GiB")


def _learned_camera(scene: xr.DataArray, camera: SpectralOptions, sensor: Sensor) -> SpectralCamera:
    """The camera of some weights, at the size of a scene that has their bands."""
    from tmca.decoders import Weights
    from tmca.decoders.nets.weights import same_bands

    camera.alone()
    weights = _of_slots(Weights.find(camera.weights or "", camera.slots or 8), camera)
    weights.check_kind("spectral")
    own = scene["wavelength"].values.tolist()
    if not same_bands(weights.wavelengths, own):
        bands = f"{len(weights.wavelengths)} bands, {weights.wavelengths[0] * 1e9:.4g} nm and on"
        raise SettingError("--weights", bands, f"the scene's {len(own)}, {own[0] * 1e9:.4g} nm and on")
    made: SpectralCamera = weights.camera_for((scene.shape[1], scene.shape[2]), sensor=sensor)
    return made


def _of_slots(weights: Weights, camera: CodeOptions) -> Weights:
    """The weights, unless other slots were asked for."""
    if camera.slots not in (None, weights.slots):
        raise SettingError("--slots", f"{camera.slots}", f"{weights.slots}, as these weights have", "leave it out")
    return weights
