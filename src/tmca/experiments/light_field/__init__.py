"""The light-field camera: snapshots and reconstructions, its comparison and sweeps."""
