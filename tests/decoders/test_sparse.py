"""Sparse recovery of many signals at once is what scikit-learn and CVXPY find for each alone."""

import cvxpy
import numpy as np
import pytest
import torch
from sklearn.linear_model import Lasso, orthogonal_mp

from tmca.decoders import batch_omp, lasso_admm


def problem(groups=3, signals=2, m=20, columns=45, entries=4, seed=0, dtype=torch.float64, noise=0.0):
    """Matrices of unit columns, sparse codes and what they measure."""
    generator = torch.Generator().manual_seed(seed)
    matrices = torch.nn.functional.normalize(torch.randn(groups, m, columns, generator=generator, dtype=dtype), dim=1)
    codes = torch.zeros(groups, signals, columns, dtype=dtype)
    order = torch.rand(groups, signals, columns, generator=generator).argsort(-1)[..., :entries]
    draw = torch.randn(groups, signals, entries, generator=generator, dtype=dtype)
    codes.scatter_(-1, order, draw.sign() + draw)
    error = torch.randn(groups, signals, m, generator=generator, dtype=dtype)
    return matrices, codes, codes @ matrices.mT + noise * error


@pytest.mark.parametrize("m", [20, 21])
def test_pursuit_takes_the_steps_of_scikit_learn(m):
    matrices, _, measured = problem(m=m, noise=0.3)
    found = batch_omp(matrices, measured, 6)
    for own, signals, codes in zip(matrices, measured, found, strict=True):
        wanted = orthogonal_mp(own.numpy(), signals.mT.numpy(), n_nonzero_coefs=6)
        np.testing.assert_allclose(codes.numpy(), wanted.T, atol=1e-10)


def test_pursuit_stops_at_the_tolerance_of_each_signal():
    matrices, _, measured = problem(noise=0.3)
    limits = torch.tensor([[0.5, 4.0], [1.0, 0.2], [2.0, 0.1]], dtype=torch.float64)
    found = batch_omp(matrices, measured, 15, limits)
    for g, p in np.ndindex(3, 2):
        wanted = orthogonal_mp(matrices[g].numpy(), measured[g, p].numpy(), tol=float(limits[g, p]))
        np.testing.assert_allclose(found[g, p].numpy(), wanted, atol=1e-10)
    assert len(set((found != 0).sum(-1).flatten().tolist())) > 2


def test_pursuit_does_not_care_for_the_length_of_columns():
    matrices, _, measured = problem(noise=0.1)
    lengths = torch.logspace(-3, 3, 45, dtype=torch.float64)
    torch.testing.assert_close(batch_omp(matrices * lengths, measured, 5) * lengths, batch_omp(matrices, measured, 5))


@pytest.mark.parametrize(("dtype", "within"), [(torch.float32, 1e-5), (torch.float64, 1e-12)])
def test_an_exactly_sparse_signal_is_recovered_exactly(dtype, within):
    matrices, codes, measured = problem(m=32, entries=3, dtype=dtype)
    found = batch_omp(matrices, measured, 10)
    assert torch.equal(found != 0, codes != 0)  # it stops by itself, though ten were allowed
    torch.testing.assert_close(found, codes, atol=within, rtol=0)


def test_kept_columns_come_first_and_are_fitted_with_the_rest():
    matrices, _, measured = problem(noise=0.2)
    found = batch_omp(matrices, measured, 4, forced=2)
    assert ((found != 0).sum(-1) == 4).all()
    assert (found[..., :2] != 0).all()
    for g, p in np.ndindex(3, 2):
        support = found[g, p].nonzero()[:, 0]
        fit = torch.linalg.lstsq(matrices[g][:, support], measured[g, p][:, None]).solution[:, 0]
        torch.testing.assert_close(found[g, p, support], fit)


def test_columns_that_measure_nothing_or_the_same_twice_are_no_trouble():
    matrices, _, measured = problem(noise=0.2)
    matrices[..., 0], matrices[..., 1] = 0, matrices[..., 2]
    found = batch_omp(matrices, measured, 20)
    assert (found[..., 0] == 0).all()
    assert found.isfinite().all()
    assert (found @ matrices.mT - measured).abs().max() < 1e-8


@pytest.mark.parametrize(("dtype", "within"), [(torch.float32, 5e-3), (torch.float64, 1e-5)])
def test_lasso_is_that_of_scikit_learn(dtype, within):
    matrices, _, measured = problem(m=21, noise=0.2, dtype=dtype)
    found = lasso_admm(matrices, measured, 0.3, max_iterations=3000, tolerance=within / 1000)
    assert found.converged
    assert found.iterations < 3000
    for g, p in np.ndindex(3, 2):
        model = Lasso(alpha=0.3 / 21, fit_intercept=False, tol=1e-12, max_iter=100000)
        wanted = model.fit(matrices[g].double().numpy(), measured[g, p].double().numpy()).coef_
        np.testing.assert_allclose(found.codes[g, p].numpy(), wanted, atol=within)
        assert (found.codes[g, p] == 0).sum() > 20


def test_weights_by_column_and_free_columns_are_those_of_a_convex_solver():
    matrices, _, measured = problem(groups=2, signals=1, m=12, columns=25, noise=0.3, seed=4)
    weights = torch.linspace(0.05, 1.0, 23, dtype=torch.float64)
    found = lasso_admm(matrices, measured, weights, free=2, max_iterations=5000, tolerance=1e-9)
    for g in range(2):
        x = cvxpy.Variable(25)
        penalty = cvxpy.sum(cvxpy.multiply(weights.numpy(), cvxpy.abs(x[2:])))
        misfit = 0.5 * cvxpy.sum_squares(matrices[g].numpy() @ x - measured[g, 0].numpy())
        cvxpy.Problem(cvxpy.Minimize(misfit + penalty)).solve(solver="CLARABEL")
        np.testing.assert_allclose(found.codes[g, 0].numpy(), x.value, atol=1e-5)
