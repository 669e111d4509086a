"""Frames that the steps of a calibration need, taken by a bench."""
