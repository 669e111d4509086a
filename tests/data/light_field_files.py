"""Synthetic light fields as files of every format, each written by means other than the package's own."""

from __future__ import annotations

import struct
import zlib

import numpy as np
from PIL import Image


def shifted_plane(side=5, size=(40, 48), step=1, seed=0):
    """``(side, side, H, W)`` uint8: a fronto-parallel plane at ``step`` px per view, in the package's orientation."""
    margin = abs(step) * side
    wide = np.random.default_rng(seed).integers(0, 256, [n + 2 * margin for n in size], dtype=np.uint8)
    half = side // 2
    return np.stack(
        [
            np.stack([crop(wide, margin + (v - half) * step, margin + (u - half) * step, size) for u in range(side)])
            for v in range(side)
        ]
    )


def crop(wide, top, left, size):
    return wide[top : top + size[0], left : left + size[1]]


def write_folder(folder, views, name):
    """One picture per view; ``name(v, u)`` is its file name."""
    folder.mkdir(exist_ok=True)
    for v, row in enumerate(views):
        for u, view in enumerate(row):
            Image.fromarray(view).save(folder / name(v, u))
    return folder


def hci_name(side):
    return lambda v, u: f"input_Cam{v * side + u:03d}.png"


def write_parameters(folder, side=5, size=(40, 48), without=()):
    keys = {
        "focal_length_mm": 100.0,
        "image_resolution_x_px": size[1],
        "image_resolution_y_px": size[0],
        "sensor_size_mm": 35.0,
    }
    outer = {"num_cams_x": side, "num_cams_y": side, "baseline_mm": 50.0, "focus_distance_m": 10.0}
    sections = {"intrinsics": keys, "extrinsics": outer, "meta": {"scene": "plane", "disp_min": -1.5}}
    lines = []
    for section, values in sections.items():
        lines += [f"[{section}]", *(f"{k} = {v}" for k, v in values.items() if k not in without)]
    (folder / "parameters.cfg").write_text("\n".join(lines))


def write_pfm(path, values, endian="<"):
    """Bottom row first; a negative scale says little-endian."""
    scale = b"-1.0" if endian == "<" else b"1.0"
    rows = np.ascontiguousarray(values[::-1], dtype=f"{endian}f4").tobytes()
    path.write_bytes(b"Pf\n%d %d\n%s\n" % (values.shape[1], values.shape[0], scale) + rows)
    return path


def write_png16(path, pixels):
    """A 16-bit RGB PNG ``(H, W, 3)``, its rows filtered by each of the format's five filters in turn."""
    height, width, _ = pixels.shape
    rows = pixels.astype(">u2").reshape(height, -1).view(np.uint8).reshape(height, -1).astype(int)
    lines, above = [], np.zeros(rows.shape[1], dtype=int)
    for number, row in enumerate(rows):
        left, corner = np.r_[np.zeros(6, int), row[:-6]], np.r_[np.zeros(6, int), above[:-6]]
        guess = left + above - corner
        near = np.stack([abs(guess - left), abs(guess - above), abs(guess - corner)]).argmin(axis=0)
        paeth = np.choose(near, [left, above, corner])
        kind = number % 5
        predicted = [0, left, above, (left + above) // 2, paeth][kind]
        lines.append(bytes([kind]) + ((row - predicted) % 256).astype(np.uint8).tobytes())
        above = row
    header = struct.pack(">IIBBBBB", width, height, 16, 2, 0, 0, 0)
    parts = ((b"IHDR", header), (b"IDAT", zlib.compress(b"".join(lines))), (b"IEND", b""))
    chunks = (struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in parts)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(chunks))
    return path
