"""Named spectral cameras."""

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
