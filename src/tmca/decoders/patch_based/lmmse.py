"""Patch LMMSE: the best linear estimate of the scene under a Gaussian prior of its blocks, without training."""

from __future__ import annotations

from tmca.decoders.patch_based.patches import PatchDecoder
from tmca.priors.blocks import BlockModel
from tmca.priors.gaussian import GaussianPrior
from tmca.priors.posterior import GaussianSolver
from tmca.sensor import Noise


class PatchLMMSE(PatchDecoder):
    """``x̂ = μ + S Aᵀ (A S Aᵀ + R)⁻¹ (y - A μ)`` on overlapping blocks, blended; a ``PatchDecoder``."""

    prior: GaussianPrior

    def solver(self, model: BlockModel, read_noise: float, shot: float) -> GaussianSolver:
        """The linear estimate of every block."""
        return GaussianSolver(self.prior, model, Noise(read_noise, shot), self.dtype)
