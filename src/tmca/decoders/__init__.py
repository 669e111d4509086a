"""From a snapshot and its codes back to the scene."""

from tmca.decoders.adapted import AdaptedLMMSE
from tmca.decoders.admm import ADMMTV, admm_tv, default_weight
from tmca.decoders.blending import Estimate
from tmca.decoders.data_step import Result
from tmca.decoders.decoding import Decoded
from tmca.decoders.denoisers import (
    chambolle_denoiser,
    module_denoiser,
    nl_means_denoiser,
    per_band,
    tv_denoiser,
)
from tmca.decoders.dictionary import DictionaryDecoder
from tmca.decoders.light_field import LIGHT_FIELD_METHODS, decode_light_field
from tmca.decoders.lmmse import PatchLMMSE
from tmca.decoders.mixture import MixtureLMMSE
from tmca.decoders.network import Network, build_network
from tmca.decoders.neural import NeuralDecoder, Weights
from tmca.decoders.pnp import PnPADMM, pnp_admm
from tmca.decoders.shipped import find_weights
from tmca.decoders.sparse import LassoResult, batch_omp, lasso_admm
from tmca.decoders.spectral import METHODS, decode
from tmca.decoders.start import first_estimate
from tmca.decoders.tv import total_variation, tv_prox

__all__ = [
    "ADMMTV",
    "LIGHT_FIELD_METHODS",
    "METHODS",
    "AdaptedLMMSE",
    "Decoded",
    "DictionaryDecoder",
    "Estimate",
    "LassoResult",
    "MixtureLMMSE",
    "Network",
    "NeuralDecoder",
    "PatchLMMSE",
    "PnPADMM",
    "Result",
    "Weights",
    "admm_tv",
    "batch_omp",
    "build_network",
    "chambolle_denoiser",
    "decode",
    "decode_light_field",
    "default_weight",
    "find_weights",
    "first_estimate",
    "lasso_admm",
    "module_denoiser",
    "nl_means_denoiser",
    "per_band",
    "pnp_admm",
    "total_variation",
    "tv_denoiser",
    "tv_prox",
]
