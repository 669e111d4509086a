"""Named cameras."""

from __future__ import annotations

from typing import Any

PRESETS: dict[str, dict[str, Any]] = {
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

LIGHT_FIELD_PRESETS: dict[str, dict[str, Any]] = {
    # thesis 3.2: 5×5 views of 480×270, K = 8. Assumed, as the thesis does not say: a mask of pitch (1-s)·p one mask
    # pixel per view from the sensor, no vignetting, codes of transmittance and duty one half, no noise.
    "thesis": {"views": 5, "size": (270, 480), "slots": 8, "aperture": "random", "shutter": "random", "shear": 1.0},
    # its static camera, compressive light-field photography (Marwah 2013)
    "clfp": {"views": 5, "size": (270, 480), "slots": 1, "aperture": "static", "shutter": "open", "shear": 1.0},
    "one-hot": {"views": 5, "size": (270, 480), "slots": 4, "aperture": "random", "shutter": "one-hot", "shear": 1.0},
    "quick": {"views": 5, "size": (96, 96), "slots": 4, "aperture": "random", "shutter": "one-hot", "shear": 1.0},
}
