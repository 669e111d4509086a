"""Gaussian and Gaussian-mixture priors of small scene blocks."""
