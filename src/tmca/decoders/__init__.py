"""From a snapshot and its codes back to the scene."""

from tmca.decoders.adapted import AdaptedLMMSE
from tmca.decoders.admm import VariationDecoder, admm_tv, default_weight
from tmca.decoders.aliases import Decoded, decode_light_field, find_weights
from tmca.decoders.blocks import LMMSE, MixtureLMMSE, PatchEstimator
from tmca.decoders.data_step import Result
from tmca.decoders.decoder import (
    DECODERS,
    Decoder,
    Prepared,
    Raw,
    decode,
    decoders,
    decoders_for,
    make_decoder,
    settings_of,
    usual_decoder,
)
from tmca.decoders.denoisers import (
    chambolle_denoiser,
    module_denoiser,
    nl_means_denoiser,
    per_band,
    subspace_denoiser,
    tv_denoiser,
)
from tmca.decoders.dictionary import DictionaryDecoder, DictionaryEstimator
from tmca.decoders.estimate import Estimate
from tmca.decoders.kriging import KrigingDecoder
from tmca.decoders.least_squares import LeastNorm, TikhonovDecoder, tikhonov
from tmca.decoders.likelihood import LikelihoodDecoder, PatchLikelihood
from tmca.decoders.nets.build import build_network
from tmca.decoders.nets.network import Network
from tmca.decoders.nets.tiles import first_estimate
from tmca.decoders.nets.weights import OtherCodes, Weights
from tmca.decoders.network import NetworkDecoder
from tmca.decoders.pnp import PlugAndPlay, pnp_admm
from tmca.decoders.space_time import SpaceTimeDecoder
from tmca.decoders.sparse import LassoResult, batch_omp, lasso_admm
from tmca.decoders.tv import total_variation, tv_prox

__all__ = [
    "DECODERS",
    "LMMSE",
    "AdaptedLMMSE",
    "Decoded",
    "Decoder",
    "DictionaryDecoder",
    "DictionaryEstimator",
    "Estimate",
    "KrigingDecoder",
    "LassoResult",
    "LeastNorm",
    "LikelihoodDecoder",
    "MixtureLMMSE",
    "Network",
    "NetworkDecoder",
    "OtherCodes",
    "PatchEstimator",
    "PatchLikelihood",
    "PlugAndPlay",
    "Prepared",
    "Raw",
    "Result",
    "SpaceTimeDecoder",
    "TikhonovDecoder",
    "VariationDecoder",
    "Weights",
    "admm_tv",
    "batch_omp",
    "build_network",
    "chambolle_denoiser",
    "decode",
    "decode_light_field",
    "decoders",
    "decoders_for",
    "default_weight",
    "find_weights",
    "first_estimate",
    "lasso_admm",
    "make_decoder",
    "module_denoiser",
    "nl_means_denoiser",
    "per_band",
    "pnp_admm",
    "settings_of",
    "subspace_denoiser",
    "tikhonov",
    "total_variation",
    "tv_denoiser",
    "tv_prox",
    "usual_decoder",
]
