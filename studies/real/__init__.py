"""Captures of real prototypes: decoded, judged without a truth, and reported."""
