"""What noise does to the dual polynomials: the regularisation that keeps it out, and the noise level where unknown."""

from __future__ import annotations

import numpy as np

from tmca.dbd.atoms.measure import Measure
from tmca.dbd.atoms.polynomial import Polynomial
from tmca.dbd.problem import Problem

_QUANTILE = 0.95
_DRAWS = 30


def noise_level(problem: Problem, seed: int = 0) -> float:
    """The 95 % quantile of the highest ``‖f‖ / weight`` that complex noise of standard deviation one reaches.

    Times the noise's standard deviation it is the regularisation above which noise alone gives an atom in one of
    twenty draws.
    """
    rng = np.random.default_rng(seed)
    atoms = Measure.empty(problem).atoms
    highest = []
    for _ in range(_DRAWS):
        noise = (rng.standard_normal(problem.shape) + 1j * rng.standard_normal(problem.shape)) / np.sqrt(2)
        levels = [np.sqrt(Polynomial(one, noise).norms_on_grid().max()) / one.source.weight for one in atoms]
        highest.append(max(levels))
    return float(np.quantile(highest, _QUANTILE))
