"""Captures that plain physics makes, for estimators to be held against."""

import numpy as np
from PIL import Image


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


def pictures(folder, frames):
    """A folder with a 16-bit PNG of every frame by its name."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, frame in frames.items():
        Image.fromarray(np.asarray(np.round(frame), np.uint16)).save(folder / f"{name}.png")
    return folder
