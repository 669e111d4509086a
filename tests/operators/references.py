"""Slow loops straight from the equations, and the shapes on which operators are tried."""

import numpy as np
import torch

DISPERSIONS = {
    "one pixel per band": (0.0, 1.0, 2.0, 3.0),
    "two pixels per band": (0.0, 2.0, 4.0, 6.0),
    "backwards": (0.0, -1.0, -2.0, -3.0),
    "not monotone": (2.0, -1.0, 0.0, 2.0),
    "away from the origin": (3.0, 4.0, 6.0, 5.0),
    "fractional": (0.0, 0.7, 1.4, 2.1),
    "fractional backwards": (0.25, -0.5, -1.9, 0.0),
    "none": (0.0, 0.0, 0.0, 0.0),
}
SIZES = [(5, 7), (6, 8), (1, 9), (4, 1)]


def planes(slots, size, wide, dtype=torch.float64, seed=0):
    generator = torch.Generator().manual_seed(seed)
    near = (torch.rand(slots, *size, generator=generator) < 0.5).to(dtype)
    far = (torch.rand(slots, size[0], size[1] + wide, generator=generator) < 0.5).to(dtype)
    return near, far


def single_disperser_by_loops(scene, aperture, shutter, displacement, response, slot_weight):
    """Thesis eqs (4), (18): light falls on the two nearest sensor columns, each with its own shutter."""
    batch, bands, rows, columns = scene.shape
    origin = int(np.floor(min(displacement)))
    snapshot = np.zeros((batch, 1, rows, columns + int(np.ceil(max(displacement))) - origin))
    for k in range(aperture.shape[0]):
        for l in range(bands):
            for m in range(rows):
                for j in range(columns):
                    light = response[l] * aperture[k, m, j] * scene[:, l, m, j] * slot_weight
                    left = int(np.floor(displacement[l]))
                    part = displacement[l] - left
                    n = j + left - origin
                    snapshot[:, 0, m, n] += (1 - part) * shutter[k, m, n] * light
                    if part > 0:
                        snapshot[:, 0, m, n + 1] += part * shutter[k, m, n + 1] * light
    return snapshot


def dual_disperser_by_loops(scene, aperture, shutter, displacement, response, slot_weight):
    """Errata: e_{m,n} = Σ_k S^k_{m,n} Σ_ℓ κ_ℓ T^k_{m,n-d_ℓ} f_{m,n,ℓ}, the mask read between its pixels linearly."""
    batch, bands, rows, columns = scene.shape
    start = int(np.floor(min(-np.array(displacement))))
    snapshot = np.zeros((batch, 1, rows, columns))
    for k in range(aperture.shape[0]):
        for l in range(bands):
            for m in range(rows):
                for n in range(columns):
                    place = n - displacement[l] - start
                    left, part = int(np.floor(place)), place - np.floor(place)
                    mask = (1 - part) * aperture[k, m, left] + (part * aperture[k, m, left + 1] if part > 0 else 0)
                    snapshot[:, 0, m, n] += slot_weight * shutter[k, m, n] * response[l] * mask * scene[:, l, m, n]
    return snapshot
