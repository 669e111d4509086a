"""Linear maps from scene to snapshot, with adjoint and pseudo-inverse."""

from tmca.operators.light_field import code_through_mask, coded_mask, mask_code
from tmca.operators.linear import (
    EXPOSURES,
    Buckets,
    LinearOperator,
    SensorColumns,
    conditioning,
    conjugate_gradients,
    exposure_weight,
    sparse_matrix,
)
from tmca.operators.spectral import SlotwiseDisperser, coloured_code, dual_disperser, single_disperser
from tmca.operators.spectral_depth import LayeredOperator
from tmca.operators.taps import TapOperator, Taps, of_buckets, sum_by_channel

__all__ = [
    "EXPOSURES",
    "Buckets",
    "LayeredOperator",
    "LinearOperator",
    "SensorColumns",
    "SlotwiseDisperser",
    "TapOperator",
    "Taps",
    "code_through_mask",
    "coded_mask",
    "coloured_code",
    "conditioning",
    "conjugate_gradients",
    "dual_disperser",
    "exposure_weight",
    "mask_code",
    "of_buckets",
    "single_disperser",
    "sparse_matrix",
    "sum_by_channel",
]


def __dir__() -> list[str]:
    return sorted(__all__)
