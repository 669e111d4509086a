"""A prototype that exists on paper only: mask, captures and their files."""

from __future__ import annotations

import numpy as np
import scipy.io
import yaml
from scipy.ndimage import gaussian_filter, zoom

from tmca.lab.prototype import load_prototype

NM = [500.0, 510.0, 525.0, 545.0]
STEP = 2
DESCRIBED = {
    "kind": "single-disperser", "device": "paper", "capture_key": "y", "mask_key": "mask", "wavelengths_nm": NM,
    "pixels_per_band": STEP, "response": "bandwidth", "black": 0.1, "white": 0.9,
    "scenes": {"capture": "a plain"}, "points": {"capture": {"middle": [20, 21]}},
}  # fmt: skip
SHUTTERED = {
    "kind": "pixel-shutter", "device": "paper", "black": 10, "white": 250,
    "captures": {"one": {"capture_key": "a", "shutter_key": "s"}},
}  # fmt: skip


def prototype_of(folder, described, **changes):
    """A prototype of a description, which lies in the folder as bench.yaml."""
    (folder / "bench.yaml").write_text(yaml.safe_dump({**described, **changes}))
    return load_prototype(folder / "bench.yaml")


def mask_of(height, width, seed=0):
    """A mask whose pixels are two pixels of the sensor wide, as lithographic ones are."""
    coarse = np.random.default_rng(seed).random((height // 2 + 1, width // 2 + 1)) > 0.5
    return gaussian_filter(zoom(coarse.astype(float), 2, order=0)[:height, :width], 0.5)


def smooth_scene(bands, height, width, seed=1):
    """(L, H, W) bright everywhere, slow in space."""
    rng = np.random.default_rng(seed)
    return 0.5 + 0.4 * np.stack([np.tanh(8 * gaussian_filter(rng.standard_normal((height, width)), 20))] * bands)


def captured(scene, mask, step=STEP):
    """(H, W + (L-1)·step) by a slow loop over bands."""
    bands, height, width = scene.shape
    out = np.zeros((height, width + step * (bands - 1)))
    for band in range(bands):
        out[:, band * step : band * step + width] += mask * scene[band]
    return out


def write_mat(path, **arrays):
    scipy.io.savemat(path, arrays)
    return path
