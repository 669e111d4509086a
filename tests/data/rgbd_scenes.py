"""Synthetic RGB-D scenes as files of every layout, each written by means other than the package's own."""

from __future__ import annotations

import json

import numpy as np
from PIL import Image

from tests.data.light_field_files import write_pfm

FOCAL, BASELINE_MM, OFFSET = 1234.5, 178.25, 23.75


def picture(size=(37, 52), seed=0):
    """``(H, W, 3)`` uint8."""
    return np.random.default_rng(seed).integers(0, 256, (*size, 3), dtype=np.uint8)


def disparities(size=(37, 52)):
    """``(H, W)`` float32 from 20 to 90 px, with an unknown one."""
    values = np.random.default_rng(1).uniform(20, 90, size).astype(np.float32)
    values[3, 4] = np.inf
    return values


def write_picture(path, pixels):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path)


def middlebury_2014(folder, size=(37, 52), without=()):
    write_picture(folder / "im0.png", picture(size))
    write_pfm(folder / "disp0.pfm", disparities(size))
    lines = {
        "cam0": f"[{FOCAL} 0 311.193; 0 {FOCAL} 254.877; 0 0 1]",
        "cam1": f"[{FOCAL} 0 342.279; 0 {FOCAL} 254.877; 0 0 1]",
        "doffs": OFFSET,
        "baseline": BASELINE_MM,
        "width": size[1],
    }
    (folder / "calib.txt").write_text("".join(f"{k}={v}\n" for k, v in lines.items() if k not in without))
    return folder


def hole_filled(folder, size=(110, 141), scene="art"):
    """Middlebury 2005 with a map that covers the centre down to multiples of 32; the bottom right of it is unknown."""
    inner = [n // 32 * 32 for n in size]
    disparity = np.random.default_rng(2).integers(60, 200, inner, dtype=np.uint8)
    disparity[-1, -1] = 0
    write_picture(folder / f"{scene}_rgb.png", picture(size))
    write_picture(folder / f"{scene}_disp.png", disparity)
    return folder / scene, disparity


def millimetres(size=(40, 60)):
    values = np.random.default_rng(3).integers(500, 9000, size, dtype=np.uint16)
    values[0, :5] = 0
    return values


def nyuv2(folder, frame="00007", size=(40, 60), border=0):
    pixels = picture(size)
    if border:
        inside = np.zeros(size, bool)
        inside[border:-border, border:-border] = True
        pixels[~inside] = 250
    write_picture(folder / f"rgb_{frame}.png", pixels)
    write_picture(folder / f"sync_depth_{frame}.png", millimetres(size))
    return folder / frame


def open3d(folder, frame="3", size=(40, 60), camera=True):
    write_picture(folder / f"room_color_{frame}.png", picture(size))
    write_picture(folder / f"room_depth_{frame}.png", millimetres(size))
    if camera:
        matrix = [525.5, 0, 0, 0, 524.5, 0, 319.5, 239.5, 1]
        (folder / "camera_primesense.json").write_text(json.dumps({"width": size[1], "intrinsic_matrix": matrix}))
    return folder / frame
