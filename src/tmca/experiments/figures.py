"""The figures that come beside every result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tmca.errors import OutputError
from tmca.experiments.composite import rgb_composite, white_level

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tmca.cameras import SpectralCamera

PICTURES = (".png", ".pdf", ".svg")
_POINT_COLOURS = ("#d1495b", "#00798c", "#edae49", "#66a182")


def save_figure(figure: Figure, path: str | Path, *, overwrite: bool = False, dpi: int = 110) -> Path:
    """Write a figure as PNG, PDF or SVG, by its suffix, whole or not at all.

    Raises:
        OutputError: another suffix, the file exists, or it cannot be written.
    """
    from tmca.data import atomic_path

    check_picture(path)
    with atomic_path(path, overwrite=overwrite) as temporary:
        figure.savefig(temporary, dpi=dpi, format=Path(path).suffix[1:].lower(), facecolor="white")
    return Path(path)


def check_picture(path: str | Path) -> None:
    """Raises OutputError unless pictures can be written under this suffix."""
    if Path(path).suffix.lower() not in PICTURES:
        raise OutputError(path, f"the suffix {Path(path).suffix!r}", " ".join(PICTURES), "rename the picture")


def cube_figure(cube: np.ndarray, wavelengths: Sequence[float], title: str) -> Figure:
    """A cube: colour composite, the bands that span it, and the spectra of a few points."""
    figure, axes = _grid(1, 3, width=4.2, aspect=cube.shape[1] / cube.shape[2])
    picture = rgb_composite(cube, wavelengths)
    points = spread_points(cube)
    _image(axes[0, 0], picture, title)
    _mark(axes[0, 0], points)
    _spectra(axes[0, 1], {"": cube}, wavelengths, points)
    _image(axes[0, 2], _montage(cube, 12), "bands, short to long wavelength", colours="gray")
    return figure


def snapshot_figure(snapshot: np.ndarray, camera: SpectralCamera, title: str) -> Figure:
    """The recorded image and the codes that made it."""
    figure, axes = _grid(1, 2, width=6.0, aspect=snapshot.shape[0] / snapshot.shape[1])
    shown = axes[0, 0].imshow(snapshot, cmap="gray", vmin=0)
    _bare(axes[0, 0], title)
    figure.colorbar(shown, ax=axes[0, 0], shrink=0.7, label="relative irradiance")
    share = np.clip(np.asarray(snapshot).ravel() / camera.full_scale, -0.05, 1.1)
    axes[0, 1].hist(share, bins=120, color="#00798c")
    axes[0, 1].set(xlabel="share of full scale", ylabel="pixels", title="levels", yscale="log")
    return figure


def image_figure(values: np.ndarray, title: str) -> Figure:
    """A 2-D image, or the planes of a 3-D stack (smallest axis first), in grey."""
    figure, axes = _grid(1, 1, width=7.0)
    sheet = values if values.ndim == 2 else _montage(np.moveaxis(values, int(np.argmin(values.shape)), 0), 16)
    shown = axes[0, 0].imshow(sheet, cmap="gray", interpolation="nearest")
    _bare(axes[0, 0], title)
    figure.colorbar(shown, ax=axes[0, 0], shrink=0.7)
    return figure


def codes_figure(camera: SpectralCamera, crop: int = 48) -> Figure:
    """Aperture T, shutter S and the code cube T̂ (thesis figure 19), a corner of ``crop`` pixels of each."""
    aperture, shutter = (plane.detach().cpu().numpy() for plane in camera.codes())
    code = camera.code_cube().detach().cpu().numpy()
    columns = max(min(camera.slots, 8), min(camera.bands, 8))
    figure, axes = _grid(3, columns, width=1.5, aspect=1.0)
    for row, (planes, name) in enumerate(((aperture, "T slot"), (shutter, "S slot"), (code, "T̂ band"))):
        chosen = np.linspace(0, len(planes) - 1, min(len(planes), columns)).round().astype(int)
        for axis, index in zip(axes[row], chosen, strict=False):
            _image(
                axis, planes[index, :crop, :crop], f"{name} {index}", colours="gray", top=max(float(planes.max()), 1e-9)
            )
        for axis in axes[row, len(chosen) :]:
            axis.set_axis_off()
    return figure


def reconstruction_figure(
    estimates: Mapping[str, np.ndarray],
    wavelengths: Sequence[float],
    truth: np.ndarray | None = None,
    deviations: Mapping[str, np.ndarray] | None = None,
) -> Figure:
    """Colour composites, error and uncertainty maps of one or more reconstructions, and spectral signatures at points.

    Args:
        estimates: name → (L, H, W).
        wavelengths: (L,) metres.
        truth: (L, H, W), if it is known.
        deviations: name → (L, H, W) predicted standard deviation.
    """
    deviations = deviations or {}
    reference = truth if truth is not None else next(iter(estimates.values()))
    white, points = white_level(reference, wavelengths), spread_points(reference)
    rows = 1 + (truth is not None) + bool(deviations)
    figure, axes = _grid(rows, len(estimates) + 1, width=3.6, aspect=reference.shape[1] / reference.shape[2])
    _image(axes[0, 0], rgb_composite(reference, wavelengths, white), "truth" if truth is not None else "points")
    _mark(axes[0, 0], points)
    errors = {} if truth is None else {name: _rms(cube - truth) for name, cube in estimates.items()}
    spreads = {name: _rms(deviations[name]) for name in estimates if name in deviations}
    top = float(
        np.quantile(np.concatenate([m.ravel() for m in [*errors.values(), *spreads.values()]] or [np.ones(1)]), 0.99)
    )
    for column, (name, cube) in enumerate(estimates.items(), start=1):
        _image(axes[0, column], rgb_composite(cube, wavelengths, white), _caption(name, cube, truth))
        if name in errors:
            _image(axes[1, column], errors[name], "error (rms over bands)", colours="magma", top=top, bar=True)
        if name in spreads:
            _image(axes[rows - 1, column], spreads[name], "predicted error (1 σ)", colours="magma", top=top, bar=True)
    if rows > 1:
        _spectra(axes[1, 0], {**({"truth": truth} if truth is not None else {}), **estimates}, wavelengths, points)
    for axis in axes[2:, 0]:
        axis.set_axis_off()
    return figure


def spread_points(cube: np.ndarray, count: int = 3) -> list[tuple[int, int]]:
    """A few lit pixels (row, column), each of a spectrum whose shape is farthest from those before."""
    from scipy.ndimage import uniform_filter

    smooth = np.stack([uniform_filter(band, 7) for band in cube]).reshape(len(cube), -1)
    strength = np.linalg.norm(smooth, axis=0)
    shape = smooth / np.maximum(strength, 0.3 * strength.max() + 1e-12)
    shape[:, strength < 0.3 * strength.max()] = shape[:, [int(strength.argmax())]]
    inside = np.zeros(cube.shape[1:], dtype=bool)
    rows, columns = cube.shape[1] // 12, cube.shape[2] // 12
    inside[rows : cube.shape[1] - rows, columns : cube.shape[2] - columns] = True
    strength = np.where(inside.ravel(), strength, 0)
    chosen = [int(strength.argmax())]
    distance = np.full(shape.shape[1], np.inf)
    while len(chosen) < count:
        distance = np.minimum(distance, ((shape - shape[:, [chosen[-1]]]) ** 2).sum(0))
        chosen.append(int(distance.argmax()))
    return [(index // cube.shape[2], index % cube.shape[2]) for index in chosen]


def _grid(rows: int, columns: int, width: float, aspect: float = 0.8) -> tuple[Figure, np.ndarray]:
    """Axes for pictures ``width`` inches wide whose height is ``aspect`` times that."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width * columns, (width * aspect + 0.35) * rows), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False)


def _image(
    axis: Axes, values: np.ndarray, title: str, colours: str = "viridis", top: float | None = None, bar: bool = False
) -> None:
    shown = axis.imshow(values, cmap=colours, vmin=0, vmax=top, interpolation="nearest")
    _bare(axis, title)
    if bar:
        axis.figure.colorbar(shown, ax=axis, shrink=0.75)


def _bare(axis: Axes, title: str) -> None:
    axis.set_title(title, fontsize=9)
    axis.set_xticks([])
    axis.set_yticks([])


def _mark(axis: Axes, points: Sequence[tuple[int, int]]) -> None:
    for colour, (row, column) in zip(_POINT_COLOURS, points, strict=False):
        axis.plot(column, row, "o", markersize=7, markerfacecolor=colour, markeredgecolor="white")


def _spectra(
    axis: Axes, cubes: Mapping[str, np.ndarray], wavelengths: Sequence[float], points: Sequence[tuple[int, int]]
) -> None:
    """Solid: the first cube (the truth); the others with dashes and dots."""
    nanometres = np.asarray(wavelengths) * 1e9
    styles = ("-", "--", ":", "-.")
    for style, (name, cube) in zip(styles, cubes.items(), strict=False):
        for index, (row, column) in enumerate(points):
            label = name if index == 0 and name else None
            axis.plot(nanometres, cube[:, row, column], style, color=_POINT_COLOURS[index], label=label, linewidth=1.4)
    axis.set_title("spectra at the points", fontsize=9)
    axis.set_xlabel("wavelength (nm)")
    axis.set_ylabel("relative irradiance")
    if any(cubes):
        axis.legend(fontsize=7)


def _caption(name: str, cube: np.ndarray, truth: np.ndarray | None) -> str:
    if truth is None:
        return name
    from tmca.metrics import psnr

    return f"{name}\n{psnr(cube, truth):.2f} dB"


def _rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt((values**2).mean(0))


def _montage(cube: np.ndarray, count: int) -> np.ndarray:
    """Up to ``count`` bands side by side in four columns."""
    chosen = np.linspace(0, len(cube) - 1, min(count, len(cube))).round().astype(int)
    columns = min(4, len(chosen))
    rows = -(-len(chosen) // columns)
    sheet = np.zeros((rows * cube.shape[1], columns * cube.shape[2]), dtype=cube.dtype)
    for place, band in enumerate(chosen):
        y, x = divmod(place, columns)
        sheet[y * cube.shape[1] : (y + 1) * cube.shape[1], x * cube.shape[2] : (x + 1) * cube.shape[2]] = cube[band]
    return sheet
