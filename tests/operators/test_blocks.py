"""The block model: complete measurements hold all the light they see, and nothing else's."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.small_scenes import CAMERAS, camera, matrix, noisy, smooth_scene, snapshot
from tmca.errors import ShapeError
from tmca.priors import BlockGrid, BlockModel, GaussianPrior
from tmca.priors.gaussian import NOISE_FLOOR, GaussianSolver
from tmca.sensor import Noise

BLOCK = (3, 2, 9)


@pytest.fixture(scope="module")
def prior():
    return GaussianPrior.learn([smooth_scene(30, 40, seed=1)], BLOCK[1:])


def dense_block(taps, grid, place):
    """Dense matrix of one block's measurements on its pixels, from the whole camera's matrix, and the leaking light."""
    (_, h, w), (top, left), model = grid.model.block, place, grid.model
    _, height, width = taps.scene_shape
    rows = [(top + i, left + model.origin + model.span + c) for i in range(h) for c in range(model.columns)]
    whole = matrix(taps).reshape(height, taps.snapshot_width, 3, height, width)
    out, leak = np.zeros((len(rows), 3, h, w)), 0.0
    for r, (y, x) in enumerate(rows):
        if not (0 <= y < height and 0 <= x < taps.snapshot_width):
            continue
        sees = whole[y, x].clone()
        for i in range(h):
            for j in range(w):
                if top + i < height and 0 <= left + j < width:
                    out[r, :, i, j] = sees[:, top + i, left + j]
                    sees[:, top + i, left + j] = 0
        leak = max(leak, float(sees.abs().max()))
    return out.reshape(len(rows), -1), leak


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("frame", [(5, 17), (2, 9), (1, 4), (4, 12)])
def test_complete_measurements_see_no_light_from_outside_the_block(name, frame):
    taps = camera(name, *frame)
    grid = BlockGrid.cover(BlockModel.of(taps, BLOCK), frame, (2, 3))
    for place in grid.positions:
        assert dense_block(taps, grid, place)[1] == 0.0


@pytest.mark.parametrize("name", CAMERAS)
def test_columns_left_out_do_see_light_from_outside(name):
    taps = camera(name, 2, 30)
    model = BlockModel.of(taps, BLOCK)
    if model.span == 0:
        assert model.columns == BLOCK[2]
        return
    whole = matrix(taps).reshape(2, taps.snapshot_width, 3, 2, 30)
    first = 10 + model.origin + model.span
    for column in (first - 1, first + model.columns):
        seen = whole[0, column].clone()
        seen[:, :, 10 : 10 + BLOCK[2]] = 0
        assert seen.abs().max() > 0


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize(("read_noise", "shot"), [(0.0, 0.0), (0.05, 0.0), (0.01, 0.02)])
@pytest.mark.parametrize("estimates", [None, 1])
def test_block_estimate_is_the_textbook_formula_with_borders_and_shot_noise(prior, name, read_noise, shot, estimates):
    taps = camera(name, 5, 17)
    grid = BlockGrid.cover(BlockModel.of(taps, BLOCK), (5, 17), (2, 3))
    y = noisy(snapshot(taps, smooth_scene(5, 17, seed=4)[None]), read_noise, shot)[:, 0]
    solver = GaussianSolver(prior, grid.model, Noise(read_noise, shot), torch.float64)
    posterior = solver.posterior(grid.code_windows(grid.pad_code(taps.code), grid.positions), estimates)
    measured, variance = grid.snapshot_windows(grid.pad_snapshot(y), grid.positions), posterior.error_variance()
    S, mu = prior.covariance.numpy(), prior.mean.flatten().numpy()
    for i, place in enumerate(grid.positions):
        A, _ = dense_block(taps, grid, place)
        R = np.diag(read_noise**2 + NOISE_FLOOR + shot * np.maximum(A @ mu, 0))
        gain = S @ A.T @ np.linalg.inv(A @ S @ A.T + R)
        expected = mu + gain @ (measured[i, 0].numpy() - A @ mu)
        np.testing.assert_allclose(posterior.estimate(i, measured[i])[0].numpy(), expected, atol=2e-6)
        np.testing.assert_allclose(variance[i].numpy(), np.diag(S - gain @ A @ S), atol=1e-8)


def test_judged_columns_lie_wholly_on_complete_measurements():
    model = BlockModel.of(camera("wide and unordered dispersion", 2, 20), BLOCK)
    assert (model.span, model.columns, model.valid) == (4, 5, (4, 5))


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from(sorted(CAMERAS)),
    st.tuples(st.integers(1, 9), st.integers(1, 25)),
    st.tuples(st.integers(1, 3), st.integers(1, 30)),
)
def test_judged_columns_cover_every_frame(name, frame, stride):
    model = BlockModel.of(camera(name, *frame), BLOCK)
    grid = BlockGrid.cover(model, frame, (min(stride[0], BLOCK[1]), stride[1]))
    covered = torch.zeros(frame, dtype=torch.bool)
    for top, left in grid.positions:
        first, last = (max(0, left + edge) for edge in model.valid)
        covered[top : top + BLOCK[1], first:last] = True
    assert covered.all()


def test_a_prior_of_other_bands_or_too_narrow_is_refused():
    for name, block in (("single disperser", (4, 2, 9)), ("wide and unordered dispersion", (3, 2, 4))):
        with pytest.raises(ShapeError) as caught:
            BlockModel.of(camera(name, 4, 20), block)
        assert caught.value.where == "prior"
