"""Trained decoders, and their files."""
