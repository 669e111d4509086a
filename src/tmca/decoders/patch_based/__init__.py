"""Decoders by priors of small blocks of the scene."""
