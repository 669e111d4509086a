"""Colour PNG of 16 bits a channel, which Pillow on its own reduces to 8."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_HIGH, _LOW = ";16B", ";16L"
"""Pillow's raw modes that keep the first and the second byte of every 16-bit sample."""


def sixteen_bit_colour(file: Path) -> NDArray[np.uint16] | None:
    """The pixels ``(H, W, channels)`` of a 16-bit colour PNG, None for any other picture.

    The library decodes twice, once for each byte of a sample; PNG keeps the high one first.

    Raises:
        OSError, SyntaxError, ValueError: as Pillow does for a broken picture.
    """
    from PIL import Image

    with Image.open(file) as image:
        raw = str(image.tile[0].args) if image.format == "PNG" and image.tile else ""
        if not raw.endswith(_HIGH) or image.mode not in ("RGB", "RGBA", "LA"):
            return None
    high, low = (_decoded(file, raw.removesuffix(_HIGH) + byte) for byte in (_HIGH, _LOW))
    return np.asarray((high.astype(np.uint16) << 8) | low, dtype=np.uint16)


def _decoded(file: Path, raw: str) -> NDArray[Any]:
    from PIL import Image

    with Image.open(file) as image:
        image.tile = [image.tile[0]._replace(args=raw)]
        image.load()
        return np.asarray(image)
