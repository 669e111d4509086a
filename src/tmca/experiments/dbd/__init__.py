"""Phase transitions of dual blind deconvolution."""
