"""Files of dual blind deconvolution."""
