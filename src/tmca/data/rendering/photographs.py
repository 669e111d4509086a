"""The photographs behind the rendered scenes: all ship with scikit-image, none is downloaded."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tmca.data.depth_maps import disparity_to_depth
from tmca.data.formats.rgbd_files import MOTORCYCLE
from tmca.data.pixels import decoded
from tmca.errors import DataError, SettingError, did_you_mean

Array = NDArray[np.float32]

WHITE = 0.9
"""Reflectance given to a photograph's white: the brightest real surfaces reflect about this much."""


@dataclass(frozen=True)
class Photograph:
    """One photograph of scikit-image and how it is staged.

    Args:
        source: name of the function in ``skimage.data``.
        split: whether a prior or a decoder may learn from it.
        illuminant: name in colour-science's ``SDS_ILLUMINANTS``.
        near, far: range of the depth map in metres.
        depth: where the depth map comes from.
        credit: photographer and licence.
    """

    source: str
    split: Literal["train", "test"]
    illuminant: str
    near: float
    far: float
    depth: Literal["rendered", "measured"]
    credit: str


PHOTOGRAPHS = {
    "astronaut": Photograph("astronaut", "train", "D65", 0.8, 2.0, "rendered", "NASA, public domain: Eileen Collins"),
    "chelsea": Photograph("chelsea", "train", "LED-B3", 0.4, 1.2, "rendered", "Stefan van der Walt, CC0"),
    "rocket": Photograph("rocket", "train", "D55", 0.6, 2.0, "rendered", "SpaceX, public domain"),
    "retina": Photograph("retina", "train", "D50", 0.4, 0.8, "rendered", "Mikael Häggström, CC0"),
    "tissue": Photograph(
        "immunohistochemistry",
        "train",
        "A",
        0.4,
        0.8,
        "rendered",
        "Center for Microscopy And Molecular Imaging (CMMI), no known copyright restrictions",
    ),
    "coffee": Photograph("coffee", "test", "A", 0.4, 0.9, "rendered", "Rachel Michetti, Pikolo Espresso Bar, CC0"),
    "motorcycle": Photograph(
        "stereo_motorcycle",
        "test",
        "D65",
        2.0,
        5.1,
        "measured",
        "Middlebury Stereo 2014, Scharstein et al., GCPR 2014, for research use",
    ),
}


def photograph(name: str) -> Photograph:
    """The entry of the catalogue.

    Raises:
        SettingError: there is no such scene.
    """
    if name not in PHOTOGRAPHS:
        raise SettingError("name", repr(name), "a rendered scene", f"choose one of {', '.join(PHOTOGRAPHS)}")
    return PHOTOGRAPHS[name]


def rendered_names() -> tuple[str, ...]:
    """Names of the scenes that :func:`rendered_scene` renders, training scenes first."""
    return tuple(PHOTOGRAPHS)


def is_rendered(source: object) -> bool:
    """Whether this is the name of a rendered scene, and not of a file."""
    return str(source) in PHOTOGRAPHS and not Path(str(source)).exists()


def no_such_scene(source: object) -> DataError:
    """The error for what is neither a file nor a rendered scene."""
    name, _, seed = str(source).partition(":")
    if seed and name in PHOTOGRAPHS:
        return DataError(source, f"the seed {seed}, which rendered light fields alone have", f"a path, or {name}")
    expected = f"a path, or one of {', '.join(PHOTOGRAPHS)}"
    remedy = did_you_mean(str(source), PHOTOGRAPHS, "check the path or the name")
    return DataError(source, "no such file, folder or rendered scene", expected, remedy)


def split_rendered() -> dict[str, tuple[str, ...]]:
    """``{"train": names, "test": names}``.

    Test scenes are made of measured reflectances that no training scene contains; ``motorcycle`` has a
    measured depth map. Nothing should be learned from them.
    """
    return {
        part: tuple(name for name, entry in PHOTOGRAPHS.items() if entry.split == part) for part in ("train", "test")
    }


@lru_cache(maxsize=2)
def linear_rgb(name: str) -> Array:
    """The photograph ``(H, W, 3)`` in linear sRGB, white at reflectance ``WHITE``; large ones are halved."""
    import skimage.data

    pixels = getattr(skimage.data, photograph(name).source)()
    pixels = (pixels[0] if isinstance(pixels, tuple) else pixels)[..., :3]
    linear = decoded(pixels.astype(np.float32) / 255)
    while max(linear.shape[:2]) > 1000:
        even = linear[: linear.shape[0] // 2 * 2, : linear.shape[1] // 2 * 2]
        linear = np.float32(0.25) * (even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2])
    linear = np.asarray(WHITE * linear, dtype=np.float32)
    linear.flags.writeable = False
    return linear


def motorcycle_depth() -> NDArray[np.float32]:
    """Measured depth ``(500, 741)`` in metres, ``Z = f B / (d + Δcx)``; unknown disparities give ``nan``.

    Source: Middlebury Stereo 2014 (Scharstein et al.), calibration as given with scikit-image's copy.
    """
    import skimage.data

    return disparity_to_depth(skimage.data.stereo_motorcycle()[2], *MOTORCYCLE[:3]).astype(np.float32)


def staged_depth(
    rgb: NDArray[np.float32], labels: NDArray[np.intp], near: float, far: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """A plausible depth map ``(H, W)`` in metres from ``near`` to ``far``.

    Each region is a tilted plane, the lower in the picture the nearer, at its own distance, with a faint
    relief that follows the brightness. It is drawn, not measured: it has the edges and slopes of real depth,
    but tells nothing about the place that was photographed.

    Args:
        rgb: ``(H, W, 3)``.
        labels: ``(H, W)``, coarse regions numbered from 0.
        near, far: the range of depth in metres; both are reached.
        rng: draws distances and tilts.
    """
    from scipy.ndimage import gaussian_filter

    height, width = labels.shape
    rows, columns = (axis / size for axis, size in zip(np.mgrid[:height, :width], (height, width), strict=True))
    count = int(labels.max()) + 1
    area = np.bincount(labels.ravel(), minlength=count)
    row, column = (np.bincount(labels.ravel(), axis.ravel(), count) / area for axis in (rows, columns))
    level = 0.5 * row + 0.2 * rng.random(count)
    tilt = rng.normal((0.35, 0.0), (0.15, 0.15), size=(count, 2))
    relief = gaussian_filter(rgb.mean(axis=-1), 2)
    nearness = level[labels] + 0.1 * (relief - relief.mean())
    nearness += tilt[labels, 0] * (rows - row[labels]) + tilt[labels, 1] * (columns - column[labels])
    nearness = (nearness - nearness.min()) / np.ptp(nearness)
    inverse = 1 / far + nearness * (1 / near - 1 / far)
    return (1 / inverse).astype(np.float32)
