"""Settings of cameras that can be written down: in files, on the command line, as axes of a sweep."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

Share = Field(0.5, ge=0, le=1)


class CameraSpec(BaseModel):
    """What every camera is told.

    Args:
        slots: time slots K within the exposure.
        exposure: ``"equal"``: the slots share one exposure time; ``"per-slot"``: each has its own.
        seed: of the codes.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    slots: int = Field(8, ge=1)
    exposure: Literal["equal", "per-slot"] = "equal"
    seed: int = Field(0, ge=0)


class CodedSpec(CameraSpec):
    """Codes of an aperture and a shutter.

    Args:
        aperture, shutter: families of codes (``tmca.codes.FAMILIES``), or files of patterns.
        transmittance, duty: shares of open pixels of the two.
        period: tile of the codes, pixels; full frame if None.
    """

    aperture: str = "random"
    shutter: str = "random"
    transmittance: float = Share
    duty: float = Share
    period: int | None = Field(None, ge=1)


class SpectralSpec(CodedSpec):
    """The spectral camera.

    Args:
        dispersion: pixels per band, or the displacement of every band, pixels.
        disperser: ``"single"`` or ``"dual"``.
        relay_blur: standard deviation, pixels.
    """

    dispersion: float | list[float] = 1.0
    disperser: Literal["single", "dual"] = "single"
    relay_blur: float = Field(0.0, ge=0)


class LightFieldSpec(CodedSpec):
    """The light-field camera.

    Args:
        shear: mask pixels per view, one number or along y and x.
        mask_scale: mask pixels per sensor pixel as the sensor sees them.
    """

    shear: float | tuple[float, float] = 1.0
    mask_scale: float = Field(1.0, gt=0)


class SpectralDepthSpec(CameraSpec):
    """The spectral-depth camera.

    Args:
        depth: nearest and farthest plane, metres.
        planes: number of depth planes.
        mask: family of the height maps (``tmca.optics.FAMILIES``), or a file of `tmca design spectral-depth`.
        rms: of random heights, metres.
        modes: number of Zernike modes of random heights.
        shutter: family of the shutter codes.
        filters: family of the feasible filters.
        period: tile of shutter and filters, pixels.
        channels: of the sensor: ``"monochrome"`` or ``"rgb"``.
        energy: of the point spread functions: ``"unit"`` or ``"aperture"``.
        image_formation: ``"linear"`` or ``"occlusion"``.
    """

    slots: int = Field(4, ge=1)
    depth: tuple[float, float] = (0.4, 2.0)
    planes: int = Field(8, ge=1)
    mask: str = "zernike"
    rms: float = Field(0.1e-6, ge=0)
    modes: int = Field(18, ge=1)
    shutter: str = "one-hot"
    filters: str = "clear"
    period: int = Field(4, ge=1)
    channels: str = "monochrome"
    energy: Literal["unit", "aperture"] = "unit"
    image_formation: Literal["linear", "occlusion"] = "linear"
