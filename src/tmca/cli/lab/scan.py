"""``tmca scan``: spectra and depth of real scenes, as ground truth for the spectral-depth camera."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from tmca.cli.options.numbers import Whole, whole
from tmca.cli.options.numbers import size as parsed_size
from tmca.cli.options.output import check_figure, check_targets

app = App(
    name="scan", help="Ground truth on the table: depth by fringes, spectra by a tunable source, both as one scene."
)
for name, text in {
    "spectra": "Reflectance of SCENE from a frame per wavelength of a tunable source, with its standard deviation.",
    "compare": "Spectral angle between points of SPECTRA and what a spectrometer measured there.",
    "join": "Join SPECTRA and DEPTH of one camera into the scene file that the spectral-depth camera reads.",
}.items():
    app.command(f"tmca.cli.lab.scan_spectra:{name}", name=name, help=text)


@app.command
def fringes(
    folder: Path,
    /,
    *,
    projector: str = "800x1280",
    fringes: str = "1,4,16,64",
    steps: Whole = 4,
    across: Literal["x", "y"] = "x",
    overwrite: bool = False,
) -> None:
    """Write the fringes to project into FOLDER: a PNG per frame, and fringes.json that names them in order.

    Args:
        folder: to make.
        projector: HEIGHTxWIDTH in pixels.
        fringes: over the projector's width (or height), ascending; 1 among them, or differences that lead to 1.
        steps: phase shifts of each.
        across: x for upright fringes (projector beside the camera), y for level ones (above it).
        overwrite: replace the folder if it exists.
    """
    from tmca.cli.lab.scan_words import fringe_plan
    from tmca.lab.ground_truth.fringes import write_fringes
    from tmca.lab.ground_truth.phase import ladder

    plan = fringe_plan(projector, fringes, steps, across)
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
    neighbours: Annotated[int, Parameter(converter=whole)] = 6,
    truth: Path | None = None,
    figure: Path | None = None,
    overwrite: bool = False,
    json: bool = False,
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
        figure: write a picture of it (PNG).
        overwrite: replace files that exist.
        json: print JSON instead of text.
    """
    from tmca.cli.lab.scan_words import said_depth
    from tmca.data import read_depth_map, write_dataset
    from tmca.lab.ground_truth.depth import depth_error, depth_figure, measure_depth
    from tmca.lab.ground_truth.fringes import load_plan, read_capture
    from tmca.lab.ground_truth.geometry import load_calibration
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
        save_figure(depth_figure(measured, out.name), figure, overwrite=overwrite)
    said_depth(measured, out, json, error)


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
    overwrite: bool = False,
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
        overwrite: replace the folder if it exists.
    """
    from tmca.cli.lab.scan_words import fringe_plan
    from tmca.data import check_target
    from tmca.lab.ground_truth.rendered import write_bench

    check_target(folder, overwrite)
    plan, camera = fringe_plan("800x1280", fringes, 4, "x"), parsed_size(size) or (96, 128)
    places = write_bench(
        folder, picture=picture, shape=shape, size=camera, plan=plan, snr_db=snr, seed=seed, overwrite=overwrite
    )
    points = " ".join(f"{name}={y},{x}" for name, (y, x) in places.items())
    print(
        f"{folder}: {len(plan.names)} captures of fringes, a scan, calibration.json, truth.nc; references at {points}"
    )
