"""Named cameras."""

from __future__ import annotations

from typing import Any

from tmca.optics import PhaseMaskBench

SPECTRAL: dict[str, dict[str, Any]] = {
    # thesis 4.1, 4.2: 12 bands, 256×256, K = 8, one pixel per band. Assumed, as the thesis does not say: bands from
    # 400 to 700 nm, flat sensor response, codes of transmittance and duty one half, no noise.
    "thesis": {
        "bands": 12,
        "size": (256, 256),
        "slots": 8,
        "aperture": "random",
        "shutter": "random",
        "dispersion": 1.0,
    },
    "cassi": {
        "bands": 12,
        "size": (256, 256),
        "slots": 1,
        "aperture": "static",
        "shutter": "open",
        "dispersion": 1.0,
    },
    "one-hot": {
        "bands": 12,
        "size": (256, 256),
        "slots": 4,
        "aperture": "random",
        "shutter": "one-hot",
        "dispersion": 1.0,
    },
}

LIGHT_FIELD: dict[str, dict[str, Any]] = {
    # thesis 3.2: 5×5 views of 480×270, K = 8. Assumed, as the thesis does not say: a mask of pitch (1-s)·p one mask
    # pixel per view from the sensor, no vignetting, codes of transmittance and duty one half, no noise.
    "thesis": {"views": 5, "size": (270, 480), "slots": 8, "aperture": "random", "shutter": "random", "shear": 1.0},
    # its static camera, compressive light-field photography (Marwah 2013)
    "clfp": {"views": 5, "size": (270, 480), "slots": 1, "aperture": "static", "shutter": "open", "shear": 1.0},
    "one-hot": {"views": 5, "size": (270, 480), "slots": 4, "aperture": "random", "shutter": "one-hot", "shear": 1.0},
    "quick": {"views": 5, "size": (96, 96), "slots": 4, "aperture": "random", "shutter": "one-hot", "shear": 1.0},
}

_THESIS_DEPTH: dict[str, Any] = {
    # thesis 5.2: 25 bands from 440 to 680 nm, K = 4, eight planes from 0.4 to 2.0 m, R = 4 filters, 256×256 patches.
    # Assumed, as the thesis does not say: a mirror in the pupil of a lens of 50 mm focused in the middle of the range,
    # an aperture of 3.5 mm, pixels of 8 µm, Q = 4, pass bands side by side as filters, a camera's RGB response, equal
    # exposure time, point spread functions of unit energy, dark around the patch, no noise.
    "bands": tuple((440 + 10 * band) * 1e-9 for band in range(25)),
    "size": (256, 256),
    "slots": 4,
    "depth": (0.4, 2.0),
    "planes": 8,
    "bench": PhaseMaskBench(diameter=3.5e-3, distance=50e-3, pitch=8e-6, window=(63, 63), mask_pixels=96),
    "mask": "zernike",
    "shutter": "random",
    "filters": "gaussian",
    "period": 4,
    "channels": "rgb",
}
_NOTHING_ELSE: dict[str, Any] = {"slots": 1, "shutter": "open", "filters": "clear"}
_QUICK_DEPTH: dict[str, Any] = {
    # a step of training takes about a second on a processor, less where codes are fixed
    "bands": tuple((440 + 240 / 7 * band) * 1e-9 for band in range(8)),
    "size": (96, 96),
    "bench": PhaseMaskBench(),
}

SPECTRAL_DEPTH: dict[str, dict[str, Any]] = {
    "thesis": _THESIS_DEPTH,
    # its baseline, a phase mask only (Baek 2021)
    "diffractive": {**_THESIS_DEPTH, **_NOTHING_ELSE},
    "quick": {**_THESIS_DEPTH, **_QUICK_DEPTH},
    "quick-diffractive": {**_THESIS_DEPTH, **_QUICK_DEPTH, **_NOTHING_ELSE},
}

PROBE = (512, 512)
"""Pixels of a spectral-depth camera that is only asked what it is, or whether it can be: any tile fits."""
