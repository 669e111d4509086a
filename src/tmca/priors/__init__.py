"""Gaussian and Gaussian-mixture priors of small scene blocks, and dictionaries of light-field patches."""

from tmca.operators.blocks import BlockGrid, BlockModel
from tmca.priors.dictionary import PatchDictionary
from tmca.priors.expected import expected_mse, expected_psnr
from tmca.priors.finding import NarrowBlocks, block_of, find_prior, has_rendered, learn_prior
from tmca.priors.gaussian import GaussianPrior
from tmca.priors.learning import views_of
from tmca.priors.mixture import GaussianMixturePrior
from tmca.priors.prior import Prior, check_kind, load_prior, prior_kinds
from tmca.priors.statistics import pooled
from tmca.priors.subspace import BandsBeyond, SubspacePrior, beyond, interpolation, warn_of_bands_beyond, within

__all__ = [
    "BandsBeyond",
    "BlockGrid",
    "BlockModel",
    "GaussianMixturePrior",
    "GaussianPrior",
    "NarrowBlocks",
    "PatchDictionary",
    "Prior",
    "SubspacePrior",
    "beyond",
    "block_of",
    "check_kind",
    "expected_mse",
    "expected_psnr",
    "find_prior",
    "has_rendered",
    "interpolation",
    "learn_prior",
    "load_prior",
    "pooled",
    "prior_kinds",
    "views_of",
    "warn_of_bands_beyond",
    "within",
]


def __dir__() -> list[str]:
    return sorted(__all__)
