"""Light between the mask and the sensor: dispersion and blur."""

from tmca.optics.dispersion import Dispersion
from tmca.optics.relay import gaussian_spread

__all__ = ["Dispersion", "gaussian_spread"]
