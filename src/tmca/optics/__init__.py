"""Light between scene and sensor: dispersion, view shear, blur, phase masks and their point spread functions."""

from tmca.optics.heights import (
    FreeForm,
    HeightMaps,
    RotationalProfile,
    Stroke,
    ZernikeHeights,
    family_parameters,
    restored_maps,
)
from tmca.optics.light_field import MaskGeometry, ViewShear, view_coordinates, view_grid
from tmca.optics.named_masks import FAMILIES, MODES, mask_heights, mask_maps
from tmca.optics.phase import MATERIALS, Material
from tmca.optics.point_spread import (
    AngularSpectrum,
    FocalPlane,
    PointSpread,
    StrayLight,
    Undersampled,
    check_mask,
    steep_share,
    stray_light,
)
from tmca.optics.spectral import Dispersion, gaussian_psf
from tmca.optics.spectral_depth import DepthPlanes, PhaseAttributes, PhaseMaskBench, changed_bench, check_stated

__all__ = [
    "FAMILIES",
    "MATERIALS",
    "MODES",
    "AngularSpectrum",
    "DepthPlanes",
    "Dispersion",
    "FocalPlane",
    "FreeForm",
    "HeightMaps",
    "MaskGeometry",
    "Material",
    "PhaseAttributes",
    "PhaseMaskBench",
    "PointSpread",
    "RotationalProfile",
    "StrayLight",
    "Stroke",
    "Undersampled",
    "ViewShear",
    "ZernikeHeights",
    "changed_bench",
    "check_mask",
    "check_stated",
    "family_parameters",
    "gaussian_psf",
    "mask_heights",
    "mask_maps",
    "restored_maps",
    "steep_share",
    "stray_light",
    "view_coordinates",
    "view_grid",
]


def __dir__() -> list[str]:
    return sorted(__all__)
