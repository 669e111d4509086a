"""The operator of every collapsed camera, given its taps."""

from __future__ import annotations

import torch
from torch import Tensor

from tmca.operators.gram import gram_diagonal, gram_neighbour, solve_tridiagonal
from tmca.operators.linear import LinearOperator
from tmca.operators.tap_kernels import backproject, project
from tmca.operators.taps import Taps

_SHIFT, _REFINEMENTS = 1e-9, 4


class TapOperator(LinearOperator):
    """``y[m, n + o_t] = Σ_t code[t, m, n] · x[c_t, m, n]``, with adjoint and closed pseudo-inverse.

    Args:
        taps: code, channels and offsets.
    """

    code: Tensor

    def __init__(self, taps: Taps) -> None:
        super().__init__()
        self.register_buffer("code", taps.code)
        self._channels, self._offsets = taps.channels, taps.offsets
        self.scene_shape, self.snapshot_shape = taps.scene_shape, taps.snapshot_shape
        self._layout = (taps.channels, taps.offsets, taps.scene_channels, taps.snapshot_width)

    @property
    def taps(self) -> Taps:
        """The operator's taps, on its present device."""
        return Taps(self.code, self._channels, self._offsets, self.scene_shape[0], self.snapshot_shape[2])

    def A(self, scene: Tensor) -> Tensor:
        """(B, L, H, W) → (B, 1, H, W')."""
        self._check(scene, self.scene_shape, "scene")
        return project(scene, self.code, self._layout)

    def A_adjoint(self, snapshot: Tensor) -> Tensor:
        """(B, 1, H, W') → (B, L, H, W)."""
        self._check(snapshot, self.snapshot_shape, "snapshot")
        return backproject(snapshot, self.code, self._layout)

    def gram_solve(self, snapshot: Tensor, shift: float | Tensor) -> Tensor:
        """``(A Aᵀ + shift·I)⁻¹ snapshot``: a division, or a tridiagonal solve along x.

        Args:
            snapshot: (B, 1, H, W').
            shift: ≥ 0, or a map of the snapshot's size; with 0, sensor pixels that no light reaches give zero.
        """
        coupling = gram_neighbour(self.taps)
        if coupling is None:
            diagonal = gram_diagonal(self.taps) + shift
            return torch.where(diagonal > 0, snapshot / diagonal.clamp_min(torch.finfo(diagonal.dtype).tiny), 0)
        diagonal, coupling, right = gram_diagonal(self.taps).double(), coupling.double(), snapshot.double()
        if not isinstance(shift, Tensor) and shift == 0:
            return _least_norm(diagonal, coupling, right).to(snapshot.dtype)
        return solve_tridiagonal(diagonal + shift, coupling, right).to(snapshot.dtype)

    def A_dagger(self, snapshot: Tensor) -> Tensor:
        """(B, 1, H, W') → (B, L, H, W), the least-norm scene that explains the snapshot, ``Aᵀ (A Aᵀ)⁺ snapshot``."""
        self._check(snapshot, self.snapshot_shape, "snapshot")
        if gram_neighbour(self.taps) is None:
            return self.A_adjoint(self.gram_solve(snapshot, 0.0))
        precise = self.gram_solve(snapshot.double(), 0.0)
        return backproject(precise, self.code.double(), self._layout).to(snapshot.dtype)


def _least_norm(diagonal: Tensor, coupling: Tensor, right: Tensor) -> Tensor:
    """Proximal iterations: singular systems (a lone fractional band, closed pixels) need no rank decision.

    What lies in the null space of ``A Aᵀ`` is multiplied by 1/shift; ``Aᵀ`` removes it again, in double precision.
    """
    shift = _SHIFT * diagonal.max().clamp_min(torch.finfo(diagonal.dtype).tiny)
    solution = torch.zeros_like(right)
    for _ in range(_REFINEMENTS):
        image = diagonal * solution
        image[..., :-1] += coupling * solution[..., 1:]
        image[..., 1:] += coupling * solution[..., :-1]
        solution = solution + solve_tridiagonal(diagonal + shift, coupling, right - image)
    return solution
