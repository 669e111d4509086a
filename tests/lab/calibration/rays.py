"""Slow, plain physics that estimators are held against: rays through masks, wavelength by wavelength, sums of waves."""

import numpy as np


def seen_by_rays(patterns, matrix, size, rays=8, blur=0.0):
    """(P, H, W): every ray of a sensor pixel looks up the mask pixel that it comes through."""
    from scipy.ndimage import gaussian_filter

    back = np.linalg.inv(matrix[:, :2])
    y, x = ((np.arange(n * rays) + 0.5) / rays - 0.5 for n in size)
    place = np.stack(np.broadcast_arrays(y[:, None], x)) - matrix[:, 2][:, None, None]
    row, column = np.floor(np.einsum("ij,jhw->ihw", back, place) + 0.5).astype(int)
    inside = (row >= 0) & (column >= 0) & (row < patterns.shape[1]) & (column < patterns.shape[2])
    fine = np.where(inside, patterns[:, row * inside, column * inside], 0.0)
    if blur:
        fine = gaussian_filter(fine, (0, blur * rays, blur * rays), mode="nearest")
    return fine.reshape(len(patterns), size[0], rays, size[1], rays).mean(axis=(2, 4))


def noisy(frames, snr_db=40.0, seed=0):
    """Frames with noise whose rms is that of the frames less the signal-to-noise ratio."""
    spread = np.sqrt((frames**2).mean()) / 10 ** (snr_db / 20)
    return frames + spread * np.random.default_rng(seed).standard_normal(frames.shape)


def affine(codes, sensor, turn=0.0, scale=1.0, shear=0.0, shift=(0.0, 0.0)):
    """Map of code pixels to sensor pixels, middle on middle before the shift; the turn in degrees."""
    angle = np.deg2rad(turn)
    linear = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    linear = linear @ np.array([[1.0, shear], [0.0, 1.0]])
    own, other = (np.array([(n - 1) / 2 for n in size]) for size in (codes, sensor))
    return np.hstack([linear, (other - linear @ own + shift)[:, None]])


def point_of(bench, heights, depth, wavelength, size, shift=(0.0, 0.0), samples=5):
    """(H, W) light of a point by a plain Fourier sum over a mask of any sampling (n, n), in metres of height."""
    n = len(heights)
    place = ((np.arange(n) + 0.5) / n - 0.5) * bench.diameter
    square = place[:, None] ** 2 + place**2
    path = np.sqrt(square + depth**2) - depth - (np.sqrt(square + bench.focus**2) - bench.focus)
    wave = (square <= (bench.diameter / 2) ** 2) * np.exp(2j * np.pi / wavelength * (path + 2 * heights))
    turned = []
    for extent, moved in zip(size, shift, strict=True):
        seen = ((np.arange(extent * samples) + 0.5) / samples - 0.5 - (extent - 1) / 2 - moved) * bench.pitch
        turned.append(np.exp(-2j * np.pi * seen[:, None] * place / (wavelength * bench.distance)))
    light = np.abs(turned[0] @ wave @ turned[1].T) ** 2
    return light.reshape(size[0], samples, size[1], samples).mean(axis=(1, 3))
