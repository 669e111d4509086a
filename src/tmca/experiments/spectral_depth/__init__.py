"""The spectral-depth camera: snapshots and reconstructions, its comparison and sweeps."""
