"""Synthetic scenes and files that the data tests share."""

from __future__ import annotations

import numpy as np
import pytest


@pytest.fixture
def pixels() -> np.ndarray:
    """A random cube (7, 10, 13) in [0, 1]: every axis of its own length, so that a swapped axis shows."""
    return np.random.default_rng(0).random((7, 10, 13), dtype=np.float32)


@pytest.fixture
def nm() -> np.ndarray:
    """Seven uneven wavelengths in nanometres."""
    return np.array([412.5, 450.0, 480.0, 533.3, 600.0, 650.0, 699.0])


@pytest.fixture
def cube(pixels, nm):
    """The labelled cube of `pixels` and `nm`."""
    from tmca.data import label, nm_to_metres

    return label(pixels, nm_to_metres(nm))
