"""``tmca export``: codes as files that devices show."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Group, Parameter

from tmca.cli.options.numbers import On, size
from tmca.cli.options.output import Json, Overwrite, say, warned
from tmca.errors import SettingError

app = App(name="export", help="Codes as files that devices show, with a manifest.")
_DEVICE = Group("Device", sort_key=1)


@app.default
def export(
    source: Path,
    /,
    *,
    device: list[str],
    out: Path = Path("export"),
    exposure: float | None = None,
    code_size: Annotated[str | None, Parameter(group=_DEVICE)] = None,
    sensor_size: Annotated[str | None, Parameter(group=_DEVICE)] = None,
    macro_pixel: Annotated[float | None, Parameter(group=_DEVICE)] = None,
    mounting_angle: Annotated[float | None, Parameter(group=_DEVICE)] = None,
    offset: Annotated[str | None, Parameter(group=_DEVICE)] = None,
    lut: Annotated[Path | None, Parameter(group=_DEVICE)] = None,
    calibration: Annotated[Path | None, Parameter(group=_DEVICE)] = None,
    figures: On = True,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Write what devices show of SOURCE: a file of `tmca design`, a run or weights of `tmca train`, or a snapshot.

    OUT holds PNG frames or a CSV of Zernike terms for every device, manifest.json (order, times, trigger, units,
    checksums) and overview.png. `tmca export check OUT` reads it back.

    Args:
        source: codes.nc, the folder of a run, weights, a snapshot file, or codes that come with tmca: default
            (spectral, K = 8), default-light-field, default-spectral-depth.
        device: dli4120, pluto-2.1, dmp40, coded-exposure, coded-exposure-two-bucket,
            coded-exposure-two-bucket-tile, emulated-shutter, or a YAML file
            (docs/devices.md); one for each plane of the codes that is shown.
        out: folder.
        exposure: of all slots together, seconds; that of `tmca design --exposure` without, else 0.1.
        code_size: HEIGHTxWIDTH of the aperture's code; its own, or as many pixels of a tile as the device shows. A
            snapshot whose codes have a period is exported over a larger one too, its shutter with it.
        sensor_size: HEIGHTxWIDTH of the shutter, likewise.
        macro_pixel: device pixels along the side of a code pixel of the aperture, instead of the description's.
        mounting_angle: of the aperture's device, degrees: 45 for mirrors that tilt about their diagonal.
        offset: ROWSxCOLUMNS by which the aperture is displaced from the device's middle: device pixels, of a diamond
            lattice two rows and a pixel of a row.
        lut: CSV of grey level and light, or phase_rad, of the aperture's device.
        calibration: of `tmca calibrate registration`, whose patterns had the aperture device's own pixels: codes are
            placed so that they fall on the sensor pixels that the camera of SOURCE, a snapshot, was drawn with.
        figures: write overview.png.
    """
    from tmca.lab.bench import aperture_changed
    from tmca.lab.display.codes import read_planes
    from tmca.lab.display.export import export_codes

    changes: dict[str, Any] = {"macro_pixel": macro_pixel, "mounting_angle_deg": mounting_angle}
    changes |= {"lut": None if lut is None else str(lut.absolute())}
    moved = size(offset, "--offset") or (0, 0)
    devices = [aperture_changed(name, changes) for name in device]
    affine, falls = None, ""
    if calibration is not None:
        _refuse_beside_a_calibration(macro_pixel=macro_pixel, mounting_angle=mounting_angle, offset=offset)
        affine, falls = _registered(source, calibration, devices)
    of_code = size(code_size, "--code-size")
    planes = read_planes(source, of_code)
    manifest = export_codes(
        planes, devices, out, exposure=exposure, affine=affine,
        code_size=of_code, sensor_size=size(sensor_size, "--sensor-size"), offset=moved,
        overwrite=overwrite,
    ).manifest  # fmt: skip
    if figures:
        _draw(manifest, out)
    if planes.settings is not None:  # codes alone that fill little are warned of as they are exported
        _warn_of_little(manifest, source)
    _say(manifest, out, json, "" if exposure else _exposure_of(planes.exposure), falls)


def _draw(manifest: dict[str, Any], folder: Path) -> None:
    """Draw the overview of an export."""
    from tmca.lab.display.export import export_figure
    from tmca.plots.style import save_figure

    save_figure(export_figure(manifest, folder), folder / "overview.png", overwrite=True)


def _warn_of_little(manifest: dict[str, Any], source: Path) -> None:
    """Say of each device that shows codes on less than a tenth of its pixels how they fill more."""
    from tmca.lab.display.export import LITTLE
    from tmca.lab.display.placement import Placement

    for plane in manifest["planes"]:
        if not plane["device"].get("size") or (place := Placement(**plane["placement"])).share >= LITTLE:
            continue
        option = {"aperture": "--code-size"}.get(plane["plane"], "--sensor-size")
        more = f"codes that repeat fill more with a larger {option}"
        if plane["plane"] == "aperture" and place.affine is None:
            more = f"a larger --macro-pixel fills more, or of codes that repeat a larger {option}"
        rows, columns = place.code
        name = plane["device"]["name"]
        warned(f"warning: {source}: {rows}×{columns} code pixels fill {100 * place.share:.3g}% of {name}: {more}")


def _exposure_of(designed: float | None) -> str:
    """Where an exposure comes from that was not asked for."""
    return " (the default of --exposure)" if designed is None else " (those of the design)"


def _refuse_beside_a_calibration(**options: Any) -> None:
    for name, value in options.items():
        if value is not None:
            expected = "one of them: a registration says where codes lie"
            raise SettingError(f"--{name.replace('_', '-')}", f"{value} beside --calibration", expected)


def _registered(source: Path, calibration: Path, devices: list[Any]) -> tuple[Any, str]:
    """Where codes lie on the aperture's device by a registration, and how large its pixels are on the sensor."""
    from tmca.lab.calibration.apply import registered_affine
    from tmca.lab.calibration.file import load_calibration

    showing = [device for device in devices if device.plane == "aperture"]
    if not showing:
        raise SettingError("--calibration", "no device of the aperture", "one whose pixels were registered")
    measured = load_calibration(calibration)
    affine = registered_affine(source, measured, showing[0])
    side = measured.part("registration").scale
    return affine, f"1 pixel of {showing[0].name} falls on {side:.3g}×{side:.3g} sensor pixels"


@app.command
def check(folder: Path, /, *, json: Json = False) -> None:
    """Read the export in FOLDER back: every file there, unchanged and in order, and the very codes in them.

    Args:
        folder: of the export.
    """
    from tmca.lab.display.manifest import check_export, read_export

    read_export(folder)
    _say(check_export(folder), folder, json)


def _say(manifest: dict[str, Any], folder: Path, as_json: bool, why: str = "", falls: str = "") -> None:
    each = manifest["exposure_s"] / manifest["slots"]
    head = f"{folder}: K = {manifest['slots']} slots of {each * 1e3:g} ms{why}, from {manifest['source']}"
    lines = [f"  {plane['plane']}: {_words(plane)}" for plane in manifest["planes"]]
    say(manifest, as_json, head, *lines, *([f"  {falls}"] if falls else []))


def _words(plane: dict[str, Any]) -> str:
    from tmca.lab.display.export import scale_of
    from tmca.lab.display.placement import Placement

    device = plane["device"]
    if "residual_rms_nm" in plane:
        worst = max(plane["residual_rms_nm"])
        span = max(plane["peak_to_valley_um"])
        terms = f"{len(device['noll'])} Zernike terms for {device['name']}, up to {span:.3g} µm from peak to valley"
        return f"{terms}, which leave up to {worst:.3g} nm rms"
    place = plane["placement"]
    rows, columns = place["code"]
    on = f"{place['device'][0]}×{place['device'][1]} pixels of {device['name']}"
    filled = f", {100 * Placement(**place).share:.3g}% of them" if device["size"] else ""
    return f"{len(plane['frames'])} frames of {rows}×{columns} code pixels on {on}{filled}; {scale_of(plane)}"


def named_export(folder: Path) -> dict[str, Any]:
    """The manifest of an export.

    Raises:
        SettingError: a file in its place.
    """
    from tmca.lab.display.manifest import check_export

    if folder.is_file():
        raise SettingError("EXPORT", f"the file {folder}", "the folder of an export", "make one with `tmca export`")
    return check_export(folder)
