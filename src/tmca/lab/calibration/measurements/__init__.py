"""What captures tell of a bench: each measurement by itself, with its residuals; no file, no folder."""
