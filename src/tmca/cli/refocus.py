"""``tmca refocus``: photographs from a light field, focused after the exposure."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from tmca.cli.cameras import READING
from tmca.cli.options.numbers import MaybeWhole, size
from tmca.cli.options.output import Json, Overwrite, say
from tmca.errors import SettingError
from tmca.specs import ViewsReading

if TYPE_CHECKING:
    import xarray as xr

_VIEWS, _MOST, _USUAL = ViewsReading(), 200, 5


def refocus(
    light_field: str,
    /,
    *,
    disparity: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    sweep: MaybeWhole = None,
    all_in_focus: bool = False,
    views: MaybeWhole = None,
    crop: str | None = None,
    reading: Annotated[ViewsReading, READING] = _VIEWS,
    out: Path | None = None,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Focus LIGHT_FIELD after the exposure: photographs of the disparities that are asked for.

    Without --disparity, --sweep or --all-in-focus it is a sweep of five. Disparity is in pixels per view step, positive
    for what is nearer than the plane in focus.

    Args:
        light_field: an estimate by `tmca reconstruct`, a light field (file or folder of views), or a rendered one such
            as coffee:1.
        disparity: of what shall be sharp, one or several, such as -1,0,1.
        sweep: so many photographs, evenly over the disparities that the views show (5 to 95 %).
        all_in_focus: one photograph with everything in focus. As .nc it holds the disparity and its confidence too.
        views: n for the centre n×n views, odd; all without it.
        crop: HEIGHTxWIDTH, the middle of the views.
        out: file to write: .png (one photograph, or several in a labelled strip), .gif (from far to near and back),
            .tif (a page for each, numbers as they are) or .nc. NAME_refocus.png, or NAME_sharp.png of --all-in-focus,
            in the current folder without it.
    """
    from tmca.applications.refocusing import light_field_of
    from tmca.data import check_target
    from tmca.plots.photographs import check_photographs

    steps = _asked(disparity, sweep, all_in_focus)
    stem = Path(light_field).name.replace(":", "_").removesuffix(".nc")
    target = out or Path(f"{stem}_{'sharp' if all_in_focus else 'refocus'}.png")
    check_photographs(target, 1 if all_in_focus else steps if isinstance(steps, int) else len(steps))
    check_target(target, overwrite)
    if Path(light_field).exists() and Path(light_field).resolve() == target.resolve():
        raise SettingError("--out", f"{target}, which is the input", "another file")
    field = light_field_of(light_field, views=views, crop=size(crop, "--crop"), **reading.given())
    made = _sharp(field) if all_in_focus else _stack(field, steps)
    _write(made, field, target, stem, overwrite)
    _tell(made, field, target, json)


def _asked(disparity: str | None, sweep: int | None, all_in_focus: bool) -> list[float] | int:
    """The disparities, or how many of a sweep.

    Raises:
        SettingError: two of the options together, or no numbers.
    """
    from math import isfinite

    given = {"--disparity": disparity is not None, "--sweep": sweep is not None, "--all-in-focus": all_in_focus}
    named = [name for name, there in given.items() if there]
    if len(named) > 1:
        raise SettingError(named[1], f"{named[0]} beside it", "one of them", "leave one of the two out")
    if disparity is None:
        count = _USUAL if sweep is None else sweep
        if not 2 <= count <= _MOST:
            raise SettingError("--sweep", str(count), f"2 to {_MOST} photographs")
        return count
    try:
        steps = [float(part) for part in disparity.split(",")]
    except ValueError:
        steps = []
    if not steps or len(steps) > _MOST or not all(map(isfinite, steps)):
        raise SettingError("--disparity", repr(disparity), f"up to {_MOST} numbers in px per view step, such as -1,0,1")
    return steps


def _stack(field: xr.DataArray, steps: list[float] | int) -> xr.Dataset:
    """``refocused`` (disparity, …)."""
    from tmca.applications.refocusing import refocus as refocused
    from tmca.plots.views import focus_steps

    wanted = focus_steps(field, count=steps) if isinstance(steps, int) else steps
    return refocused(field, wanted).to_dataset()


def _sharp(field: xr.DataArray) -> xr.Dataset:
    from tmca.applications.refocusing import all_in_focus

    return all_in_focus(field)


def _write(made: xr.Dataset, field: xr.DataArray, target: Path, stem: str, overwrite: bool) -> None:
    """Write what was made, by the suffix of the file."""
    from tmca.data import write_dataset
    from tmca.plots.photographs import write_photographs
    from tmca.plots.views import brightest

    if target.suffix.lower() == ".nc":
        write_dataset(made, target, overwrite=overwrite)
        return
    stack = made["refocused"] if "refocused" in made else made["all_in_focus"].expand_dims("photograph")
    write_photographs(stack, target, brightest(field.values), title=f"{stem}, refocused", overwrite=overwrite)


def _tell(made: xr.Dataset, field: xr.DataArray, target: Path, json: bool) -> None:
    from tmca.metrics import disparity_range

    report: dict[str, Any] = {"file": str(target)}
    if "all_in_focus" in made:
        seen = disparity_range(field.values)  # as `tmca inspect` tells it, and --sweep takes it
        report["disparity"] = None if seen is None else [round(end, 3) for end in seen]
        said = "" if seen is None else f"; disparity {seen[0]:.2f} to {seen[1]:.2f} px per view step (5 to 95 %)"
        line = f"all in focus{said}"
    else:
        steps = [round(float(step), 4) for step in made["disparity"].values]
        report["disparity"] = steps
        line = f"focused at {', '.join(f'{step:g}' for step in steps)} px per view step"
    say(report, json, f"{target}: {line}")
