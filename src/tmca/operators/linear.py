"""What every camera's linear part offers: ``A``, ``A_adjoint``, ``A_dagger`` (deepinv's names and meaning)."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from tmca.errors import ShapeError


class LinearOperator(nn.Module):
    """A linear map from scenes (B, *scene_shape) to snapshots (B, *snapshot_shape).

    Subclasses set ``scene_shape`` and ``snapshot_shape`` and define ``A`` and ``A_adjoint``.
    """

    scene_shape: tuple[int, ...]
    snapshot_shape: tuple[int, ...]

    def A(self, scene: Tensor) -> Tensor:
        """Scene (B, *scene_shape) → snapshot (B, *snapshot_shape)."""
        raise TypeError(f"{type(self).__name__} defines no A")

    def A_adjoint(self, snapshot: Tensor) -> Tensor:
        """Snapshot → scene, the transpose of ``A``."""
        raise TypeError(f"{type(self).__name__} defines no A_adjoint")

    def forward(self, scene: Tensor) -> Tensor:
        """The same as ``A``."""
        return self.A(scene)

    def gram_solve(self, snapshot: Tensor, shift: float, *, tolerance: float = 1e-10, iterations: int = 1000) -> Tensor:
        """``(A Aᵀ + shift·I)⁻¹ snapshot`` by conjugate gradients; operators with a closed form override it.

        Args:
            snapshot: (B, *snapshot_shape).
            shift: ≥ 0; with 0 the solution of least norm for snapshots in the range of A.
            tolerance: residual at which the iteration stops, relative to the snapshot.
            iterations: upper limit.
        """
        dims = tuple(range(1, snapshot.ndim))
        solution, residual = torch.zeros_like(snapshot), snapshot
        direction, energy = residual, (residual**2).sum(dims, keepdim=True)
        floor = tolerance**2 * energy
        for _ in range(iterations):
            image = self.A(self.A_adjoint(direction)) + shift * direction
            curvature = (direction * image).sum(dims, keepdim=True)
            step = torch.where(curvature > 0, energy / curvature.clamp_min(torch.finfo(image.dtype).tiny), 0)
            solution = solution + step * direction
            residual = residual - step * image
            fresh = (residual**2).sum(dims, keepdim=True)
            if bool((fresh <= floor).all()):
                break
            ratio = fresh / energy.clamp_min(torch.finfo(image.dtype).tiny)
            direction, energy = residual + ratio * direction, fresh
        return solution

    def A_dagger(self, snapshot: Tensor) -> Tensor:
        """Least-norm scene that explains the snapshot: ``Aᵀ (A Aᵀ)⁺ snapshot``."""
        self._check(snapshot, self.snapshot_shape, "snapshot")
        return self.A_adjoint(self.gram_solve(snapshot, 0.0))

    def _check(self, tensor: Tensor, shape: tuple[int, ...], name: str) -> None:
        if tensor.ndim != len(shape) + 1 or tuple(tensor.shape[1:]) != tuple(shape):
            raise ShapeError(
                name,
                f"shape {tuple(tensor.shape)}",
                f"(batch, {', '.join(map(str, shape))})",
                "give the camera this size and number of bands, or crop the input",
            )
