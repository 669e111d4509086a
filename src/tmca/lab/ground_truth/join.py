"""A scan's spectra and a depth map, joined into the file that the spectral-depth camera is trained on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tmca.data import label, label_depth, label_spectral_depth, read_dataset
from tmca.errors import DataError, SettingError
from tmca.lab.frames import check_size

if TYPE_CHECKING:
    import xarray as xr


SPECTRA, DEPTH = ("reflectance", "reflectance_std", "quality"), ("depth", "depth_std", "confidence")


def join_ground_truth(
    spectra: xr.Dataset, depth: xr.Dataset, name: str = "scene", wavelengths: Sequence[float] | None = None
) -> xr.Dataset:
    """Cube and depth map of the same camera as one scene, as `tmca.data.read_spectral_depth` reads it.

    Cubes have no gaps there: a band that is left out at a pixel is interpolated between the pixel's measured bands,
    and a pixel without any has zeros and no known depth. Negative reflectance, which noise makes of black, becomes 0,
    and above 1, which specular light is, 1. ``measured`` says which values are none of that.

    Args:
        spectra: of `tmca.lab.ground_truth.scan.measure_reflectance`.
        depth: of `tmca.lab.ground_truth.depth.measure_depth`.
        name: of the scene.
        wavelengths: of its bands, metres, ascending: a camera's, to which the scan's are interpolated; the scan's own
            without it.

    Returns:
        ``radiance`` (wavelength, y, x), the reflectance under an even light, in [0, 1]; ``depth`` (y, x), metres, NaN
        where unknown; ``radiance_std``, ``depth_std`` and ``measured`` beside them; counts in the attributes.

    Raises:
        DataError: another size, wavelengths outside the scan's, or no pixel with both a spectrum and a depth.
        SettingError: wavelengths that do not ascend.
    """
    values = spectra["reflectance"].values.astype(np.float64)
    good = np.isfinite(values)
    metres = _known_depth(depth, good)
    whole = _without_gaps(values, spectra["wavelength"].values)
    empty = ~good.any(axis=0)
    within = np.clip(whole, 0, 1)
    counts = {
        "interpolated": int((~good & ~empty).sum()),
        "clipped": int((within != whole).sum()),
        "pixels_without_spectrum": int(empty.sum()),
    }
    about = {"name": name, "metric": True, "kind": "spectral-depth scene", "quantity": "reflectance", **counts}
    scanned, std = spectra["wavelength"].values, spectra["reflectance_std"].values
    asked = scanned if wavelengths is None else _checked(np.asarray(wavelengths, dtype=np.float64), scanned, spectra)
    cube = label(_at(asked, scanned, within).astype(np.float32), asked)
    scene = label_spectral_depth(cube, label_depth(metres, name), about)
    scene["radiance_std"] = (cube.dims, _at(asked, scanned, std).astype(np.float32))
    scene["depth_std"] = (("y", "x"), depth["depth_std"].values, {"units": "m"})
    scene["measured"] = (cube.dims, (_at(asked, scanned, good & (within == whole)) > 1 - 1e-6).astype(np.uint8))
    return scene


def _known_depth(depth: xr.Dataset, good: NDArray[np.bool_]) -> NDArray[np.float64]:
    """The depth map (H, W) where a pixel has any good band of (L, H, W), NaN elsewhere."""
    where = depth.attrs.get("source", "depth")
    check_size(where, "a depth map", depth["depth"].shape, good.shape[1:], "use the camera of the spectra")
    metres = np.where(good.any(axis=0), depth["depth"].values, np.nan)
    if not np.isfinite(metres).any():
        raise DataError(where, "no pixel with a spectrum and a depth", "some")
    return metres


def _checked(asked: NDArray[np.float64], scanned: NDArray[np.float64], spectra: xr.Dataset) -> NDArray[np.float64]:
    """The wavelengths asked for, which ascend within the scan's."""
    if not asked.size or (np.diff(asked) <= 0).any():
        raise SettingError("wavelengths", f"{asked.size} that do not ascend", "ascending wavelengths")
    if asked[0] < scanned[0] * (1 - 1e-9) or asked[-1] > scanned[-1] * (1 + 1e-9):
        found, wanted = (f"{w[0] * 1e9:g} to {w[-1] * 1e9:g} nm" for w in (scanned, asked))
        raise DataError(spectra.attrs.get("source", "spectra"), found, wanted, "scan or ask for those wavelengths")
    return asked


def _at(asked: NDArray[np.float64], scanned: NDArray[np.float64], cube: NDArray[Any]) -> NDArray[np.float64]:
    """The cube between its bands; of standard deviations that is no less than what is true."""
    above = np.clip(np.searchsorted(scanned, asked), min(1, len(scanned) - 1), len(scanned) - 1)
    below = np.maximum(above - 1, 0)
    gap = np.where(above > below, scanned[above] - scanned[below], 1.0)
    share = np.where(above > below, (asked - scanned[below]) / gap, 1.0)[:, None, None]
    # a band that is hit takes nothing from its neighbour, which may be unknown
    low, high = (np.where(part, cube[i], 0.0) for part, i in ((share < 1 - 1e-9, below), (share > 1e-9, above)))
    return np.asarray((1 - share) * low + share * high, dtype=np.float64)


def _without_gaps(cube: NDArray[np.float64], wavelengths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Each pixel's missing bands by linear interpolation, the ends by the nearest; zeros where all are missing."""
    filled, good = np.nan_to_num(cube, nan=0.0), np.isfinite(cube)
    for y, x in np.argwhere(good.any(axis=0) & ~good.all(axis=0)):
        there = good[:, y, x]
        filled[~there, y, x] = np.interp(wavelengths[~there], wavelengths[there], cube[there, y, x])
    return filled


def open_part(path: str | Path, names: tuple[str, ...], made_by: str) -> xr.Dataset:
    """A file of spectra or of depth, whole in memory.

    Raises:
        DataError: missing, damaged, or without one of the variables.
    """
    path = Path(path)
    if not path.exists():
        raise DataError(path, "no such file", f"a file of {made_by}", "check the path")
    dataset = read_dataset(path)
    there = [str(name) for name in dataset.data_vars]
    if gone := [name for name in names if name not in there]:
        found = f"no {gone[0]} ({', '.join(there) or 'nothing'})"
        raise DataError(path, found, f"a file of {made_by}", f"write it with {made_by}")
    return dataset.assign_attrs(source=str(path))


def open_cube(path: str | Path) -> xr.DataArray:
    """The reflectance of a scan with its gaps, or any cube that `tmca.data.read` reads.

    Raises:
        DataError: neither.
    """
    from tmca.data import read
    from tmca.data.formats.opening import open_contents

    with open_contents(path) as contents:
        scanned = {"reflectance", "quality"} <= set(contents.arrays)
    if scanned:
        return open_part(path, SPECTRA, "tmca scan spectra")["reflectance"].assign_attrs(source=str(path))
    return read(path, negative="keep")
