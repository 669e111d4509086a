"""The spectral camera: snapshots and reconstructions, its comparison and sweeps."""
