"""The patch LMMSE that learns its prior from the snapshot: moments against slow loops, gains against the truth."""

import pytest
import torch

from tests.small_scenes import CAMERAS, adapted, camera, noisy, patches, smooth_scene, snapshot, textbook
from tmca.priors import BlockGrid, BlockModel, GaussianPrior
from tmca.priors.expected import error_moments, refitted
from tmca.priors.gaussian_posterior import GaussianSolver
from tmca.sensor import Noise

SCENE = smooth_scene(60, 80, seed=1)
PRIOR = GaussianPrior.learn([SCENE], (4, 12))


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("shot", [0.0, 0.01])
def test_error_moments_are_those_of_the_dense_posterior(name, shot):
    taps = camera(name, 4, 12)
    model = BlockModel.of(taps, PRIOR.block)
    grid = BlockGrid.cover(model, (4, 12), (4, 12))
    windows = grid.code_windows(grid.pad_code(taps.code), [(0, 0)])
    found = error_moments(PRIOR, GaussianSolver(PRIOR, model, Noise(0.05, shot), torch.float64).posterior(windows))
    # complete measurements of the same block, as rows of a dense matrix
    rows = torch.zeros(model.measurements, taps.code[0].numel() * 3, dtype=torch.float64)
    weights = model.complete(windows)[0].flatten(1).mT
    rows.scatter_add_(1, model.pixels(), weights)
    _, error = textbook(PRIOR, rows, torch.zeros(1, len(rows)), 0.05, shot)
    first, last = model.valid
    error = error.reshape(*PRIOR.block, *PRIOR.block)[:, :, first:last, :, :, first:last]
    width = last - first
    for dy, dx in {(0, 0), (1, 0), (2, width - 1), (3, width // 2)}:
        pairs = [
            (error[:, y, x, :, y + sy * dy, x + sx * dx] + error[:, y, x, :, y + sy * dy, x + sx * dx].mT) / 2
            for sy in (-1, 1)
            for sx in (-1, 1)
            for y in range(4)
            for x in range(width)
            if 0 <= y + sy * dy < 4 and 0 <= x + sx * dx < width
        ]
        expected = torch.stack(pairs).sum(0) / 4 / (4 * width)
        torch.testing.assert_close(found[:, :, dy, dx], expected, atol=1e-10, rtol=1e-6)
    assert found[..., width:].abs().max() == 0 if width < 12 else True


def test_a_refitted_prior_has_a_positive_covariance_and_the_estimate_s_moments():
    taps = camera("single disperser", 20, 31)
    grid = BlockGrid.cover(BlockModel.of(taps, PRIOR.block), (20, 31), (4, 8))
    windows = grid.code_windows(grid.pad_code(taps.code), grid.positions[:3])
    unknown = error_moments(PRIOR, GaussianSolver(PRIOR, grid.model, Noise(0.05), torch.float64).posterior(windows))
    fitted = refitted(PRIOR, SCENE[:, :20, :31], unknown)
    assert torch.linalg.eigvalsh(fitted.covariance).min() > 0
    own = GaussianPrior.learn([SCENE[:, :20, :31]], (4, 12))
    torch.testing.assert_close(fitted.moments - unknown, own.moments)
    torch.testing.assert_close(fitted.mean, own.mean)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "size"),
    [("single disperser", (33, 64)), ("dual disperser", (40, 57)), ("two taps per band", (33, 64))],
)
def test_it_finds_the_statistics_that_a_wrong_prior_lacks(name, size):
    """Started from rough white scenes, it comes close to the estimate under the scene's own prior."""
    scene = smooth_scene(*size, seed=9)
    taps = camera(name, *size, seed=3)
    y = noisy(snapshot(taps, scene[None]), 0.02, 0.0)
    rough = torch.rand(3, 60, 80, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    wrong = GaussianPrior.learn([rough], (4, 12))
    right = GaussianPrior.learn([scene], (4, 12))

    def error(decoder):
        return float((decoder(y, taps, 0.02).estimate[0] - scene).square().mean().sqrt())

    before, after, oracle = (error(d) for d in (patches(wrong), adapted(wrong, 12), patches(right)))
    assert before - after > 0.3 * (before - oracle) > 0


def test_without_iterations_it_is_the_patch_lmmse_and_every_snapshot_has_its_own_prior():
    taps = camera("single disperser", 24, 40)
    scenes = torch.stack([smooth_scene(24, 40, seed=s) * gain for s, gain in ((4, 1.0), (5, 0.2))])
    y = noisy(snapshot(taps, scenes), 0.02, 0.005)
    plain, none = (d(y, taps, 0.02, 0.005) for d in (patches(PRIOR), adapted(PRIOR, iterations=0)))
    torch.testing.assert_close(plain.estimate, none.estimate)
    decoder, told = adapted(PRIOR, iterations=2), []
    both = decoder(y, taps, 0.02, 0.005, uncertainty=True, progress=told.append)
    alone = [decoder(one, taps, 0.02, 0.005, uncertainty=True) for one in y.split(1)]
    torch.testing.assert_close(both.estimate, torch.cat([one.estimate for one in alone]))
    torch.testing.assert_close(both.deviation, torch.cat([one.deviation for one in alone]))
    assert told == sorted(told)
    assert told[-1] == pytest.approx(1)


def test_its_deviation_is_the_size_of_its_error():
    taps = camera("single disperser", 40, 60, seed=2)
    scene = smooth_scene(40, 60, seed=12)
    y = noisy(snapshot(taps, scene[None]), 0.03, 0.0)
    found = adapted(PRIOR)(y, taps, 0.03, uncertainty=True)
    error = (found.estimate[0] - scene).square().mean().sqrt()
    assert found.deviation.square().mean().sqrt() == pytest.approx(float(error), rel=0.15)


def test_tiles_follow_statistics_that_change_over_the_image(monkeypatch):
    monkeypatch.setattr("tmca.decoders.adapted._MARGIN", 0)
    white = torch.rand(3, 48, 48, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    scene = torch.cat([0.3 + 0.01 * smooth_scene(48, 48, seed=20), white], dim=2)
    taps = camera("single disperser", 48, 96, seed=4)
    y = noisy(snapshot(taps, scene[None]), 0.05, 0.0)
    found = (adapted(PRIOR, tile=tile)(y, taps, 0.05).estimate[0] for tile in (48, None))
    tiled, whole = (float((one - scene)[..., :32].square().mean()) for one in found)
    assert tiled < 0.5 * whole
