"""Codes, optics, operator and sensor joined into cameras."""

from tmca.cameras.spectral import SpectralCamera

__all__ = ["SpectralCamera"]
