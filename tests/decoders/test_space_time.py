"""Total variation in space and time: adjoint, an independent solver, its limits."""

import cvxpy
import numpy as np
import pytest
import torch

from tmca.cameras import SpectralCamera
from tmca.decoders.iterative.space_time import slopes, slopes_adjoint, space_time_tv, space_time_variation
from tmca.errors import SettingError
from tmca.operators import SlotwiseDisperser


def operator(slots, size, seed=0):
    chosen = torch.randint(slots, size, generator=torch.Generator().manual_seed(seed))
    shutter = (chosen[None] == torch.arange(slots)[:, None, None]).double()
    own = SpectralCamera(bands=1, size=size, slots=slots, dispersion=0.0)
    return SlotwiseDisperser(torch.ones(slots, *size).double(), shutter, own.dispersion, None, "per-slot", moving=True)


@pytest.mark.parametrize("shape", [(2, 3, 2, 5, 4), (1, 4, 1, 4, 7)])
def test_the_adjoint_is_the_transpose(shape):
    movie = torch.randn(*shape, dtype=torch.float64)
    field = torch.randn(3, *shape, dtype=torch.float64)
    torch.testing.assert_close((slopes(movie, 1.7) * field).sum(), (movie * slopes_adjoint(field, 1.7)).sum())


def test_the_variation_of_a_step_is_its_area():
    movie = torch.zeros(1, 3, 1, 5, 4)
    movie[:, :, :, 2:] = 0.5
    assert space_time_variation(movie, 1.0) == pytest.approx(3 * 4 * 0.5)
    flash = torch.zeros(1, 3, 1, 5, 4)
    flash[:, 1:] = 0.5
    assert space_time_variation(flash, 2.0) == pytest.approx(20 * 0.5 * 2)


def test_it_is_the_minimum_that_a_general_solver_finds():
    own, weight, time = operator(3, (4, 5)), 0.1, 1.5
    snapshot = torch.rand(1, 1, 4, 5, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    found = space_time_tv(own, snapshot, weight, time=time, max_iterations=1500, tolerance=0)
    unknown = [cvxpy.Variable((4, 5)) for _ in range(3)]
    shutter = own.shutter.numpy()
    seen = sum(cvxpy.multiply(shutter[k], unknown[k]) for k in range(3))
    terms = []
    for k in range(3):
        for i in range(4):
            for j in range(5):
                here = unknown[k][i, j]
                rows = unknown[k][i + 1, j] - here if i < 3 else 0
                columns = unknown[k][i, j + 1] - here if j < 4 else 0
                slots = time * (unknown[k + 1][i, j] - here) if k < 2 else 0
                terms.append(cvxpy.norm(cvxpy.hstack([rows, columns, slots])))
    cost = 0.5 * cvxpy.sum_squares(seen - snapshot[0, 0].numpy()) + weight * sum(terms)
    cvxpy.Problem(cvxpy.Minimize(cost)).solve(solver=cvxpy.CLARABEL)
    assert found.objective[-1] == pytest.approx(cost.value, rel=1e-4)


def test_a_heavy_weight_on_time_makes_the_scene_stand_still():
    snapshot = torch.rand(1, 1, 6, 7, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    found = space_time_tv(operator(4, (6, 7)), snapshot, 0.05, time=20.0, max_iterations=1000, tolerance=1e-7)
    assert float((found.estimate - found.estimate.mean(1, keepdim=True)).abs().max()) < 0.01
    assert float(found.estimate.std()) > 0.05


def test_impossible_weights_are_refused():
    own, snapshot = operator(2, (3, 3)), torch.zeros(1, 1, 3, 3, dtype=torch.float64)
    for weight, time in ((0.0, 1.0), (float("nan"), 1.0), (0.1, -1.0)):
        with pytest.raises(SettingError, match="weight, time"):
            space_time_tv(own, snapshot, weight, time=time)


def test_it_ends_by_itself_where_nothing_changes_any_more():
    own = operator(3, (5, 5))
    found = space_time_tv(own, torch.full((1, 1, 5, 5), 0.3, dtype=torch.float64), 0.01, tolerance=1e-3)
    assert found.converged
    np.testing.assert_allclose(found.estimate, 0.3, atol=1e-2)
