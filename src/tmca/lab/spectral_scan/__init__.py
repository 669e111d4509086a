"""Spectra by scanning: frames under a tunable source, made into reflectance and held against a spectrometer."""

from tmca.lab.spectral_scan.comparison import Comparison, compare_spectra
from tmca.lab.spectral_scan.reflectance import measure_reflectance
from tmca.lab.spectral_scan.scan import Scan, read_scan
from tmca.lab.spectral_scan.spectra_files import Spectra, read_spectra

__all__ = ["Comparison", "Scan", "Spectra", "compare_spectra", "measure_reflectance", "read_scan", "read_spectra"]
