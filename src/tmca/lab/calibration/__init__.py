"""From captures to a dated calibration of a coded camera, and cameras with it."""
