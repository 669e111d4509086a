"""Projection onto positive semidefinite matrices through whichever eigenvectors are fewer."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from tmca.dbd.arrays import Complex


def positive_part(matrix: Complex, few_negative: bool) -> tuple[Complex, int]:
    """The nearest positive semidefinite matrix, and how many eigenvalues were negative.

    Args:
        matrix: Hermitian ``(n, n)``.
        few_negative: whether the negative eigenvalues are expected to be the fewer.
    """
    limits = (-np.inf, 0.0) if few_negative else (0.0, np.inf)
    values, vectors = eigh(matrix, subset_by_value=limits, driver="evr", check_finite=False)
    part = (vectors * values) @ vectors.conj().T
    if few_negative:
        return matrix - part, len(values)
    return part, len(matrix) - len(values)
