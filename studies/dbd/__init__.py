"""Dual blind deconvolution: how often recoveries succeed, and the page of its results."""
