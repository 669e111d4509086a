"""From a snapshot and its codes back to the scene."""

from tmca.decoders.decoding import Decoded
from tmca.decoders.iterative.admm import ADMMTV, admm_tv, default_weight
from tmca.decoders.iterative.data_step import Result
from tmca.decoders.iterative.denoisers import (
    chambolle_denoiser,
    module_denoiser,
    nl_means_denoiser,
    per_band,
    tv_denoiser,
)
from tmca.decoders.iterative.pnp import PnPADMM, pnp_admm
from tmca.decoders.iterative.sparse import LassoResult, batch_omp, lasso_admm
from tmca.decoders.iterative.tv import total_variation, tv_prox
from tmca.decoders.light_field import LIGHT_FIELD_METHODS, decode_light_field
from tmca.decoders.networks.network import Network, build_network
from tmca.decoders.networks.neural import NeuralDecoder, Weights
from tmca.decoders.networks.shipped import find_weights
from tmca.decoders.networks.start import first_estimate
from tmca.decoders.patch_based.adapted import AdaptedLMMSE
from tmca.decoders.patch_based.blending import Estimate
from tmca.decoders.patch_based.dictionary import DictionaryDecoder
from tmca.decoders.patch_based.lmmse import PatchLMMSE
from tmca.decoders.patch_based.mixture import MixtureLMMSE
from tmca.decoders.spectral import METHODS, decode

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
