"""From a snapshot and its codes back to the scene."""

from tmca.decoders.lmmse import PatchLMMSE
from tmca.decoders.mixture import PatchMixture

__all__ = ["PatchLMMSE", "PatchMixture"]
