"""Windows of a snapshot along the axes of their second moments; for many frames only along those that count.

An axis whose light stays far below the noise at every plane says nothing of depth or scene. What estimates have in
common over planes, some spectra and some patterns, is laid out once they are summed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from tmca.operators.window_moments import SnapshotMoments

FAINT = 0.003
"""Light along an axis, at the largest gain, over the noise: fainter axes are not looked at."""
LEFT_OUT = 2e-5
"""Squares of estimates that are left out, over their predicted squared error, at the largest gain.

With both, scenes unlike the prior lose less than 0.01 dB, too."""
_SINGLE = 1e-6
"""Variance of the noise over the second moment of a pixel below which single precision would count."""


@dataclass(frozen=True)
class WindowBasis:
    """Windows of one phase of the tile, at every plane.

    Args:
        vectors: (D, q, q) eigenvectors of what is seen of windows.
        values: (D, q) eigenvalues.
        scene: (D, r, q) the scene's share in them.
        axes: (n, q) along which windows are seen; None sees all of them.
        patterns: (r, k·m·m) of estimates; None for any.
    """

    vectors: Tensor
    values: Tensor
    scene: Tensor
    axes: Tensor | None = None
    patterns: Tensor | None = None

    @classmethod
    def of(cls, moments: SnapshotMoments) -> WindowBasis:
        """All of windows, and any estimate."""
        assert moments.cross is not None
        values, vectors = torch.linalg.eigh(moments.covariance)
        return cls(vectors, values.clamp_min(0), moments.cross @ vectors)

    def seen(self, windows: Tensor) -> Tensor:
        """(..., q) of windows (..., n)."""
        return windows if self.axes is None else windows.to(self.axes) @ self.axes

    def laid(self, estimate: Tensor) -> Tensor:
        """(..., k·m·m) of estimates (..., r)."""
        return estimate if self.patterns is None else estimate @ self.patterns

    def bright(self, gain: float, noise: float) -> WindowBasis:
        """Along the axes that stand out of the noise at the planes' mean."""
        light, axes = torch.linalg.eigh(((self.vectors * self.values[:, None]) @ self.vectors.mT).mean(0))
        axes = axes[:, gain * light > min(FAINT * noise, gain * float(light[-1]) / 2)]
        turned = axes.T @ self.vectors
        values, vectors = torch.linalg.eigh((turned * self.values[:, None]) @ turned.mT)
        return WindowBasis(vectors, values.clamp_min(0), self.scene @ (turned.mT @ vectors), axes)

    def squares(self, gain: float, noise: float, parts: int) -> Tensor:
        """(parts, parts) products of the bands, or of any equal parts of estimates, expected at the planes' mean."""
        expected = self.scene * (gain / (gain * self.values + noise).sqrt())[:, None]
        flat = expected.reshape(len(expected), parts, -1)
        return (flat @ flat.mT).mean(0)

    def within(self, spectra: Tensor) -> WindowBasis:
        """With estimates in spectra (L, k)."""
        scene = torch.einsum("dlpq,lk->dkpq", self.scene.unflatten(1, (len(spectra), -1)), spectra)
        return replace(self, scene=scene.flatten(1, 2))

    def summed_of(self, patterns: Tensor) -> WindowBasis:
        """With estimates that are sums of patterns (k·m·m, r), in single precision."""
        assert self.axes is not None
        parts = (self.vectors, self.values, patterns.T @ self.scene, self.axes, patterns.T)
        return WindowBasis(*(part.float().contiguous() for part in parts))


def shortened(
    bases: Sequence[WindowBasis], light: Tensor, gain: float, noise: float
) -> tuple[Tensor, list[WindowBasis]] | None:
    """Spectra (L, k), and bases of what counts whose estimates are in them; None where the noise is next to none.

    Args:
        bases: of whole windows, one of every phase.
        light: (L,) second moment of a pixel of the scene.
        gain: the largest that is tried.
        noise: variance of a pixel of the snapshot.
    """
    if noise < _SINGLE * float(bases[0].values.mean()):
        return None
    bright, bands = [basis.bright(gain, noise) for basis in bases], len(light)
    squares = torch.stack([basis.squares(gain, noise, bands) for basis in bright])
    everything = gain * float(light.mean()) * bases[0].scene.shape[1]
    least = LEFT_OUT * (everything - float(squares.diagonal(dim1=1, dim2=2).sum(1).max()))
    spectra, short = _leading(squares.mean(0), least), list[WindowBasis]()
    for basis in bright:
        within = basis.within(spectra)
        patterns = _leading(within.squares(gain, noise, within.scene.shape[1]), least)
        short.append(within.summed_of(patterns))
    return spectra, short


def _leading(squares: Tensor, least: float) -> Tensor:
    """(n, k) eigenvectors of products (n, n) without the faintest, whose squares sum up to ``least`` at most."""
    values, axes = torch.linalg.eigh(squares)
    return axes[:, (values.cumsum(0) > least).logical_or(values == values[-1])]
