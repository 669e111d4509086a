"""Patch decoder with a Gaussian-mixture prior: the mean of the linear estimates, each by its probability."""

from __future__ import annotations

from tmca.decoders.patch_based.patches import PatchDecoder
from tmca.priors.blocks import BlockModel
from tmca.priors.mixture import GaussianMixturePrior
from tmca.priors.mixture_posterior import MixtureSolver
from tmca.sensor import Noise


class MixtureLMMSE(PatchDecoder):
    """The minimum-mean-square-error estimate under a mixture of Gaussians, blocks blended; a ``PatchDecoder``."""

    prior: GaussianMixturePrior

    def solver(self, model: BlockModel, read_noise: float, shot: float) -> MixtureSolver:
        """The estimate of every block, components weighted by their likelihood."""
        return MixtureSolver(self.prior, model, Noise(read_noise, shot), self.dtype)
