"""Photographs: what the engine renders, by the name of one that ships with scikit-image or the path of one's own."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal
from warnings import warn
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from tmca.data.depth_maps import disparity_to_depth
from tmca.data.formats.rgbd_files import MOTORCYCLE
from tmca.data.in_memory import SceneWarning
from tmca.data.pixels import decoded
from tmca.data.rendering.own import Stamp, is_grey, pixels_of, stamp_of
from tmca.errors import DataError, SettingError, check_range, did_you_mean

Array = NDArray[np.float32]

WHITE = 0.9
"""Reflectance given to a photograph's white: the brightest real surfaces reflect about this much."""
_LARGEST, _SMALLEST = 1000, 32
"""Pixels: a longer side is halved, as long as the shorter one keeps this many."""
_LIGHTS = ("D65", "D50", "D55", "E", "A", "LED-B2", "LED-B3", "FL2")
"""Illuminants of photographs of one's own: daylight, even light, incandescent, white LEDs and tubes."""


class GreyPhotograph(SceneWarning):
    """A photograph without colours, whose spectra are those of grey materials."""


@dataclass(frozen=True)
class Photograph:
    """One photograph and how it is staged.

    Args:
        name: of the scene.
        source: ``skimage.data.FUNCTION``, or the path of a file.
        split: whether a prior or a decoder may learn from it; also which half of the measured reflectances it gets.
        illuminant: name in colour-science's ``SDS_ILLUMINANTS``.
        near, far: range of the depth map in metres.
        depth: where the depth map comes from.
        credit: photographer and licence.
        content: checksum of a file's pixels; empty without a file.
        stamp: of the file when it was looked at.
    """

    name: str
    source: str
    split: Literal["train", "test"]
    illuminant: str
    near: float
    far: float
    depth: Literal["rendered", "measured"] = "rendered"
    credit: str = ""
    content: str = ""
    stamp: Stamp | None = None

    @property
    def key(self) -> str:
        """What its random numbers belong to, beside the seed."""
        return self.content or self.name


_CATALOGUE = (
    Photograph("astronaut", "skimage.data.astronaut", "train", "D65", 0.8, 2.0,
               credit="NASA, public domain: Eileen Collins"),
    Photograph("chelsea", "skimage.data.chelsea", "train", "LED-B3", 0.4, 1.2, credit="Stefan van der Walt, CC0"),
    Photograph("rocket", "skimage.data.rocket", "train", "D55", 0.6, 2.0, credit="SpaceX, public domain"),
    Photograph("retina", "skimage.data.retina", "train", "D50", 0.4, 0.8, credit="Mikael Häggström, CC0"),
    Photograph("tissue", "skimage.data.immunohistochemistry", "train", "A", 0.4, 0.8, credit="Center for Microscopy"
               " And Molecular Imaging (CMMI), no known copyright restrictions"),
    Photograph("coffee", "skimage.data.coffee", "test", "A", 0.4, 0.9,
               credit="Rachel Michetti, Pikolo Espresso Bar, CC0"),
    Photograph("motorcycle", "skimage.data.stereo_motorcycle", "test", "D65", 2.0, 5.1, "measured",
               "Middlebury Stereo 2014, Scharstein et al., GCPR 2014, for research use"),
)  # fmt: skip
PHOTOGRAPHS = {entry.name: entry for entry in _CATALOGUE}


def photograph(source: str | Path, seed: int = 0) -> Photograph:
    """The photograph of a name or a path.

    Illuminant and depth range of a file are drawn by its content and the seed; named ones have their own.

    Raises:
        SettingError: no such name, or a seed that is not a whole number from 0.
        DataError: no such file, or one that is no picture of 32×32 pixels or more.

    Warns:
        GreyPhotograph: a picture without colours.
    """
    if str(source) in PHOTOGRAPHS:
        return PHOTOGRAPHS[str(source)]
    path = Path(source)
    if not path.exists() and not path.suffix and len(path.parts) < 2:
        remedy = f"choose one of {', '.join(PHOTOGRAPHS)}"
        raise SettingError("name", repr(str(source)), "a rendered scene or the path of a photograph", remedy)
    stamp = stamp_of(path)
    _, content, grey = _of_file(path, stamp)
    if grey:
        warn(
            f"{path}: a picture without colours, so its spectra are those of grey things", GreyPhotograph, stacklevel=3
        )
    rng = generator(crc32(f"staging {content}".encode()), seed)
    near = float(rng.uniform(0.4, 1.0))
    far, light = near * float(rng.uniform(1.8, 3.0)), str(rng.choice(_LIGHTS))
    return Photograph(path.stem, str(path), "train", light, near, far, content=content, stamp=stamp)


def generator(key: int, seed: int) -> np.random.Generator:
    """Random numbers of their own for every picture (its ``key``) and seed.

    Raises:
        SettingError: a seed that is not a whole number from 0.
    """
    check_range("seed", seed, 0, whole=True)
    return np.random.default_rng([key, int(seed)])


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


def linear_rgb(entry: Photograph) -> Array:
    """The photograph ``(H, W, 3)`` in linear sRGB, white at reflectance ``WHITE``; large ones are halved."""
    return _of_skimage(entry.source) if entry.stamp is None else _of_file(Path(entry.source), entry.stamp)[0]


@lru_cache(maxsize=2)
def _of_skimage(source: str) -> Array:
    import skimage.data

    pixels = getattr(skimage.data, source.removeprefix("skimage.data."))()
    pixels = (pixels[0] if isinstance(pixels, tuple) else pixels)[..., :3]
    return _reflectance(pixels.astype(np.float32) / 255)


@lru_cache(maxsize=2)
def _of_file(path: Path, stamp: Stamp) -> tuple[Array, str, bool]:
    """A file's photograph, the checksum of its pixels, and whether these are grey; ``stamp`` tells files apart."""
    pixels = pixels_of(path)
    check_photograph(path, pixels.shape[:2])
    return _reflectance(pixels), f"{crc32(pixels.tobytes()):08x}", is_grey(pixels)


def check_photograph(path: Path, shape: tuple[int, int], size: tuple[int, int] | None = None) -> None:
    """Refuse a picture (H, W) that is too small to be rendered, or to be rendered at a size."""
    least = size or (_SMALLEST, _SMALLEST)
    height, width = rendered_size(*shape)
    if min(shape) < _SMALLEST or height < least[0] or width < least[1]:
        halved = f", {height}×{width} when halved" if (height, width) != shape else ""
        found = f"a picture of {shape[0]}×{shape[1]} pixels{halved}"
        raise DataError(path, found, f"{least[0]}×{least[1]} or more", "take a larger one, or a smaller size")


def rendered_size(height: int, width: int) -> tuple[int, int]:
    """Rows and columns of a photograph as it is rendered: halved while a side is too long."""
    while max(height, width) > _LARGEST and min(height, width) >= 2 * _SMALLEST:
        height, width = height // 2, width // 2
    return height, width


def _reflectance(stored: Array) -> Array:
    """Linear reflectance of sRGB values in [0, 1], at the size that is rendered."""
    linear = decoded(stored)
    while linear.shape[:2] != rendered_size(*linear.shape[:2]):
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
