"""From irradiance to digital numbers: noise, full well, bits."""
