"""From irradiance to digital numbers: colour filters, noise, full well, bits."""

from tmca.sensor.colour import (
    FILTERS,
    ColourCodedAperture,
    band_wavelengths,
    channel_response,
    channel_weights,
    feasible_filters,
)
from tmca.sensor.sensor import Noise, Sensor, SensorWarning, quantise, shot_noise

__all__ = [
    "FILTERS",
    "ColourCodedAperture",
    "Noise",
    "Sensor",
    "SensorWarning",
    "band_wavelengths",
    "channel_response",
    "channel_weights",
    "feasible_filters",
    "quantise",
    "shot_noise",
]


def __dir__() -> list[str]:
    return sorted(__all__)
