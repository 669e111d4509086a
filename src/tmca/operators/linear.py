"""What every camera's linear part offers: ``A``, ``A_adjoint``, ``A_dagger``, ``prox_l2`` (deepinv's names); and the
explicit matrix of a small one: rank, condition number, coherence."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass
from math import prod
from warnings import warn

import numpy as np
import torch
from scipy import sparse
from torch import Tensor, nn
from torch.nn.functional import pad

from tmca.errors import SettingError, check_choice, check_shape

EXPOSURES = ("equal", "per-slot")
_TOLERANCE = {torch.float32: 1e-6, torch.float64: 1e-11}
_LARGEST = 20_000
_GROWTH = 100.0
"""An iteration whose residual ends this far above its least leads nowhere."""


def exposure_weight(exposure: str, slots: int) -> float:
    """Weight of one slot in a snapshot.

    1/K where the slots share one exposure time (``"equal"``), 1 where each has a time of its own (``"per-slot"``).

    Raises:
        SettingError: another name.
    """
    check_choice("exposure", exposure, EXPOSURES)
    return 1 / slots if exposure == "equal" else 1.0


def conjugate_gradients(
    apply: Callable[[Tensor], Tensor],
    right: Tensor,
    *,
    shift: float | Tensor = 0.0,
    tolerance: float | None = 1e-6,
    steps: int = 200,
    start: Tensor | None = None,
    preconditioner: Tensor | None = None,
    progress: Callable[[float], None] | None = None,
    watch: Callable[[Tensor, Tensor], None] | None = None,
) -> Tensor:
    """Solve ``apply(x) + shift · x = right`` for a batch, each entry with steps of its own (Hestenes, Stiefel 1952).

    Args:
        apply: symmetric and positive semidefinite; without a shift ``right`` must lie in its range.
        right: (B, …).
        shift: ≥ 0, or a map.
        tolerance: residual, as a share of the norm of ``right``, at which the iteration stops; None takes a fixed
            number of steps, in operations that exporters know, of which those beyond rounding change nothing.
        steps: most steps taken.
        start: a solution that is near, such as that of the iteration before; zero if None.
        preconditioner: (…) near inverse of the diagonal.
        progress: called with the share of the steps that is done.
        watch: called after every step with the solution and the squared norms (B, 1, …) of the residual.
    """
    shifted = isinstance(shift, Tensor) or shift != 0

    def matrix(x: Tensor) -> Tensor:
        return apply(x) + shift * x if shifted else apply(x)

    tiny, rounding = torch.finfo(right.dtype).tiny, torch.finfo(right.dtype).eps ** 2
    inner = _inner if tolerance is not None else _inner_by_rows
    solution = torch.zeros_like(right) if start is None else start
    residual = right if start is None else right - matrix(start)
    direction = scaled = residual if preconditioner is None else preconditioner * residual
    first = energy = inner(residual, scaled)
    goal = None if tolerance is None else tolerance**2 * inner(right, right)
    for step in range(1, steps + 1):
        if goal is not None and bool((inner(residual, residual) <= goal).all()):
            break
        image = matrix(direction)
        length = energy / inner(direction, image).clamp_min(tiny)
        length = length * (energy > rounding * first) if goal is None else length
        solution, residual = solution + length * direction, residual - length * image
        scaled = residual if preconditioner is None else preconditioner * residual
        energy, previous = inner(residual, scaled), energy
        direction = scaled + energy / previous.clamp_min(tiny) * direction
        if progress is not None:
            progress(step / steps)
        if watch is not None:
            watch(solution, inner(residual, residual))
    return solution


class Diverged(UserWarning):
    """An iteration whose residual ended far above its least."""


class _Best:
    """The iterate of every entry of a batch that left the least residual, and whether the last is far beyond it."""

    def __init__(self, right: Tensor) -> None:
        self.solution, self.first = torch.zeros_like(right), _inner(right, right)
        self.residual = self.last = self.first

    def __call__(self, solution: Tensor, residual: Tensor) -> None:
        better = residual < self.residual
        self.solution = torch.where(better, solution, self.solution)
        self.residual, self.last = torch.where(better, residual, self.residual), residual

    def diverged(self) -> bool:
        return bool((~(self.last <= _GROWTH**2 * self.residual)).any())

    def share(self) -> float:
        """Norm of the least residual over that of the right-hand side, the largest of all entries."""
        shares = self.residual / self.first.clamp_min(torch.finfo(self.first.dtype).tiny)
        return float(shares.max().sqrt())


def _inner(one: Tensor, other: Tensor) -> Tensor:
    """(B, 1, …) inner products."""
    return (one * other).sum(dim=tuple(range(1, one.ndim)), keepdim=True)


def _inner_by_rows(one: Tensor, other: Tensor) -> Tensor:
    """The same, row by row: exported, one sum of millions in single precision is rounded differently everywhere."""
    return torch.linalg.vecdot(one, other).flatten(1).sum(1).reshape(-1, *(1 for _ in one.shape[1:]))


class LinearOperator(nn.Module, ABC):
    """A linear map from scenes (B, *scene_shape) to snapshots (B, *snapshot_shape).

    Subclasses set ``scene_shape`` and ``snapshot_shape`` and define ``A`` and ``A_adjoint``, and ``gram_solve`` where
    ``A Aᵀ`` has a closed inverse.
    """

    scene_shape: tuple[int, ...]
    snapshot_shape: tuple[int, ...]

    @abstractmethod
    def A(self, scene: Tensor) -> Tensor:
        """Scene (B, *scene_shape) → snapshot (B, *snapshot_shape)."""

    @abstractmethod
    def A_adjoint(self, snapshot: Tensor) -> Tensor:
        """Snapshot → scene, the transpose of ``A``."""

    def forward(self, scene: Tensor) -> Tensor:
        """The same as ``A``."""
        return self.A(scene)

    def gram_solve(
        self,
        snapshot: Tensor,
        shift: float | Tensor,
        *,
        tolerance: float | None = None,
        steps: int = 200,
        start: Tensor | None = None,
    ) -> Tensor:
        """``(A Aᵀ + shift·I)⁻¹ snapshot``, by conjugate gradients unless closed.

        Args:
            snapshot: (B, *snapshot_shape).
            shift: ≥ 0, or a map of the snapshot's size; with 0 the snapshot must lie in the range of A.
            tolerance, steps, start: of the iteration, see ``conjugate_gradients``; closed solutions need none of them.
        """
        return conjugate_gradients(
            lambda y: self.A(self.A_adjoint(y)),
            snapshot,
            shift=shift,
            tolerance=_TOLERANCE[snapshot.dtype] if tolerance is None else tolerance,
            steps=steps,
            start=start,
        )

    def A_dagger(self, snapshot: Tensor) -> Tensor:
        """Least-norm scene that explains the snapshot, ``Aᵀ (A Aᵀ)⁺ snapshot``.

        Warns:
            Diverged: without a closed solution, for a snapshot that the operator cannot make, or that it can make only
                of scenes beyond the precision; the scene is then that of the step which left the least residual.
        """
        self._check("snapshot", snapshot)
        if type(self).gram_solve is not LinearOperator.gram_solve:
            return self.A_adjoint(self.gram_solve(snapshot, 0.0))
        best, tolerance = _Best(snapshot), _TOLERANCE[snapshot.dtype]
        conjugate_gradients(lambda y: self.A(self.A_adjoint(y)), snapshot, tolerance=tolerance, steps=1000, watch=best)
        if best.diverged():
            found = f"its best scene leaves {best.share():.2g} of the snapshot's norm"
            warn(f"A_dagger diverges: {found}; use a regularised decoder such as tikhonov", Diverged, stacklevel=2)
        return self.A_adjoint(best.solution)

    def prox_l2(self, point: Tensor, snapshot: Tensor, rho: float | Tensor) -> Tensor:
        """``argmin_x ½‖A x − snapshot‖² + ρ/2 ‖x − point‖²``, solved in the space of the snapshot.

        By the Woodbury identity it is ``point + Aᵀ (A Aᵀ + ρ I)⁻¹ (snapshot − A point)``.

        Args:
            point: (B, *scene_shape).
            snapshot: (B, *snapshot_shape).
            rho: ρ > 0.
        """
        return point + self.A_adjoint(self.gram_solve(snapshot - self.A(point), rho))

    def _check(self, name: str, tensor: Tensor) -> None:
        if not isinstance(tensor, Tensor) or not tensor.is_floating_point():
            kind, remedy = getattr(tensor, "dtype", type(tensor).__name__), "convert it with torch.as_tensor(…).float()"
            raise SettingError(name, str(kind), "a floating-point torch tensor", remedy)
        shape = self.scene_shape if name == "scene" else self.snapshot_shape
        remedy = "give the camera this size and number of bands, or crop the input"
        if name == "snapshot" and tensor.ndim == 4 and tuple(tensor.shape[2:]) == tuple(shape[1:]):
            remedy = "give the camera as many buckets and channels, or take those of this camera"
        check_shape(name, tensor, ("batch", *shape), remedy)


class SensorColumns(LinearOperator):
    """An operator whose snapshots are wider than the sensor, which is in their middle.

    Args:
        wide: the operator.
        beside: columns to the left and the right of the sensor.
    """

    def __init__(self, wide: LinearOperator, beside: tuple[int, int]) -> None:
        super().__init__()
        self.wide, self.beside, self.scene_shape = wide, beside, wide.scene_shape
        *front, columns = wide.snapshot_shape
        self.snapshot_shape = (*front, columns - sum(beside))

    def A(self, scene: Tensor) -> Tensor:
        left, columns = self.beside[0], self.snapshot_shape[-1]
        return self.wide.A(scene)[..., left : left + columns]

    def A_adjoint(self, snapshot: Tensor) -> Tensor:
        return self.wide.A_adjoint(pad(snapshot, self.beside))


class Buckets(LinearOperator):
    """Operators of the buckets of one sensor, which see the same scene: their snapshots are the channels of one.

    Args:
        parts: of every bucket, with snapshots (B, 1, H, W').
    """

    def __init__(self, parts: Sequence[LinearOperator]) -> None:
        super().__init__()
        self._parts, self.scene_shape = nn.ModuleList(parts), parts[0].scene_shape
        self.snapshot_shape = (len(parts), *parts[0].snapshot_shape[1:])

    @property
    def parts(self) -> list[LinearOperator]:
        """The operator of every bucket."""
        return [part for part in self._parts if isinstance(part, LinearOperator)]

    @classmethod
    def of(cls, parts: Sequence[LinearOperator]) -> LinearOperator:
        """The operator of these buckets; itself for one."""
        return parts[0] if len(parts) == 1 else cls(parts)

    def A(self, scene: Tensor) -> Tensor:
        return torch.cat([part.A(scene) for part in self.parts], 1)

    def A_adjoint(self, snapshot: Tensor) -> Tensor:
        scenes = [part.A_adjoint(one) for part, one in zip(self.parts, snapshot.split(1, 1), strict=True)]
        return torch.stack(scenes).sum(0)


@dataclass(frozen=True)
class Conditioning:
    """Rank, condition number and coherence of a measurement matrix.

    ``condition`` is the ratio of the largest to the smallest non-zero singular value; ``coherence`` the largest cosine
    between two different non-zero columns; ``dark_columns`` counts scene entries that the camera never sees.
    """

    rank: int
    condition: float
    coherence: float
    dark_columns: int
    shape: tuple[int, int]


def sparse_matrix(
    operator: LinearOperator, *, dtype: torch.dtype = torch.float64, batch: int = 256
) -> sparse.csr_matrix:
    """The operator as a sparse matrix, by imaging one scene entry after the other.

    Args:
        operator: any operator, at small size.
        dtype: of the probes.
        batch: probes imaged at once.

    Returns:
        (pixels of the snapshot, entries of the scene), both in C order.

    Raises:
        SettingError: the scene has more than 20 000 entries.
    """
    entries = prod(operator.scene_shape)
    if entries > _LARGEST:
        raise SettingError("explicit matrix", f"{entries} scene entries", f"at most {_LARGEST}", "use a smaller camera")
    columns = []
    with torch.no_grad():
        probe = deepcopy(operator).to("cpu", dtype)
        for start in range(0, entries, batch):
            count = min(batch, entries - start)
            unit = torch.zeros(count, entries, dtype=dtype)
            unit[torch.arange(count), start + torch.arange(count)] = 1
            image = probe.A(unit.reshape(count, *operator.scene_shape)).reshape(count, -1)
            columns.append(sparse.csr_matrix(image.numpy()).T)
    return sparse.hstack(columns).tocsr()


def conditioning(matrix: sparse.csr_matrix | np.ndarray) -> Conditioning:
    """Rank, condition number and coherence of a measurement matrix (dense singular values: small sizes)."""
    dense = np.asarray(matrix.todense()) if isinstance(matrix, sparse.csr_matrix) else np.asarray(matrix)
    singular = np.linalg.svd(dense, compute_uv=False)
    threshold = singular[0] * max(dense.shape) * np.finfo(dense.dtype).eps if singular.size else 0.0
    nonzero = singular[singular > threshold]
    norms = np.linalg.norm(dense, axis=0)
    seen = dense[:, norms > 0] / norms[norms > 0]
    cosines = np.abs(seen.T @ seen)
    np.fill_diagonal(cosines, 0)
    return Conditioning(
        rank=int(nonzero.size),
        condition=float(nonzero[0] / nonzero[-1]) if nonzero.size else float("inf"),
        coherence=float(cosines.max()) if cosines.size else 0.0,
        dark_columns=int((norms == 0).sum()),
        shape=(int(dense.shape[0]), int(dense.shape[1])),
    )
