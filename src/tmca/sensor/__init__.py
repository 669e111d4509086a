"""From irradiance to digital numbers: noise, full well, bits."""

from tmca.sensor.noise import Noise, quantise, shot_noise
from tmca.sensor.sensor import Sensor

__all__ = ["Noise", "Sensor", "quantise", "shot_noise"]
