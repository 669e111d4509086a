"""Spectrum and depth of a capture before and after fine-tuning, beside the truth."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import torch

from tmca.cameras import SpectralDepthCamera
from tmca.decoders.likelihood import DepthRaw
from tmca.experiments.composite import rgb_composite, white_level
from tmca.experiments.figures import add_bar, bare, grid, image

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def depth_before_after(found: Mapping[str, DepthRaw], camera: SpectralDepthCamera, truth: np.ndarray) -> Figure:
    """A column for the truth and every estimate: colour composite and depth; errors in the titles.

    Args:
        found: name → estimate of one capture.
        camera: of its bands and planes.
        truth: (L + 1, H, W) cube, and inverse depth as a share of the range.
    """
    cube, metres = truth[:-1], camera.planes.depth_of(torch.from_numpy(truth[-1])).numpy()
    white, waves = white_level(cube, list(camera.wavelengths)), list(camera.wavelengths)
    figure, axes = grid(2, 1 + len(found), width=3.6, aspect=cube.shape[1] / cube.shape[2])
    image(axes[0, 0], rgb_composite(cube, waves, white), "truth")
    _draw(axes[1, 0], metres, "depth", camera)
    for column, (name, one) in zip(axes[:, 1:].T, found.items(), strict=True):
        own, depth = one.values[0].numpy(), one.depth[0, 0].numpy()
        psnr, away = -10 * np.log10(np.square(own - cube).mean()), np.nanmean(np.abs(depth - metres))
        image(column[0], rgb_composite(own, waves, white), f"{name}\n{psnr:.2f} dB")
        _draw(column[1], depth, f"{away:.3f} m off", camera)
    return figure


def _draw(axis: Axes, metres: np.ndarray, title: str, camera: SpectralDepthCamera) -> None:
    """A depth map over the camera's range."""
    planes = camera.planes
    shown = axis.imshow(metres, cmap="viridis_r", vmin=planes.near, vmax=planes.far, interpolation="nearest")
    bare(axis, title)
    add_bar(axis, shown, "m")
