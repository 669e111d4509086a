"""Blocks that all see other parts of a code are solved once; frames after that are what solving them anew gives."""

from dataclasses import replace

import pytest
import torch

from tests.small_scenes import CAMERAS, camera, noisy, smooth_scene, snapshot
from tmca.cameras import LightFieldCamera, Snapshot, SpectralCamera
from tmca.decoders import decode, lmmse, make_decoder
from tmca.decoders.bank import Bank
from tmca.decoders.lmmse import Blend, PatchEstimator
from tmca.priors import GaussianMixturePrior, GaussianPrior
from tmca.priors.gaussian import GaussianSolver, explained_variance
from tmca.sensor import Noise, Sensor

PRIOR = GaussianPrior.learn([smooth_scene(60, 80, seed=1)], (4, 14))
NOISE, SENSOR = Noise(0.02, 0.01), Sensor(read_noise=0.01)


@pytest.fixture(autouse=True)
def no_room_for_banks(monkeypatch):
    monkeypatch.setattr(Bank, "of", lambda *_: None)


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize(("size", "period"), [((9, 40), (3, 4)), ((7, 23), None), ((3, 9), None)])
def test_frames_are_those_that_are_solved_alone(name, size, period):
    taps = camera(name, *size, period=period)
    scenes = torch.stack([smooth_scene(*size, seed=seed) for seed in (5, 6)])
    frames = noisy(snapshot(taps, scenes), NOISE.read, NOISE.shot)
    estimator = PatchEstimator(PRIOR, taps, NOISE, dtype=torch.float64)
    solved = estimator(frames, uncertainty=True)
    assert estimator.precompute().factors is not None
    found = estimator(frames, uncertainty=True)
    torch.testing.assert_close(found.estimate, solved.estimate, rtol=0, atol=1e-12)
    torch.testing.assert_close(found.deviation, solved.deviation.expand_as(found.deviation), rtol=0, atol=1e-12)


TAKEN = {
    "two buckets": SpectralCamera(3, (21, 30), slots=4, shutter="balanced", buckets=2, sensor=SENSOR),
    "fractional": SpectralCamera(3, (22, 31), slots=2, shutter="random", dispersion=0.7, sensor=SENSOR),
    "light field": LightFieldCamera(3, (20, 25), slots=2, shutter="random", sensor=SENSOR),
}


@pytest.mark.parametrize("name", TAKEN)
def test_a_stream_behind_codes_that_do_not_repeat(name):
    shown = TAKEN[name]
    channels = shown.taps().scene_shape[0]
    prior = GaussianPrior.learn([smooth_scene(40, 50, channels, seed=1)], (6, 12))
    prepared = make_decoder("lmmse", shown.kind, {"uncertainty": True}).prepare(shown, prior)
    assert prepared.state.factors is not None
    scenes = [smooth_scene(*shown.size, channels, seed=s).float().reshape(1, *shown.scene_shape) for s in range(2)]
    frames = [Snapshot(shown(scene, generator=s), shown) for s, scene in enumerate(scenes)]
    for frame, estimate in zip(frames, prepared.stream(frames), strict=True):
        alone = decode(frame, "lmmse", prior=prior, uncertainty=True)
        torch.testing.assert_close(estimate.values, alone.values, rtol=0, atol=1e-5)
        torch.testing.assert_close(estimate.deviation, alone.deviation, rtol=0, atol=1e-5)
        estimate.deviation.mul_(100)


def test_factors_are_left_out_where_memory_mixture_or_gradients_do_not_allow_them(monkeypatch):
    taps = camera("single disperser", 9, 40)
    assert PatchEstimator(PRIOR, taps, NOISE, differentiable=True).precompute().factors is None
    mixture = GaussianMixturePrior.learn([smooth_scene(60, 80, seed=1)], (4, 14), kinds=2, rank=4, samples=200)
    assert PatchEstimator(mixture, taps, NOISE).precompute().factors is None
    dense = replace(PRIOR, moments=PRIOR.covariance)
    assert PatchEstimator(dense, taps, NOISE).precompute().factors is None
    monkeypatch.setattr(lmmse, "MOST_BYTES", 1000)
    assert PatchEstimator(PRIOR, taps, NOISE).precompute().factors is None


def test_no_room_is_made_for_factors_that_are_not_stored(monkeypatch):
    dense = replace(PRIOR, moments=PRIOR.covariance)
    estimator, made = PatchEstimator(dense, camera("single disperser", 9, 40), NOISE, dtype=torch.float32), []
    new_empty = torch.Tensor.new_empty
    monkeypatch.setattr(
        torch.Tensor, "new_empty", lambda *given, **how: made.append(new_empty(*given, **how)) or made[-1]
    )
    assert estimator.precompute().factors is None
    assert all(room.dtype != torch.float64 for room in made)


@pytest.mark.parametrize("name", CAMERAS)
def test_posteriors_with_gradients_are_the_same(name):
    taps = camera(name, 9, 40)
    estimator = PatchEstimator(PRIOR, taps, NOISE, dtype=torch.float64)
    layout, solver = estimator.layout, GaussianSolver(PRIOR, estimator.layout.grid.model, NOISE, torch.float64)
    windows = layout.grid.code_windows(layout.code, layout.grid.positions[:3])
    plain, tracked = (solver.posterior(part, estimates=1) for part in (windows, windows.clone().requires_grad_()))
    assert plain.known is None
    assert tracked.known is not None
    torch.testing.assert_close(tracked.factor.detach(), plain.factor, rtol=1e-9, atol=1e-12)
    measured = torch.rand(2, layout.grid.model.measurements, dtype=torch.float64)
    both = (posterior.moments(range(3), [measured] * 3, True) for posterior in (tracked, plain))
    for one, other in zip(*both, strict=True):
        for value, expected in zip(one, other, strict=True):
            torch.testing.assert_close(value.detach(), expected, rtol=1e-8, atol=1e-10)


def test_what_is_stored_are_the_factors():
    taps = camera("single disperser", 7, 23)
    factors = PatchEstimator(PRIOR, taps, NOISE).precompute(deviation=False).factors
    for part, posterior in factors.parts:
        assert posterior.factor.shape == (len(part), posterior.expected.shape[1], posterior.expected.shape[1])
        assert posterior.known is None
        assert not {"cross", "cross_valid"} & set(vars(posterior))
    assert "rows" not in vars(posterior.solver)
    assert factors.deviation.shape == (1, 3, 7, 23)
    assert not {"rows", "valid_rows"} & set(vars(posterior.solver))
    assert not any({"cross", "cross_valid"} & set(vars(posterior)) for _, posterior in factors.parts)


def test_a_deviation_that_was_stopped_is_computed_anew(monkeypatch):
    taps = camera("single disperser", 9, 40)
    expected = PatchEstimator(PRIOR, taps, NOISE).precompute().factors.deviation
    factors, add, laid = PatchEstimator(PRIOR, taps, NOISE).precompute(deviation=False).factors, Blend._add, []

    def stopped(*given):
        laid.append(add(*given))
        if len(laid) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(Blend, "_add", stopped)
    with pytest.raises(KeyboardInterrupt):
        _ = factors.deviation
    torch.testing.assert_close(factors.deviation, expected, rtol=0, atol=0)


@pytest.mark.parametrize("measurements", [1, 2, 3, 4, 5, 9])
def test_few_measurements_remove_the_variance_that_the_formula_says(measurements):
    generator = torch.Generator().manual_seed(measurements)
    root = torch.rand(measurements, measurements, generator=generator, dtype=torch.float64)
    covariance = root @ root.T + torch.eye(measurements)
    cross = torch.rand(measurements, 6, generator=generator, dtype=torch.float64)
    expected = (cross * torch.linalg.solve(covariance, cross)).sum(0)
    torch.testing.assert_close(explained_variance(torch.linalg.cholesky(covariance), cross), expected)
