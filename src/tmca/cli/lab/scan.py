"""``tmca scan``: spectra and depth of real scenes, as ground truth for the spectral-depth camera."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App, Parameter

from tmca.cli.options.numbers import Whole, whole_numbers
from tmca.cli.options.numbers import size as parsed_size
from tmca.cli.options.output import Figure, Json, Overwrite, check_figure, check_targets, say
from tmca.errors import SettingError
from tmca.specs.base import metres_of_nm

if TYPE_CHECKING:
    import xarray as xr

    from tmca.lab.ground_truth.fringes import FringePlan

app = App(
    name="scan", help="Ground truth on the table: depth by fringes, spectra by a tunable source, both as one scene."
)


def _plan(projector: str, fringes: str, steps: int, across: Literal["x", "y"]) -> FringePlan:
    """A plan from ``HEIGHTxWIDTH`` and ``1,4,16,64``."""
    from tmca.lab.ground_truth.fringes import FringePlan

    counts = whole_numbers(fringes, "--fringes")
    return FringePlan(parsed_size(projector, "--projector") or (800, 1280), tuple(counts), steps, across)


@app.command
def fringes(
    folder: Path,
    /,
    *,
    projector: str = "800x1280",
    fringes: str = "1,4,16,64",
    steps: Whole = 4,
    across: Literal["x", "y"] = "x",
    overwrite: Overwrite = False,
) -> None:
    """Write the fringes to project into FOLDER: a PNG per frame, and fringes.json that names them in order.

    Args:
        folder: to make.
        projector: HEIGHTxWIDTH in pixels.
        fringes: over the projector's width (or height), ascending; 1 among them, or differences that lead to 1.
        steps: phase shifts of each.
        across: x for upright fringes (projector beside the camera), y for level ones (above it).
    """
    from tmca.lab.ground_truth.fringes import write_fringes
    from tmca.lab.ground_truth.phase import ladder

    plan = _plan(projector, fringes, steps, across)
    ladder(plan.fringes)
    write_fringes(plan, folder, overwrite=overwrite)
    print(f"{folder}: {len(plan.names)} frames, {plan.names[0]}.png … {plan.names[-1]}.png, and fringes.json")


@app.command
def depth(
    captures: Path,
    /,
    *,
    plan: Path,
    calibration: Path,
    out: Path,
    unwrap: Literal["temporal", "spatial", "graph-cut"] = "temporal",
    noise: float | None = None,
    saturation: float | None = None,
    near: float = 0.05,
    far: float = 20.0,
    neighbours: Whole = 6,
    truth: Path | None = None,
    figure: Figure = None,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Metric depth from CAPTURES of projected fringes, with its standard deviation and a mask of confidence.

    Args:
        captures: folder of frames (PNG, TIFF, NPY) named as the fringes or in their order, or a stack of them.
        plan: fringes.json that was projected.
        calibration: JSON of camera and projector.
        out: NetCDF file to write.
        unwrap: over the frequencies, or over neighbours: scikit-image's, or graph cuts (PUMA).
        noise: standard deviation of a frame, digital numbers; estimated without it.
        saturation: value from which on a pixel is saturated; an integer type's maximum without it.
        near: metres; what is nearer is left out.
        far: metres; what is farther is left out.
        neighbours: of eight that have to share a pixel's depth; 3 keeps the edges of surfaces, where depths are wrong.
        truth: a depth map to compare with.
    """
    from tmca.data import read_depth_map, write_dataset
    from tmca.lab.ground_truth.depth import REASONS, depth_error, measure_depth
    from tmca.lab.ground_truth.fringes import load_plan, read_capture
    from tmca.lab.ground_truth.geometry import load_calibration
    from tmca.plots.lab import measured_depth_figure
    from tmca.plots.style import save_figure

    check_figure(figure, overwrite)
    check_targets([out], overwrite, captures)
    projected = load_plan(plan)
    places = load_calibration(calibration)
    capture = read_capture(captures, projected, saturation)
    measured = measure_depth(
        capture, projected, places, unwrap=unwrap, noise=noise, near=near, far=far, neighbours=neighbours
    )
    error = None if truth is None else depth_error(measured, read_depth_map(truth))
    write_dataset(measured, out, overwrite=overwrite)
    if figure is not None:
        save_figure(measured_depth_figure(measured, REASONS, out.name), figure, overwrite=overwrite)
    _said_depth(measured, out, json, error)


@app.command
def render(
    folder: Path,
    /,
    *,
    picture: str = "coffee",
    shape: Literal["plane", "smooth", "steps"] = "steps",
    size: str = "96x128",
    snr: float = 30.0,
    fringes: str = "1,4,16,64",
    seed: Whole = 0,
    overwrite: Overwrite = False,
) -> None:
    """Write a rendered table into FOLDER: captures of fringes, a spectral scan, calibration, references, truth.

    Args:
        folder: to make.
        picture: of tmca render, whose reflectance the scene has.
        shape: of the scene, 0.4 to 1.6 m away.
        size: HEIGHTxWIDTH of the camera, at most a third of the picture's.
        snr: of the captures of fringes, dB.
        fringes: that are projected.
        seed: of the noise.
    """
    from tmca.cli.studies import study_module
    from tmca.data import check_target

    check_target(folder, overwrite)
    plan, camera = _plan("800x1280", fringes, 4, "x"), parsed_size(size) or (96, 128)
    places = study_module("rendered_table").write_bench(
        folder, picture=picture, shape=shape, size=camera, plan=plan, snr_db=snr, seed=seed, overwrite=overwrite
    )
    points = " ".join(f"{name}={y},{x}" for name, (y, x) in places.items())
    print(
        f"{folder}: {len(plan.names)} captures of fringes, a scan, calibration.json, truth.nc; references at {points}"
    )


@app.command
def spectra(
    scene: Path,
    /,
    *,
    dark: Path,
    white: Path,
    out: Path,
    wavelengths: str | None = None,
    saturation: float | None = None,
    white_reflectance: str = "1",
    read_noise: float | None = None,
    gain: float = 0.0,
    figure: Figure = None,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Reflectance of SCENE from frames under each wavelength of a tunable source, with its standard deviation.

    Args:
        scene: folder of frames with the wavelength in their names (scene_450nm.png), or in order, or a stack; those
            of one wavelength (scene_450nm_r1.png) are averaged.
        dark: dark frames, averaged; or some per wavelength.
        white: frames of a white reference, likewise.
        out: NetCDF file to write.
        wavelengths: asked for, in nm: FIRST:LAST:COUNT or a list; those of the names without it.
        saturation: value from which on a pixel is saturated; an integer type's maximum without it.
        white_reflectance: of the reference, a number or a text file of its spectrum.
        read_noise: standard deviation of a frame, digital numbers; that of the dark frames without it.
        gain: digital numbers per electron, for shot noise.
    """
    from tmca.data import write_dataset
    from tmca.lab.ground_truth.scan import measure_reflectance, read_scan, white_of
    from tmca.plots.lab import reflectance_figure
    from tmca.plots.style import save_figure

    check_figure(figure, overwrite)
    check_targets([out], overwrite, scene)
    asked = metres_of_nm(wavelengths)
    scan = read_scan(scene, dark, white, wavelengths=asked, saturation=saturation)
    rho = white_of(white_reflectance, scan.nm)
    measured = measure_reflectance(scan, white_reflectance=rho, read_noise=read_noise, gain=gain)
    write_dataset(measured, out, overwrite=overwrite)
    if figure is not None:
        save_figure(reflectance_figure(measured, out.name), figure, overwrite=overwrite)
    _said_spectra(measured, out, json)


@app.command
def compare(
    spectra: Path,
    /,
    *,
    references: Path,
    points: Annotated[list[str], Parameter(consume_multiple=True, negative="")],
    box: Whole = 5,
    bandwidth: float = 0.0,
    filters: Path | None = None,
    figure: Figure = None,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Spectral angle between points of SPECTRA and what a spectrometer measured there.

    Args:
        spectra: file of tmca scan spectra, or any cube.
        references: text file: wavelength in nm, then a column for each reference.
        points: NAME=ROW,COLUMN of each reference in the cube.
        box: pixels along each side that are averaged.
        bandwidth: full width at half maximum of the source in nm, by which the references are smoothed.
        filters: text file of filter responses, through which both are seen too.
    """
    from tmca.lab.ground_truth.join import open_cube
    from tmca.lab.ground_truth.spectra import compare_spectra, comparison_figure, read_spectra
    from tmca.plots.style import save_figure

    check_figure(figure, overwrite, spectra)
    responses = None if filters is None else read_spectra(filters)
    compared = compare_spectra(
        open_cube(spectra), read_spectra(references), _places(points), box=box, width_nm=bandwidth, filters=responses
    )
    if figure is not None:
        save_figure(comparison_figure(compared), figure, overwrite=overwrite)
    _said_comparison(compared, json)


@app.command
def join(
    spectra: Path,
    depth: Path,
    /,
    *,
    out: Path,
    wavelengths: str | None = None,
    figure: Figure = None,
    overwrite: Overwrite = False,
) -> None:
    """Join SPECTRA and DEPTH of one camera into the scene file that the spectral-depth camera reads.

    Args:
        spectra: file of tmca scan spectra.
        depth: file of tmca scan depth.
        out: NetCDF file to write.
        wavelengths: of the scene's bands, in nm, FIRST:LAST:COUNT or a list: a camera's; the scan's own without it.
    """
    from tmca.applications.file_pictures import picture_of
    from tmca.data import write_dataset
    from tmca.lab.ground_truth.join import DEPTH, SPECTRA, join_ground_truth, open_part

    check_figure(figure, overwrite)
    for source in (spectra, depth):
        check_targets([out], overwrite, source)
    parts = open_part(spectra, SPECTRA, "tmca scan spectra"), open_part(depth, DEPTH, "tmca scan depth")
    scene = join_ground_truth(*parts, name=out.stem, wavelengths=metres_of_nm(wavelengths))
    write_dataset(scene, out, overwrite=overwrite)
    if figure is not None:
        picture_of(out, figure, overwrite=overwrite)
    unknown, about = scene["depth"].attrs["unknown_pixels"], scene.attrs
    print(
        f"{out}: {scene.sizes['wavelength']} bands, {scene.sizes['y']}×{scene.sizes['x']} pixels, {unknown} of unknown "
        f"depth; {about['interpolated']} values interpolated, {about['clipped']} clipped"
    )


def _places(points: list[str]) -> dict[str, tuple[int, int]]:
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


def _said_depth(measured: xr.Dataset, out: Path, json: bool, error: dict[str, float] | None = None) -> None:
    """How many pixels have a depth, from where to where, how certain, and why the others have none."""
    import numpy as np

    from tmca.lab.ground_truth.depth import REASONS

    depth, why = measured["depth"].values, measured["confidence"].values
    counts = {name: int((why == i).sum()) for i, name in enumerate(REASONS)}
    spread = float(np.nanmedian(measured["depth_std"].values))
    about: dict[str, Any] = {"out": str(out), "near": float(np.nanmin(depth)), "far": float(np.nanmax(depth))}
    about |= {"median_std": spread, "noise": float(measured.attrs["noise"]), "pixels": counts}
    others = ", ".join(f"{count} {name}" for name, count in counts.items() if count and name != "known")
    lines = [
        f"{out}: {about['near']:.4g} to {about['far']:.4g} m, standard deviation {1e3 * spread:.3g} mm (median)",
        f"  {counts['known']} of {why.size} pixels known" + (f"; {others}" if others else ""),
    ]
    if error:
        share = f"{error['rmse_percent']:.3g} % of its range; largest {1e3 * error['largest']:.3g} mm"
        lines.append(f"  against the truth: RMSE {1e3 * error['rmse']:.3g} mm, {share}")
    say(about | (error or {}), json, *lines)


def _said_spectra(measured: xr.Dataset, out: Path, json: bool) -> None:
    """Bands, size, uncertainty and what was left out."""
    import numpy as np

    nm, quality = measured["wavelength_nm"].values, measured["quality"].values
    spread = float(np.nanmedian(measured["reflectance_std"].values))
    saturated, dark = int((quality == 1).sum()), int((quality == 2).sum())
    about = {"out": str(out), "bands": nm.size, "first_nm": float(nm[0]), "last_nm": float(nm[-1])}
    size_text = f"{quality.shape[1]}×{quality.shape[2]} pixels"
    say(
        about | {"median_std": spread, "saturated": saturated, "dark": dark}, json,
        f"{out}: {nm.size} bands, {nm[0]:g} to {nm[-1]:g} nm, {size_text}, standard deviation {spread:.2g} (median)",
        f"  left out: {saturated} saturated and {dark} dark of {quality.size} values",
    )  # fmt: skip


def _said_comparison(compared: list[Any], json: bool) -> None:
    """A line per point."""
    lines = [f"{'point':<12} {'y,x':>9} {'bands':>6} {'SAM (°)':>8} {'RMSE':>8}"]
    for one in compared:
        place = f"{one.place[0]},{one.place[1]}"
        lines.append(f"{one.name:<12} {place:>9} {one.nm.size:>6} {one.angle:>8.3f} {one.rmse:>8.4f}")
        seen = one.filters.items()
        lines += [f"  through {name}: {found:.4f}, spectrometer {true:.4f}" for name, (found, true) in seen]
    mean = sum(one.angle for one in compared) / len(compared)
    say([one.row() for one in compared], json, *lines, f"{'mean':<12} {'':>9} {'':>6} {mean:>8.3f}")
