"""Light between the mask and the sensor: dispersion, view shear and blur."""

from tmca.optics.dispersion import Dispersion
from tmca.optics.light_field import MaskGeometry, ViewShear, view_coordinates, view_grid
from tmca.optics.relay import gaussian_spread

__all__ = ["Dispersion", "MaskGeometry", "ViewShear", "gaussian_spread", "view_coordinates", "view_grid"]
