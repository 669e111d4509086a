"""Light between the mask and the sensor: dispersion and blur."""
