"""Light between scene and sensor: dispersion, view shear, blur, phase masks and their point spread functions."""

from tmca.optics.depth import DepthPlanes
from tmca.optics.dispersion import Dispersion
from tmca.optics.heights import FreeForm, HeightMaps, RotationalProfile, Stroke, ZernikeHeights, fresnel_lens
from tmca.optics.light_field import MaskGeometry, ViewShear, shear_step, view_coordinates, view_grid
from tmca.optics.mask_checks import StrayLight, check_mask, steep_share, stray_light
from tmca.optics.mask_families import FAMILIES, MODES, family_parameters, mask_heights, restored_maps
from tmca.optics.materials import MATERIALS, Material
from tmca.optics.point_spread import PointSpread
from tmca.optics.propagation import AngularSpectrum, FocalPlane, Undersampled
from tmca.optics.relay import gaussian_spread
from tmca.optics.spectral_depth import PhaseMaskBench, changed_bench

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
    "family_parameters",
    "fresnel_lens",
    "gaussian_spread",
    "mask_heights",
    "restored_maps",
    "shear_step",
    "steep_share",
    "stray_light",
    "view_coordinates",
    "view_grid",
]
