"""The least-norm scene by conjugate gradients: exact where it can be, the best step and a warning where it cannot."""

import warnings

import pytest
import torch

from tmca.operators import LinearOperator
from tmca.operators.linear import Diverged


class Matrix(LinearOperator):
    """A matrix as an operator on rows of pixels."""

    def __init__(self, matrix):
        super().__init__()
        self.register_buffer("matrix", matrix)
        self.scene_shape, self.snapshot_shape = (1, 1, matrix.shape[1]), (1, 1, matrix.shape[0])

    def A(self, scene):
        return scene @ self.matrix.mT

    def A_adjoint(self, snapshot):
        return snapshot @ self.matrix


def operator(smallest, rank=40, dtype=torch.float32):
    """Of singular values from 1 to the smallest, zero beyond the rank."""
    source = torch.Generator().manual_seed(0)
    left, right = (torch.linalg.qr(torch.randn(n, n, generator=source, dtype=torch.float64))[0] for n in (40, 60))
    values = torch.logspace(0, smallest, 40, dtype=torch.float64)
    values[rank:] = 0
    return Matrix(((left * values) @ right[:40]).to(dtype))


def taken(camera, noise=0.0, batch=2):
    source = torch.Generator().manual_seed(1)
    exact = camera.A(torch.rand(batch, 1, 1, 60, generator=source).to(camera.matrix))
    return exact + noise * torch.randn(exact.shape, generator=source).to(exact)


@pytest.mark.parametrize("rank", [40, 20])
def test_it_is_the_pseudo_inverse_where_the_operator_makes_the_snapshot(rank):
    camera = operator(-1.5, rank, torch.float64)
    snapshot = taken(camera)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = camera.A_dagger(snapshot)
    torch.testing.assert_close(scene, snapshot @ torch.linalg.pinv(camera.matrix).mT, atol=1e-7, rtol=1e-7)


@pytest.mark.parametrize("smallest", [-1, -2, -3])
def test_what_the_operator_cannot_make_is_left_and_warned_of(smallest):
    camera = operator(smallest, rank=20)
    snapshot = taken(camera, noise=0.05)
    with pytest.warns(Diverged, match="leaves 0"):
        scene = camera.A_dagger(snapshot)
    residual = torch.linalg.vector_norm(camera.A(scene) - snapshot, dim=(1, 2, 3))
    inverse = torch.linalg.pinv(camera.matrix, rtol=1e-6).mT
    least = torch.linalg.vector_norm(camera.A(snapshot @ inverse) - snapshot, dim=(1, 2, 3))
    assert bool((residual < torch.linalg.vector_norm(snapshot, dim=(1, 2, 3))).all())
    assert bool((residual < 3 * least).all())
    assert bool((torch.linalg.vector_norm(scene, dim=(1, 2, 3)) < 30).all())


def test_an_entry_that_converges_is_not_spoilt_by_one_that_does_not():
    camera = operator(-1, rank=20)
    exact = taken(camera)[:1]
    with pytest.warns(Diverged):
        both = camera.A_dagger(torch.cat([exact, taken(camera, noise=0.05)[1:]]))
    torch.testing.assert_close(both[:1], camera.A_dagger(exact), atol=1e-4, rtol=1e-4)
