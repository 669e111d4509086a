"""What stands in files: one module per family of formats, all giving the same ``Contents``."""
