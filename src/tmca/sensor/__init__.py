"""From irradiance to digital numbers: colour filters, noise, full well, bits."""

from tmca.sensor.colour import FILTERS, ColourCodedAperture, channel_response, feasible_filters
from tmca.sensor.noise import Noise, quantise, shot_noise
from tmca.sensor.sensor import Sensor

__all__ = [
    "FILTERS",
    "ColourCodedAperture",
    "Noise",
    "Sensor",
    "channel_response",
    "feasible_filters",
    "quantise",
    "shot_noise",
]
