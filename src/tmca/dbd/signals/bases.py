"""Known subspaces that signals lie in."""

from __future__ import annotations

import numpy as np

from tmca.dbd.arrays import Complex
from tmca.errors import SettingError

BASES = ("vandermonde", "gaussian", "dft", "sign")


def random_rows(rng: np.random.Generator, count: int, subspace: int, kind: str = "vandermonde") -> Complex:
    """``count`` rows ``bₙᴴ`` of a random basis, ``(count, subspace)``.

    Args:
        rng: random numbers.
        count: rows.
        subspace: columns.
        kind: ``vandermonde``, ``[1, e^(−j2πs), …]`` with s uniform (Chi, "Guaranteed blind sparse spikes
            deconvolution via lifting and convex optimization", 2016); ``gaussian``, complex with unit variance;
            ``dft``, rows of the Fourier matrix in random order; ``sign``, ±1.

    Raises:
        SettingError: another kind.
    """
    columns = np.arange(subspace)
    if kind == "gaussian":
        real, imaginary = rng.standard_normal((count, subspace)), rng.standard_normal((count, subspace))
        return (real + 1j * imaginary) / np.sqrt(2)
    if kind == "vandermonde":
        return np.exp(-2j * np.pi * np.outer(rng.random(count), columns))
    if kind == "sign":
        return rng.choice([-1.0, 1.0], (count, subspace)) + 0j
    if kind == "dft":
        size = max(count, subspace)
        return np.exp(-2j * np.pi * np.outer(rng.permutation(size)[:count], columns) / size)
    raise SettingError("basis", f"{kind!r}", f"one of {', '.join(BASES)}")


def unit_vector(rng: np.random.Generator, size: int) -> Complex:
    """A complex direction, uniform on the sphere."""
    vector = rng.standard_normal(size) + 1j * rng.standard_normal(size)
    return vector / np.linalg.norm(vector)
