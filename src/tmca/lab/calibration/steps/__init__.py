"""The steps of a calibration: frames and what was measured before go in, a part comes out."""
