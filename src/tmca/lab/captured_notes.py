"""Notes of snapshots that a bench captured."""

GAIN = "gain_per_digital_number"
"""Snapshot units of a digital number above the dark."""
DRIVER, SIMULATED = "driver", "simulated"
"""Which driver took it; the bench that is computed."""
SATURATED = "saturated_share"
"""Share of the pixels that saturate in any frame."""
