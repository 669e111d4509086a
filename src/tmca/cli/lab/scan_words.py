"""What ``tmca scan`` takes as words and says in words."""

from __future__ import annotations

import json as json_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from tmca.cli.options.numbers import numbers, size
from tmca.cli.options.output import warned
from tmca.errors import SettingError

if TYPE_CHECKING:
    import xarray as xr

    from tmca.lab.ground_truth.fringes import FringePlan
    from tmca.lab.ground_truth.spectra import Comparison

_FAR = 10.0
"""Times by which a reference may be larger or smaller than the spectrum before it is told of."""


def fringe_plan(projector: str, fringes: str, steps: int, across: Literal["x", "y"]) -> FringePlan:
    """A plan from ``HEIGHTxWIDTH`` and ``1,4,16,64``."""
    from tmca.lab.ground_truth.fringes import FringePlan

    counts = numbers(fringes, "--fringes")
    each = counts if isinstance(counts, list) else [counts]
    if any(not float(count).is_integer() for count in each):
        raise SettingError("--fringes", fringes, "whole numbers separated by commas")
    extent = size(projector, "--projector") or (800, 1280)
    return FringePlan(extent, tuple(int(count) for count in each), steps, across)


def places(points: list[str]) -> dict[str, tuple[int, int]]:
    """``NAME=ROW,COLUMN`` of each point."""
    by_name = {}
    for point in points:
        name, _, place = point.rpartition("=")
        try:
            row, column = (int(part) for part in place.split(","))
        except ValueError:
            raise SettingError("--points", repr(point), "NAME=ROW,COLUMN, such as P1=28,38") from None
        if name in by_name:
            raise SettingError("--points", f"{name} twice", "each once", "name its references apart")
        by_name[name] = (row, column)
    return by_name


def said_depth(measured: xr.Dataset, out: Path, json: bool, error: dict[str, float] | None = None) -> None:
    """How many pixels have a depth, from where to where, how certain, and why the others have none."""
    import numpy as np

    depth, why = measured["depth"].values, measured["confidence"].values
    names = [part.split(" ", 1)[1] for part in str(measured["confidence"].attrs["reasons"]).split(", ")]
    counts = {name: int((why == i).sum()) for i, name in enumerate(names)}
    spread = float(np.nanmedian(measured["depth_std"].values))
    about: dict[str, Any] = {"out": str(out), "near": float(np.nanmin(depth)), "far": float(np.nanmax(depth))}
    about |= {"median_std": spread, "noise": float(measured.attrs["noise"]), "pixels": counts}
    if json:
        print(json_module.dumps(about | (error or {}), indent=1))
        return
    others = ", ".join(f"{count} {name}" for name, count in counts.items() if count and name != "known")
    print(f"{out}: {about['near']:.4g} to {about['far']:.4g} m, standard deviation {1e3 * spread:.3g} mm (median)")
    print(f"  {counts['known']} of {why.size} pixels known" + (f"; {others}" if others else ""))
    if error:
        share = f"{error['rmse_percent']:.3g} % of its range; largest {1e3 * error['largest']:.3g} mm"
        print(f"  against the truth: RMSE {1e3 * error['rmse']:.3g} mm, {share}")


def said_spectra(measured: xr.Dataset, out: Path, json: bool) -> None:
    """Bands, size, uncertainty and what was left out."""
    import numpy as np

    nm, quality = measured["wavelength_nm"].values, measured["quality"].values
    spread = float(np.nanmedian(measured["reflectance_std"].values))
    saturated, dark = int((quality == 1).sum()), int((quality == 2).sum())
    about = {"out": str(out), "bands": nm.size, "first_nm": float(nm[0]), "last_nm": float(nm[-1])}
    if json:
        print(json_module.dumps({**about, "median_std": spread, "saturated": saturated, "dark": dark}, indent=1))
        return
    size_text = f"{quality.shape[1]}×{quality.shape[2]} pixels"
    print(f"{out}: {nm.size} bands, {nm[0]:g} to {nm[-1]:g} nm, {size_text}, standard deviation {spread:.2g} (median)")
    print(f"  left out: {saturated} saturated and {dark} dark of {quality.size} values")


def said_comparison(compared: list[Comparison], json: bool) -> None:
    """A line per point."""
    rows = [one.row() for one in compared]
    for one in compared:
        if not 1 / _FAR < one.scale < _FAR:
            times = f"{one.scale:.3g} times the spectrum (percent?)"
            warned(f"{one.name}: the reference is {times}; the RMSE takes both as they are")
    if json:
        print(json_module.dumps(rows, indent=1))
        return
    print(f"{'point':<12} {'y,x':>9} {'bands':>6} {'SAM (°)':>8} {'RMSE':>8}")
    for one in compared:
        place = f"{one.place[0]},{one.place[1]}"
        print(f"{one.name:<12} {place:>9} {one.nm.size:>6} {one.angle:>8.3f} {one.rmse:>8.4f}")
        for name, (seen, true) in one.filters.items():
            print(f"  through {name}: {seen:.4f}, spectrometer {true:.4f}")
    print(f"{'mean':<12} {'':>9} {'':>6} {sum(one.angle for one in compared) / len(compared):>8.3f}")
