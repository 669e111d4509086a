"""A rendered table: all files that the optical one of figure 31 would give, with the truth beside them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tmca.data import atomic_path, label, label_depth, label_spectral_depth, metres_to_nm, rendered_scene, write_dataset
from tmca.errors import SettingError
from tmca.lab.spectral_scan.rendered import render_scan
from tmca.lab.structured_light.fringes import FringePlan, write_fringes
from tmca.lab.structured_light.rendered import bench, render_fringes, scene_depth

_BITS, _READ_NOISE, _RAYS = 16, 64.0, 3
POINTS = {"P1": (0.3, 0.3), "P2": (0.5, 0.7), "P3": (0.75, 0.4)}
"""Where the rendered spectrometer looks, in heights and widths of the picture."""
_BOX = 5


def write_bench(
    folder: str | Path,
    *,
    picture: str = "coffee",
    shape: str = "steps",
    size: tuple[int, int] = (96, 128),
    plan: FringePlan | None = None,
    snr_db: float = 30.0,
    seed: int = 0,
    overwrite: bool = False,
) -> dict[str, tuple[int, int]]:
    """Write fringes and their captures, a spectral scan, calibration, references and truth; whole or not at all.

    ``fringes/`` (projected), ``captures/``, ``scene/``, ``white/``, ``dark/`` (16-bit PNG), ``calibration.json``,
    ``references.csv`` (nm, a column per point), ``truth.nc`` (``radiance`` and ``depth``).

    Args:
        folder: to write.
        picture: of `tmca.data.rendered_scene`, for the reflectance.
        shape: of `scene_depth`, 0.4–1.6 m.
        size: (height, width) of the camera; a third of the picture's at most.
        plan: of fringes.
        snr_db: of the captures of fringes.
        seed: of all noise.

    Returns:
        (row, column) of the references' points.

    Raises:
        SettingError: an impossible setting.
        OutputError: see `tmca.data.atomic_path`.
    """
    if min(size) < 16:
        raise SettingError("size", f"{size[0]}×{size[1]}", "16 pixels or more")
    plan, fine = plan or FringePlan(), (size[0] * _RAYS, size[1] * _RAYS)
    scene, depth, table = rendered_scene(picture, size=fine), scene_depth(shape, fine), bench(size, plan.size)
    reflectance = scene["reflectance"].values.astype(np.float64)
    seen = render_fringes(plan, table, depth, reflectance.mean(axis=0), snr_db=snr_db, bits=_BITS, seed=seed)
    cube = reflectance.reshape(-1, size[0], _RAYS, size[1], _RAYS).mean(axis=(2, 4))
    scan, nm = (
        render_scan(cube, read_noise=_READ_NOISE, bits=_BITS, seed=seed),
        metres_to_nm(scene["wavelength"].values),
    )
    places = {name: (int(y * size[0]), int(x * size[1])) for name, (y, x) in POINTS.items()}
    with atomic_path(folder, overwrite=overwrite) as place:
        place.mkdir()
        write_fringes(plan, place / "fringes")
        table.save(place / "calibration.json")
        _frames(place / "captures", list(plan.names), seen.frames)
        _frames(place / "scene", [f"scene_{w:g}nm" for w in nm], scan.scene)
        _frames(place / "white", [f"white_{w:g}nm" for w in nm], scan.white)
        _frames(place / "dark", [f"dark_{i}" for i in range(len(scan.dark))], scan.dark)
        (place / "references.csv").write_text(_references(cube, nm, places), encoding="utf-8")
        middle = depth[_RAYS // 2 :: _RAYS, _RAYS // 2 :: _RAYS]
        cube_there = label(cube.astype(np.float32), scene["wavelength"].values)
        write_dataset(label_spectral_depth(cube_there, label_depth(middle, folder)), place / "truth.nc")
    return places


def _frames(folder: Path, names: list[str], frames: NDArray[np.uint16]) -> None:
    from PIL import Image

    folder.mkdir()
    for name, frame in zip(names, frames, strict=True):
        Image.fromarray(frame).save(folder / f"{name}.png")


def _references(cube: NDArray[np.float64], nm: NDArray[np.float64], places: dict[str, tuple[int, int]]) -> str:
    """What a spectrometer tells of boxes of the scene, every 2 nm."""
    fine, half = np.arange(nm[0], nm[-1] + 1, 2.0), _BOX // 2
    boxes = [cube[:, y - half : y + half + 1, x - half : x + half + 1].mean(axis=(1, 2)) for y, x in places.values()]
    table = np.column_stack([fine, *(np.interp(fine, nm, spectrum) for spectrum in boxes)])
    lines = [",".join(["wavelength_nm", *places]), *(",".join(f"{value:.6g}" for value in row) for row in table)]
    return "\n".join(lines) + "\n"
