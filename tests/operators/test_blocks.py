"""Blocks: complete measurements hold all the light they see, and nothing else's; covariances by displacement."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.small_scenes import CAMERAS, camera, matrix, noisy, smooth_scene, snapshot
from tmca.errors import ShapeError
from tmca.operators.blocks import MeasurementCovariance, Smoothing
from tmca.priors import BlockGrid, BlockModel, GaussianPrior
from tmca.priors.derivatives import DisplacedSignal
from tmca.priors.gaussian_posterior import NOISE_FLOOR, GaussianSolver
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


SIDES = [(2, 9), (3, 8), (1, 7), (4, 5)]


def one_sided(channels, h, w):
    """A covariance that is not the same in mirror image: of scenes that a lopsided kernel drew."""
    kernel = torch.rand(channels, channels, 2, 3, dtype=torch.float64)
    big = torch.zeros(channels, channels, 2 * h + 4, 2 * w + 4, dtype=torch.float64)
    big[..., :2, :3] = kernel
    waves = torch.fft.fft2(big)
    power = torch.einsum("abyx,cbyx->acyx", waves, waves.conj())
    both = torch.fft.ifft2(power).real
    lags = both.roll((h - 1, w - 1), (2, 3))[..., : 2 * h - 1, : 2 * w - 1]
    return GaussianPrior(torch.zeros(channels, h, w, dtype=torch.float64), lags.flip(2, 3).contiguous())


def priors(h, w):
    return GaussianPrior.learn([smooth_scene(30, 40, seed=1)], (h, w)), one_sided(3, h, w)


def dense(model, weights, block):
    """(m, n) A of one block, from its definition: the light that taps bring to every measurement."""
    matrix = torch.zeros(model.measurements, *model.block, dtype=weights.dtype)
    h, columns = model.block[1], model.columns
    for bucket in range(model.buckets):
        for row in range(h):
            for column in range(columns):
                for tap, (channel, offset) in enumerate(zip(model.channels, model.offsets, strict=True)):
                    weight = weights[block, tap, bucket * h + row, column]
                    matrix[(bucket * h + row) * columns + column, channel, row, model.span + column - offset] += weight
    return matrix.flatten(1)


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("sides", SIDES)
@pytest.mark.parametrize("buckets", [1, 2])
def test_covariances_of_measurements_are_those_of_the_matrices(name, sides, buckets):
    model = BlockModel.of(camera(name, 5, 17), (3, *sides)).for_buckets(buckets)
    weights = torch.rand(2, len(model.offsets), buckets * sides[0], model.columns, dtype=torch.float64)
    for prior in priors(*sides):
        found = MeasurementCovariance(prior.displaced, model)(weights)
        for block in range(2):
            whole = dense(model, weights, block)
            expected = whole @ prior.covariance @ whole.T
            torch.testing.assert_close(found[block], expected, rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize("buckets", [1, 2])
def test_covariances_of_measurements_have_their_derivatives(buckets):
    model = BlockModel.of(camera(next(iter(CAMERAS)), 5, 17), (3, 3, 8)).for_buckets(buckets)
    for prior in priors(3, 8):
        covariance = MeasurementCovariance(prior.displaced, model)
        weights = torch.rand(2, len(model.offsets), buckets * 3, model.columns, dtype=torch.float64, requires_grad=True)
        assert torch.autograd.gradcheck(lambda some, of=covariance: DisplacedSignal.apply(some, of), weights)


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("buckets", [1, 2])
def test_measurements_are_spread_by_the_transpose(name, buckets):
    model = BlockModel.of(camera(name, 5, 17), (3, 3, 8)).for_buckets(buckets)
    weights = torch.rand(1, len(model.offsets), buckets * 3, model.columns, dtype=torch.float64)
    measured = torch.rand(4, model.measurements, dtype=torch.float64)
    expected = measured @ dense(model, weights, 0)
    torch.testing.assert_close(model.spread(weights.expand(4, -1, -1, -1), measured), expected)


@pytest.mark.parametrize("sides", SIDES)
def test_products_are_those_of_the_dense_covariance(sides):
    blocks = torch.rand(5, 3 * sides[0] * sides[1], dtype=torch.float64)
    for prior in priors(*sides):
        torch.testing.assert_close(
            Smoothing(prior.displaced)(blocks), blocks @ prior.covariance, rtol=1e-10, atol=1e-13
        )
