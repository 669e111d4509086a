"""From a snapshot and its codes back to the scene."""

from tmca.arguments import settings_of
from tmca.decoders import adapted, kriging, motions, network, space_time  # noqa: F401  (importing a decoder registers it)
from tmca.decoders.admm import admm_tv, default_weight
from tmca.decoders.aliases import Decoded, decode_light_field, find_weights
from tmca.decoders.decoder import Decoder, NoRenderedPrior, Prepared, Raw, decode
from tmca.decoders.dictionary import DictionaryEstimator
from tmca.decoders.estimate import Estimate
from tmca.decoders.least_squares import Result, tikhonov
from tmca.decoders.likelihood import PatchLikelihood
from tmca.decoders.lmmse import LMMSE, PatchEstimator
from tmca.decoders.misfit import Misfit, misfit_of
from tmca.decoders.nets.build import build_network
from tmca.decoders.nets.network import Network
from tmca.decoders.nets.starts import first_estimate
from tmca.decoders.nets.subspace import SubspaceNetwork
from tmca.decoders.nets.weights import OtherCodes, Weights
from tmca.decoders.pnp import (
    nl_means_denoiser,
    per_band,
    pnp_admm,
    subspace_denoiser,
    tv_denoiser,
)
from tmca.decoders.registry import DECODERS, decoders, decoders_for, make_decoder, usual_decoder, usual_for
from tmca.decoders.space_time import frame_operator
from tmca.decoders.sparse import batch_omp, lasso_admm
from tmca.decoders.tv import total_variation, tv_prox

__all__ = [
    "DECODERS",
    "LMMSE",
    "Decoded",
    "Decoder",
    "DictionaryEstimator",
    "Estimate",
    "Misfit",
    "Network",
    "NoRenderedPrior",
    "OtherCodes",
    "PatchEstimator",
    "PatchLikelihood",
    "Prepared",
    "Raw",
    "Result",
    "SubspaceNetwork",
    "Weights",
    "admm_tv",
    "batch_omp",
    "build_network",
    "decode",
    "decode_light_field",
    "decoders",
    "decoders_for",
    "default_weight",
    "find_weights",
    "first_estimate",
    "frame_operator",
    "lasso_admm",
    "make_decoder",
    "misfit_of",
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
    "usual_for",
]


def __dir__() -> list[str]:
    return sorted(__all__)
