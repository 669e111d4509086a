"""Codes, optics, operator and sensor joined into cameras."""
