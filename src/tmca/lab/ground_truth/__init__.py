"""Ground truth of spectra and depth."""
