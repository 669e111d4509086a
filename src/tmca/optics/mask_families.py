"""Named height maps to start from: what a spectral-depth camera's phase mask shows in its K slots."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from tmca.errors import SettingError
from tmca.optics.heights import HIGHEST, FreeForm, HeightMaps, RotationalProfile, Stroke, ZernikeHeights, fresnel_lens
from tmca.optics.zernike import noll, noll_index, pupil_coordinates

if TYPE_CHECKING:
    from tmca.optics.spectral_depth import PhaseMaskBench

FAMILIES = ("flat", "zernike", "free-form", "rotational", "lens")
MODES = 18
"""Noll modes 4 to 21: those of a mirror with 40 actuators, less piston and tilts, which shift an image only."""
_RADII = 16


def mask_heights(
    family: str,
    slots: int,
    bench: PhaseMaskBench,
    *,
    rms: float = 0.1e-6,
    wavelength: float = 550e-9,
    modes: int = MODES,
    stroke: Stroke | None = None,
    seed: int = 0,
    learnable: bool = False,
) -> HeightMaps:
    """K height maps of a family, different in every slot where they are random.

    ``"flat"``: zero, free-form. ``"zernike"``: random modes from defocus on, as a deformable mirror shows them.
    ``"free-form"``: the same start, every pixel free. ``"rotational"``: random profiles over the radius. ``"lens"``: a
    Fresnel lens that focuses objects at infinity on the sensor, free-form.

    Args:
        family: one of ``FAMILIES``.
        slots: K.
        bench: size, pitch and material of the maps.
        rms: of random heights over the aperture, but for their mean, metres.
        wavelength: that ``"lens"`` focuses, metres.
        modes: number of Zernike modes, from Noll's fourth on.
        stroke: of the device.
        seed: of random maps.
        learnable: whether they are learned.

    Raises:
        SettingError: unknown family, no modes, a negative or huge rms, or a lens on a bench that has one.
    """
    if family not in FAMILIES:
        raise SettingError("mask", repr(family), f"one of {', '.join(FAMILIES)}")
    if family == "lens" and bench.focus is not None:
        known = f"one of {', '.join(FAMILIES[:-1])}"
        raise SettingError("mask", "a lens on a bench with a lens", known, "or set no focus, for a bench without")
    if slots < 1 or modes < 1 or not 0 <= rms <= HIGHEST:
        found = f"{slots} slots, {modes} modes, {rms:g} m rms"
        raise SettingError("mask", found, f"a slot and a mode or more, an rms of 0 to {HIGHEST:g} m")
    size, generator = bench.mask_size, torch.Generator().manual_seed(seed)
    if family == "flat":
        middle = 0.0 if stroke is None else min(max(0.0, stroke.low), stroke.high)
        return FreeForm(torch.full((slots, *size), middle), stroke, learnable=learnable)
    if family == "lens":
        heights = fresnel_lens(size, bench.mask_pitch, bench.distance, wavelength, bench.phase_material(), slots)
        return FreeForm(_within(heights, stroke), stroke, learnable=learnable)
    if family == "rotational":
        radii = 1e-6 * torch.randn(slots, _RADII, generator=generator)
        seen = RotationalProfile(radii, size).profile()[:, pupil_coordinates(size)[0] <= 1].std(1, correction=0)
        return RotationalProfile(radii * (rms / seen)[:, None], size, stroke=stroke, learnable=learnable)
    drawn = torch.randn(slots, modes, generator=generator)
    kept = ZernikeHeights(
        _of_rms(drawn, rms), [noll(4 + index) for index in range(modes)], size, stroke=stroke, learnable=learnable
    )
    if family == "zernike":
        return kept
    return FreeForm(_within(kept.profile().detach(), stroke), stroke, learnable=learnable)


def _within(heights: Tensor, stroke: Stroke | None) -> Tensor:
    """Start values of a family, cut at the ends of the device's stroke."""
    return heights if stroke is None else heights.clamp(stroke.low, stroke.high)


def _of_rms(values: Tensor, rms: float) -> Tensor:
    """Scaled so that every row has this norm: Zernike modes have unit variance, their squares add up."""
    return values * (rms / values.norm(dim=-1, keepdim=True))


def family_parameters(maps: HeightMaps) -> dict[str, Tensor]:
    """What a family's maps are made of, to be kept beside them; nothing of free-form maps.

    Returns:
        ``coefficients`` (K, M) in metres rms and ``noll`` (M,) of Zernike modes, or ``radii`` (K, R) in metres.
    """
    if isinstance(maps, ZernikeHeights) and maps.diameter is None:
        places = torch.tensor([noll_index(mode) for mode in maps.modes])
        return {"coefficients": maps.metres().detach(), "noll": places}
    if isinstance(maps, RotationalProfile) and maps.diameter is None:
        return {"radii": maps.metres().detach()}
    return {}


def restored_maps(heights: Tensor, parameters: Mapping[str, Tensor], stroke: Stroke | None = None) -> HeightMaps:
    """Maps of the family that ``family_parameters`` described, free-form without.

    Args:
        heights: (K, H, W) metres, as shown.
        parameters: of the family.
        stroke: of the device.

    Raises:
        ShapeError, SettingError: parameters that make no or other maps, or heights beyond the stroke.
    """
    size, maps = (heights.shape[-2], heights.shape[-1]), FreeForm(heights, stroke)
    if "coefficients" in parameters:
        modes = [noll(int(index)) for index in parameters["noll"]]
        family: HeightMaps = ZernikeHeights(parameters["coefficients"], modes, size, stroke=stroke)
    elif "radii" in parameters:
        family = RotationalProfile(parameters["radii"], size, stroke=stroke)
    else:
        return maps
    if family().shape != heights.shape or not torch.allclose(family(), maps(), rtol=1e-4, atol=1e-9):
        raise SettingError("heights", "others than their modes or radii make", "the same", "leave modes and radii out")
    return family
