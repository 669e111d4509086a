"""Gaussian and Gaussian-mixture priors of small scene blocks, and dictionaries of light-field patches."""

from tmca.priors.blocks import BlockGrid, BlockModel
from tmca.priors.dictionary import PatchDictionary
from tmca.priors.expected_error import expected_mse, expected_psnr
from tmca.priors.gaussian import GaussianPrior
from tmca.priors.learning import Prior, block_for, cache_folder, learn_prior, load_prior, rendered_prior
from tmca.priors.light_field import (
    learn_light_field_mixture,
    learn_light_field_prior,
    light_field_block,
    rendered_light_field_prior,
)
from tmca.priors.mixture import GaussianMixturePrior
from tmca.priors.pooling import cropped, pooled

__all__ = [
    "BlockGrid",
    "BlockModel",
    "GaussianMixturePrior",
    "GaussianPrior",
    "PatchDictionary",
    "Prior",
    "block_for",
    "cache_folder",
    "cropped",
    "expected_mse",
    "expected_psnr",
    "learn_light_field_mixture",
    "learn_light_field_prior",
    "learn_prior",
    "light_field_block",
    "load_prior",
    "pooled",
    "rendered_light_field_prior",
    "rendered_prior",
]
