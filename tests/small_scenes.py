"""Small smooth scenes, random codes of every camera's shape, and the snapshot they make, tap by tap."""

import torch

from tmca.decoders.adapted import AdaptedEstimator
from tmca.decoders.lmmse import PatchEstimator
from tmca.operators.taps import Taps
from tmca.priors.gaussian_posterior import NOISE_FLOOR
from tmca.sensor import Noise


def smooth_scene(height, width, channels=3, seed=0):
    """(L, H, W) low-pass noise around 0.5, correlated between channels."""
    generator = torch.Generator().manual_seed(seed)
    white = torch.randn(channels + 1, height, width, generator=generator, dtype=torch.float64)
    fy, fx = torch.fft.fftfreq(height)[:, None], torch.fft.fftfreq(width)[None]
    low = torch.fft.ifft2(torch.fft.fft2(white) / (0.03 + fy**2 + fx**2)).real
    low = low / low.std()
    return 0.5 + 0.1 * (low[1:] + low[:1])


CAMERAS = {
    "single disperser": ((0, 1, 2), (0, 1, 2)),
    "wide and unordered dispersion": ((0, 1, 2), (4, 0, 1)),
    "two taps per band": ((0, 0, 1, 1, 2, 2), (0, 1, 1, 2, 3, 4)),
    "offset origin": ((0, 1, 2), (2, 3, 4)),
    "dual disperser": ((0, 1, 2), (0, 0, 0)),
}


def camera(name, height, width, seed=0, period=None, dtype=torch.float64):
    channels, offsets = CAMERAS[name]
    generator = torch.Generator().manual_seed(seed)
    rows, columns = period or (height, width)
    code = torch.rand(len(channels), rows, columns, generator=generator, dtype=torch.float64).round(decimals=1)
    code = code.repeat(1, -(-height // rows), -(-width // columns))[:, :height, :width]
    return Taps(code.to(dtype), channels, offsets, 3, width + max(offsets))


def snapshot(taps, scene):
    """(B, 1, H, W') of scenes (B, L, H, W)."""
    width = scene.shape[-1]
    y = scene.new_zeros(len(scene), *taps.snapshot_shape)
    for code, channel, offset in zip(taps.code, taps.channels, taps.offsets, strict=True):
        y[:, 0, :, offset : offset + width] += code * scene[:, channel]
    return y


def matrix(taps):
    """(H·W', L·H·W) the camera as a dense matrix."""
    size = torch.tensor(taps.scene_shape).prod()
    basis = torch.eye(int(size), dtype=torch.float64).reshape(-1, *taps.scene_shape)
    return snapshot(taps, basis).flatten(1).mT


def noisy(values, read_noise, shot=0.0, seed=0):
    """Values plus Gaussian noise of variance read² + shot·values."""
    generator = torch.Generator().manual_seed(seed)
    white = torch.randn(values.shape, generator=generator, dtype=values.dtype)
    return values + white * (read_noise**2 + shot * values.clamp(min=0)).sqrt()


def textbook(prior, matrix, measured, read_noise, shot=0.0):
    """Estimate (N, n) and error covariance (n, n) of blocks of a Gaussian prior from measurements (N, m), densely."""
    S, mean = prior.covariance, prior.mean.flatten()
    noise = read_noise**2 + NOISE_FLOOR + shot * (matrix @ mean).clamp_min(0)
    gain = torch.linalg.solve(matrix @ S @ matrix.mT + torch.diag(noise), matrix @ S).mT
    return mean + (measured - matrix @ mean) @ gain.mT, S - gain @ matrix @ S


def patches(prior, **how):
    """``estimate(y, taps, read, shot, …)`` under a prior of blocks."""

    def estimate(y, taps, read=0.0, shot=0.0, differentiable=False, **asked):
        return PatchEstimator(prior, taps, Noise(read, shot), differentiable=differentiable, **how)(y, **asked)

    return estimate


def adapted(prior, *how, **more):
    """``estimate(y, taps, read, shot, …)`` under priors that are refitted to the snapshot."""

    def estimate(y, taps, read=0.0, shot=0.0, **asked):
        return AdaptedEstimator(prior, taps, Noise(read, shot), *how, **more)(y, **asked)

    return estimate
