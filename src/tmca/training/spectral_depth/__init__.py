"""Training of the spectral-depth camera."""
