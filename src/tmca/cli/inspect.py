"""``tmca inspect``: what a file holds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from tmca.cli.cameras import READING
from tmca.cli.options.output import Figure, Json, Overwrite, check_figure, say
from tmca.errors import SettingError
from tmca.specs import CAMERA_SPECS, ViewsReading

_VIEWS = ViewsReading()


def inspect(
    file: Path,
    /,
    *,
    variable: str | None = None,
    conditioning: bool = False,
    figure: Figure = None,
    reading: Annotated[ViewsReading, READING] = _VIEWS,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Say what FILE holds: variables, size, wavelengths or views, range of values, and for a snapshot its camera.

    Args:
        file: a cube, light field (file or folder of views), scene with depth (folder, file, or folder and stem as in
            nyuv2/00050), capture, snapshot, prior, weights (.safetensors) or any array file.
        variable: which one, where the file holds several.
        conditioning: for a snapshot file, rank, condition number and coherence of a corner of its matrix.
    """
    from tmca.data import describe

    check_figure(figure, overwrite, file)
    if file.suffix == ".safetensors":
        _weights(file, json, {"variable": variable, "conditioning": conditioning or None, "figure": figure})
        return
    description = describe(file, variable, **reading.given())
    if "recording" in description["attrs"]:
        description |= _recording(file, description["attrs"])
    if conditioning:
        description["matrix"] = _conditioning(file)
    if description["kind"] == "light field":
        from tmca.applications.refocusing import disparity_seen

        seen = disparity_seen(file, description["light_field"], variable=variable, **reading.given())
        description["light_field"]["disparity_seen"] = None if seen is None else list(seen)
    if figure is not None:
        from tmca.applications.file_pictures import picture_of

        picture_of(file, figure, variable=variable, overwrite=overwrite, **reading.given())
        description["figure"] = str(figure)
    say(description, json, *_lines(description))


def _conditioning(file: Path) -> dict[str, Any]:
    """Of a snapshot: of a corner of its matrix."""
    from tmca.cameras import Snapshot
    from tmca.design.measures import corner_conditioning

    return corner_conditioning(Snapshot.load(file).camera)


def _weights(file: Path, json: bool, asked: dict[str, Any]) -> None:
    """Say what a file of weights holds.

    Raises:
        SettingError: an option that is for other files.
    """
    from tmca.decoders.nets.described import describe_weights, weights_lines

    for name, value in asked.items():
        if value is not None:
            raise SettingError(name, f"one for {file}, which holds weights", "none", "leave it out")
    about = describe_weights(file)
    say(about, json, *weights_lines(about))


def _lines(description: dict[str, Any]) -> list[str]:
    """The description for people: one line a subject."""
    kind = _kind(description)
    lines = [f"{description['path']}: {kind or description['kind']} ({description['format']})"]
    lines += [_variable(name, variable) for name, variable in description.get("variables", {}).items()]
    if waves := description.get("wavelengths"):
        spread = f"{waves['first_nm']:.6g} to {waves['last_nm']:.6g} nm"
        lines.append(f"  wavelengths: {waves['count']} bands, {spread} (from: {waves['from']})")
    if description.get("light_field"):
        lines += _light_field(description["light_field"])
    if description.get("depth"):
        lines.append(_depth(description["depth"]))
    if "frames" in description:
        lines.append(f'  frames: {description["frames"]} (xarray.open_zarr(…, group="frames"), tmca view)')
    if "matrix" in description:
        lines.append(_matrix(description["matrix"]))
    for key in ("scale", "note", "figure"):
        if description.get(key) is not None and not (key == "note" and kind):
            lines.append(f"  {key}: {description[key]}")
    return lines + [f"  {key}: {value}" for key, value in description.get("attrs", {}).items()]


def _kind(description: dict[str, Any]) -> str:
    """What a file that tmca wrote is; empty of others."""
    from tmca.data.describe import is_prior

    attributes, variables = description.get("attrs", {}), description.get("variables", {})
    camera, kind = str(attributes.get("camera", "")), str(attributes.get("kind", ""))
    named = camera not in ("", *CAMERA_SPECS)
    if "snapshot" in variables and (named or "shutter" in variables):
        return f"snapshot of a {camera} camera" if named else "snapshot"
    return f"{kind} prior of scene blocks".strip() if is_prior(description) else kind


def _variable(name: str, variable: dict[str, Any]) -> str:
    """Size, type, values and unit of a variable."""
    size = " × ".join(map(str, variable["shape"])) or "one value"
    dims = f" ({', '.join(variable['dims'])})" if variable.get("dims") else ""
    units = f", {variable['attrs']['units']}" if variable.get("attrs", {}).get("units") else ""
    return f"  {name}: {size}{dims} {variable['dtype']}{_levels(variable)}{units}"


def _matrix(corner: dict[str, Any]) -> str:
    """What the corner of a snapshot's matrix is like."""
    return (
        f"  matrix of the first {corner['rows']} × {corner['columns']} scene pixels: {corner['shape'][0]} × "
        f"{corner['shape'][1]}, rank {corner['rank']}, condition number {corner['condition']:.4g}, coherence "
        f"{corner['coherence']:.4g}, unseen entries {corner['dark_columns']}"
    )


def _light_field(about: dict[str, Any]) -> list[str]:
    """Views, what tells them apart, the disparity that they show, and the true one."""
    (rows, columns), (height, width) = about["views"], about["size"]
    kind = "colour" if about["colour"] else "grey"
    lines = [f"  views: {rows} × {columns} of {height} × {width} pixels, {kind} (from: {about['pattern']})"]
    shifts, seen = about["shifts"], about.get("disparity_seen")
    agree = f"; rows and columns agree to {shifts['agreement']:.2f}" if shifts else ""
    if seen:
        spread = f"{seen[0]:.2f} to {seen[1]:.2f} px per view step (5 to 95 %), nearer is positive"
        lines.append(f"  disparity of the views: {spread}{agree}")
    truth = about["disparity"]
    if truth is None:
        return [*lines, "  true disparity: none"]
    spread = truth.get("note") or f"{truth['min']:.3g} to {truth['max']:.3g} px per view"
    return [*lines, f"  true disparity: {spread} ({truth['source']})"]


def _depth(about: dict[str, Any]) -> str:
    """Range in metres, if they are known, and what is not known."""
    if "note" in about:
        return f"  depth: {about['note']}"
    unknown, kinds = about["unknown_pixels"], ("zero", "negative", "not_finite")
    why = ", ".join(f"{about[f'unknown_{k}']} {k.replace('_', ' ')}" for k in kinds if about.get(f"unknown_{k}"))
    spread = "known only up to an affine map of inverse depth"
    if about["metric"]:
        spread = f"{about['near']:.4g} to {about['far']:.4g} m, median {about['median']:.4g} m"
    share = f" ({unknown / about['pixels']:.1%}: {why})" if unknown else ""
    mapped = f"; metres are those of the mapped scene: {about['mapped']}" if "mapped" in about else ""
    return f"  depth: {spread}; {unknown} of {about['pixels']} pixels unknown{share}{mapped}"


def _recording(file: Path, attributes: dict[str, Any]) -> dict[str, Any]:
    """What there is more to say of what `tmca live` recorded; nothing of other files."""
    from tmca.lab.live import frames_recorded, is_recording

    return {"kind": "recording", "frames": frames_recorded(file), "note": None} if is_recording(attributes) else {}


def _levels(variable: dict[str, Any]) -> str:
    if variable.get("min") is None:
        return ""
    text = f", {variable['min']:.4g} to {variable['max']:.4g}, mean {variable['mean']:.4g}"
    for key, word in (("zero_share", "zero"), ("saturated_share", "at the top"), ("not_finite", "not finite")):
        if variable.get(key):
            share = variable[key]
            text += f", {share} {word}" if key == "not_finite" else f", {share:.2%} {word}"
    return text
