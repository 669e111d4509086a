"""Linear maps from scene to snapshot, with adjoint and pseudo-inverse."""

from tmca.operators.analysis import Conditioning, conditioning, sparse_matrix
from tmca.operators.gram import gram_diagonal, gram_neighbour
from tmca.operators.light_field import code_through_mask, coded_mask, mask_code
from tmca.operators.linear import LinearOperator
from tmca.operators.sheared_code import sheared_code
from tmca.operators.slotwise import SlotwiseDisperser
from tmca.operators.spectral import EXPOSURES, coloured_code, dual_disperser, single_disperser
from tmca.operators.tap_operator import TapOperator
from tmca.operators.taps import Taps, sum_by_channel

__all__ = [
    "EXPOSURES",
    "Conditioning",
    "LinearOperator",
    "SlotwiseDisperser",
    "TapOperator",
    "Taps",
    "code_through_mask",
    "coded_mask",
    "coloured_code",
    "conditioning",
    "dual_disperser",
    "gram_diagonal",
    "gram_neighbour",
    "mask_code",
    "sheared_code",
    "single_disperser",
    "sparse_matrix",
    "sum_by_channel",
]
