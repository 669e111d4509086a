"""Phase masks to start from, by their names."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from tmca.errors import SettingError, check_choice, check_range, check_shape
from tmca.optics.heights import HIGHEST, FreeForm, HeightMaps, RotationalProfile, Stroke, ZernikeHeights
from tmca.optics.phase import pixel_places
from tmca.optics.spectral_depth import PhaseMaskBench
from tmca.optics.zernike import noll, pupil_coordinates

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
    check_choice("mask", family, FAMILIES)
    if family == "lens" and bench.focus is not None:
        remedy = "or set no focus, for a bench without"
        raise SettingError("mask", "a lens on a bench with a lens", f"one of {', '.join(FAMILIES[:-1])}", remedy)
    check_range("slots", slots, 1)
    check_range("modes", modes, 1)
    check_range("rms", rms, 0, HIGHEST, unit="m")
    size, generator = bench.mask_size, torch.Generator().manual_seed(seed)
    if family == "rotational":
        return RotationalProfile(_drawn_radii(slots, rms, size, generator), size, stroke, learnable=learnable)
    if family == "flat":
        heights = torch.zeros(slots, *size)
    elif family == "lens":
        heights = _fresnel_lens(bench, wavelength).expand(slots, -1, -1).clone()
    else:
        coefficients, indices = _drawn_modes(slots, modes, rms, generator), [noll(4 + n) for n in range(modes)]
        maps = ZernikeHeights(coefficients, indices, size, stroke, learnable=learnable)
        if family == "zernike":
            return maps
        heights = maps.profile().detach()
    heights = heights if stroke is None else heights.clamp(stroke.low, stroke.high)
    return FreeForm(heights, stroke, learnable=learnable)


def mask_maps(
    mask: str | Tensor | HeightMaps, slots: int, bench: PhaseMaskBench, *, learnable: bool, **drawn: Any
) -> HeightMaps:
    """Height maps of K slots on a bench: of a family, drawn as ``mask_heights`` does, or those that are given."""
    if isinstance(mask, str):
        return mask_heights(mask, slots, bench, learnable=learnable, **drawn)
    maps = mask if isinstance(mask, HeightMaps) else FreeForm(mask, drawn["stroke"], learnable=learnable)
    if learnable and not list(maps.parameters()):
        maps = maps.repeated(slots, learnable=True)
    check_shape("mask", maps(), (slots, *bench.mask_size))
    return maps


def _drawn_radii(slots: int, rms: float, size: tuple[int, int], generator: torch.Generator) -> Tensor:
    """(K, radii) heights over the radius."""
    radii = 1e-6 * torch.randn(slots, _RADII, generator=generator)
    shown = RotationalProfile(radii, size).profile()[:, pupil_coordinates(size)[0] <= 1].std(1, correction=0)
    return radii * (rms / shown)[:, None]


def _drawn_modes(slots: int, modes: int, rms: float, generator: torch.Generator) -> Tensor:
    """(K, modes) coefficients; modes have unit variance, and their squares add up."""
    drawn = torch.randn(slots, modes, generator=generator)
    return drawn * (rms / drawn.norm(dim=-1, keepdim=True))


def _fresnel_lens(bench: PhaseMaskBench, wavelength: float) -> Tensor:
    """(H, W) heights of a lens that focuses on the sensor, folded to one wavelength of path."""
    (y, x), material = pixel_places(bench.mask_size, bench.mask_pitch), bench.phase_material()
    path = bench.distance - torch.sqrt(bench.distance**2 + (y**2 + x**2))
    factor = 2.0 if material is None else float(material.index([wavelength])[0]) - 1
    return torch.remainder(path, wavelength) / factor
