"""The spectra of ``tmca scan``, and the scene they make with a depth map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from tmca.cli.options.numbers import Whole
from tmca.cli.options.output import check_figure, check_targets
from tmca.specs.base import metres_of_nm


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
    figure: Path | None = None,
    overwrite: bool = False,
    json: bool = False,
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
        figure: write a picture of it (PNG).
        overwrite: replace files that exist.
        json: print JSON instead of text.
    """
    from tmca.cli.lab.scan_words import said_spectra
    from tmca.data import write_dataset
    from tmca.lab.ground_truth.scan import measure_reflectance, read_scan, reflectance_figure, white_of
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
    said_spectra(measured, out, json)


def compare(
    spectra: Path,
    /,
    *,
    references: Path,
    points: Annotated[list[str], Parameter(consume_multiple=True, negative="")],
    box: Whole = 5,
    bandwidth: float = 0.0,
    filters: Path | None = None,
    figure: Path | None = None,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Spectral angle between points of SPECTRA and what a spectrometer measured there.

    Args:
        spectra: file of tmca scan spectra, or any cube.
        references: text file: wavelength in nm, then a column for each reference.
        points: NAME=ROW,COLUMN of each reference in the cube.
        box: pixels along each side that are averaged.
        bandwidth: full width at half maximum of the source in nm, by which the references are smoothed.
        filters: text file of filter responses, through which both are seen too.
        figure: write a picture of it (PNG).
        overwrite: replace the picture if it exists.
        json: print JSON instead of text.
    """
    from tmca.cli.lab.scan_words import places, said_comparison
    from tmca.lab.ground_truth.join import open_cube
    from tmca.lab.ground_truth.spectra import compare_spectra, comparison_figure, read_spectra
    from tmca.plots.style import save_figure

    check_figure(figure, overwrite, spectra)
    responses = None if filters is None else read_spectra(filters)
    compared = compare_spectra(
        open_cube(spectra), read_spectra(references), places(points), box=box, width_nm=bandwidth, filters=responses
    )
    if figure is not None:
        save_figure(comparison_figure(compared), figure, overwrite=overwrite)
    said_comparison(compared, json)


def join(
    spectra: Path,
    depth: Path,
    /,
    *,
    out: Path,
    wavelengths: str | None = None,
    figure: Path | None = None,
    overwrite: bool = False,
) -> None:
    """Join SPECTRA and DEPTH of one camera into the scene file that the spectral-depth camera reads.

    Args:
        spectra: file of tmca scan spectra.
        depth: file of tmca scan depth.
        out: NetCDF file to write.
        wavelengths: of the scene's bands, in nm, FIRST:LAST:COUNT or a list: a camera's; the scan's own without it.
        figure: write a picture of it (PNG).
        overwrite: replace files that exist.
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
