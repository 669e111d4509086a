"""The name by which comparisons and studies of the spectral camera call `reconstruct`."""

from tmca.experiments.reconstructions import reconstruct as reconstruct_snapshot

__all__ = ["reconstruct_snapshot"]
