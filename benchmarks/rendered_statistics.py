"""Rendered scenes beside real cubes: ``python benchmarks/rendered_statistics.py --real SPLIT --from FOLDER``.

Of every cube (31 bands, 256×256): components for 99 and 99.9 % of the spectral variance, the share of the energy that
no linear function of RGB predicts, slope and curvature of the power spectrum, kurtosis of the gradients, share of
pixels below 5 % of white, median and 99.9th percentile, all but the first three of the mean over bands. A row is the
median over the scenes, with their tenth and ninetieth percentiles.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import tmca
from tmca.data import read_split, rendered_names, rendered_scene
from tmca.data.rendered_folders import drawn_photographs
from tmca.data.rendering.measured import GRID_NM, rgb_observer

Array = NDArray[np.float64]
SIZE = (256, 256)


def components(cube: Array, share: float) -> float:
    """Principal components of the spectra that hold a share of the variance."""
    energy = np.linalg.eigvalsh(np.cov(cube.reshape(len(cube), -1)))[::-1]
    return float(np.searchsorted(np.cumsum(energy) / energy.sum(), share) + 1)


def unexplained(cube: Array) -> float:
    """Share of the energy that no linear function of RGB predicts, per cent."""
    spectra = cube.reshape(len(cube), -1).T
    bands = np.linspace(GRID_NM[0], GRID_NM[-1], len(cube))
    to_grid = np.stack([np.interp(GRID_NM, bands, one) for one in np.eye(len(cube))])
    rgb = spectra @ (to_grid @ rgb_observer().T)
    predicted = rgb @ np.linalg.lstsq(rgb, spectra, rcond=None)[0]
    return float(100 * np.sum((spectra - predicted) ** 2) / np.sum(spectra**2))


def slope(cube: Array, low: float = 4, high: float = 100) -> float:
    """Exponent of the power of the mean over bands between two frequencies, cycles per picture."""
    picture = cube.mean(axis=0)
    window = np.outer(*(np.hanning(n) for n in picture.shape))
    power = np.abs(np.fft.fft2((picture - picture.mean()) * window)) ** 2
    radius = np.hypot(*np.meshgrid(*(np.fft.fftfreq(n) * n for n in picture.shape), indexing="ij"))
    edges = np.geomspace(low, high, 13)
    rings = [power[(radius >= a) & (radius < b)].mean() for a, b in pairwise(edges)]
    return float(np.polyfit(np.log(np.sqrt(edges[1:] * edges[:-1])), np.log(np.array(rings) + 1e-30), 1)[0])


def kurtosis(cube: Array) -> float:
    """Of the differences between neighbours, of the mean over bands."""
    picture = cube.mean(axis=0)
    steps = np.concatenate([np.diff(picture, axis=axis).ravel() for axis in (0, 1)])
    return float((steps**4).mean() / (steps**2).mean() ** 2)


STATISTICS: dict[str, Callable[[Array], float]] = {
    "components 99 %": lambda cube: components(cube, 0.99),
    "99.9 %": lambda cube: components(cube, 0.999),
    "beyond RGB, %": unexplained,
    "slope": slope,
    "slope above 32": lambda cube: slope(cube, 32),
    "kurtosis": kurtosis,
    "below 5 %": lambda cube: float(100 * (cube.mean(axis=0) < 0.05).mean()),
    "median": lambda cube: float(np.median(cube.mean(axis=0))),
    "99.9th": lambda cube: float(np.quantile(cube.mean(axis=0), 0.999)),
}


def row(name: str, cubes: Iterable[Array]) -> str:
    """A line of the table."""
    values = np.array([[measure(cube) for measure in STATISTICS.values()] for cube in cubes])
    spread = np.quantile(values, (0.5, 0.1, 0.9), axis=0).T
    cells = [f"{middle:.3g} ({low:.3g} to {high:.3g})" for middle, low, high in spread]
    return f"| {name}, {len(values)} | {' | '.join(cells)} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--real", type=Path, required=True, help="split of real cubes")
    parser.add_argument("--from", dest="folder", type=Path, required=True, help="photographs")
    parser.add_argument("--number", type=int, default=24, help="of photographs [24]")
    parser.add_argument("--only", nargs="*", default=("real", "named", "flat", "drawn"), help="rows")
    options = parser.parse_args()
    photographs = drawn_photographs(options.folder, options.number, 0)

    def rendered(light: str) -> Iterable[Array]:
        for path in photographs.values():
            yield rendered_scene(path, size=SIZE, light=light).radiance.values.astype(np.float64)  # type: ignore[arg-type]

    rows: dict[str, Iterable[Array]] = {
        "real": (tmca.read(path).values.astype(np.float64) for path in read_split(options.real)),
        "named": (rendered_scene(name, size=SIZE).radiance.values.astype(np.float64) for name in rendered_names()),
        "flat": rendered("flat"),
        "drawn": rendered("drawn"),
    }
    print(f"| scenes | {' | '.join(STATISTICS)} |\n|{'---|' * (len(STATISTICS) + 1)}")
    for name in options.only:
        print(row(name, rows[name]), flush=True)


if __name__ == "__main__":
    main()
