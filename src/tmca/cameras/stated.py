"""What files say of cameras: models of their attributes, of their types, finite and in bounds."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, Json

from tmca.attributes import Attributes
from tmca.errors import DataError
from tmca.optics import DepthPlanes, PhaseMaskBench, Stroke

MOST_PIXELS = 2**24
"""Pixels of the frame over which codes of a file repeat: the file itself holds one tile of them."""
MOST_SAMPLES = 2**28
"""Samples of point spread functions, which no array of a file is as large as."""
_Side = Annotated[int, Field(ge=1, le=2**16)]
Pair = tuple[_Side, _Side]
"""Rows and columns."""
_Blur = Annotated[float, Field(ge=0, le=1000)]


class CameraAttributes(Attributes):
    """Of any camera."""

    exposure: str
    full_scale: float = Field(gt=0)
    sensor: Json[dict[str, Any]]
    """Arguments of `Sensor`, which checks them."""
    buckets: Annotated[int, Field(ge=1, le=256)] = 1
    size: Json[Pair] | None = None
    """Of the frame over which codes repeat."""


def check_frame(size: tuple[int, int] | None, where: str) -> None:
    """Raises DataError for a frame (H, W) that no tile of a file is for."""
    if size is not None and size[0] * size[1] > MOST_PIXELS:
        found = f"size {size[0]}×{size[1]}"
        raise DataError(where, found, f"at most {MOST_PIXELS} pixels", "correct the attribute size")


class CodedAttributes(CameraAttributes):
    """Of a camera with an aperture and a shutter."""

    period: Json[Pair | None] = None


class SpectralAttributes(CodedAttributes):
    """Of the spectral camera."""

    disperser: str
    dispersion_axis: Literal["x"] = "x"
    origin: float
    relay_blur: Json[_Blur | tuple[_Blur, ...]] = 0.0
    beside: Json[tuple[int, int]] = (0, 0)


class LightFieldAttributes(CodedAttributes):
    """Of the light-field camera."""

    shear: Json[float | tuple[float, float]] = 1.0
    mask_scale: float


class PhaseAttributes(Attributes):
    """Of masks and shutter of the spectral-depth camera, which any bands may have."""

    bench: Json[PhaseMaskBench]
    depth: Json[DepthPlanes]
    energy: str
    exposure: str
    stroke: Json[Stroke | None] = None


class SpectralDepthAttributes(CameraAttributes, PhaseAttributes):
    """Of the spectral-depth camera."""

    image_formation: str = "linear"


class PhaseCodesAttributes(PhaseAttributes):
    """Of a file of its codes: filters and channels by their names."""

    filters: str
    channels: str


def check_optics(stated: PhaseAttributes, mask: tuple[int, ...], bands: int, where: str) -> None:
    """Whether the optics that attributes state are those of masks (K, H, W), and no larger than can be computed.

    Raises:
        DataError: another side of the masks, or more samples than `MOST_SAMPLES`.
    """
    bench, remedy = stated.bench, "correct the attribute bench or depth"
    if mask[1:] != bench.mask_size:
        found = f"masks of {'×'.join(map(str, mask[1:]))} pixels"
        raise DataError(where, found, f"{bench.mask_pixels}×{bench.mask_pixels}, as its bench says", remedy)
    height, width = bench.window
    fine = max(height, width) * bench.oversampling * max(height, width, bench.mask_pixels) * bench.oversampling
    samples = max(fine, stated.depth.count * bands * max(mask[0] * height * width, bench.mask_pixels**2))
    if samples > MOST_SAMPLES:
        found = f"point spread functions of {float(samples):.3g} samples"
        raise DataError(where, found, f"at most {MOST_SAMPLES}", remedy)
