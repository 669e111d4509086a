"""What is computed once, a bank of matrices or the factors of all blocks, gives what solving every frame gives."""

import subprocess
import sys
from copy import deepcopy
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import pytest
import torch

from tests.small_scenes import CAMERAS, camera, noisy, smooth_scene, snapshot
from tmca.cameras import LightFieldCamera, Snapshot, SpectralCamera
from tmca.cameras.frames import frame_taps
from tmca.decoders import LMMSE, bank, decode, lmmse, make_decoder
from tmca.decoders.bank import Bank
from tmca.decoders.lmmse import Blend, PatchEstimator
from tmca.decoders.nets.build import build_network
from tmca.decoders.nets.tiles import CollapsedNetwork
from tmca.errors import SettingError
from tmca.operators import TapOperator
from tmca.operators.blocks import BlockGrid, BlockModel
from tmca.priors import GaussianMixturePrior, GaussianPrior
from tmca.priors.folded import FoldedFactors
from tmca.priors.gaussian_posterior import FoldedPosterior, GaussianSolver, explained_variance
from tmca.priors.mixture_posterior import MixturePosterior
from tmca.priors.statistics import lower_inverse
from tmca.sensor import Noise, Sensor

SCENES = [smooth_scene(60, 80, seed=1)]
PRIOR = GaussianPrior.learn(SCENES, (4, 14))
NOISE, SENSOR = Noise(0.02, 0.01), Sensor(read_noise=0.01)
TAKEN = {
    "two buckets": SpectralCamera(3, (21, 30), slots=4, shutter="balanced", buckets=2, period=(4, 6), sensor=SENSOR),
    "fractional": SpectralCamera(3, (22, 31), slots=2, shutter="random", dispersion=0.7, period=4, sensor=SENSOR),
    "light field": LightFieldCamera(3, (20, 25), slots=2, shutter="random", period=6, sensor=SENSOR),
}


@pytest.fixture
def no_room_for_banks(monkeypatch):
    monkeypatch.setattr(Bank, "of", lambda *_: None)


@pytest.fixture(params=["bank", "factors"])
def kept(request):
    """What is computed once."""
    if request.param == "factors":
        request.getfixturevalue("no_room_for_banks")
    return request.param


@cache
def prior_of(channels):
    return GaussianPrior.learn([smooth_scene(40, 50, channels, seed=1)], (6, 12))


@cache
def mixture_of(channels):
    scenes = [smooth_scene(40, 50, channels, seed=1), 0.1 * smooth_scene(40, 50, channels, seed=2)]
    return GaussianMixturePrior.learn(scenes, (6, 12), kinds=3, rank=12, gains=3, samples=300, steps=1)


def check_nothing_changes(estimator, frames, kept, within):
    solved = estimator(frames, uncertainty=True)
    assert getattr(estimator.precompute(), kept)
    found = estimator(frames, uncertainty=True)
    torch.testing.assert_close(found.estimate, solved.estimate, rtol=0, atol=within)
    torch.testing.assert_close(found.deviation, solved.deviation.expand_as(found.deviation), rtol=0, atol=100 * within)


@pytest.mark.parametrize("pays", [True, False])
def test_factors_are_the_same_however_blocks_are_solved(no_room_for_banks, monkeypatch, pays):
    monkeypatch.setattr("tmca.priors.gaussian_posterior.displacement_pays", lambda *_: pays)
    camera = SpectralCamera(3, (12, 33), slots=4, shutter="random", sensor=Sensor(read_noise=0.03))
    frames = camera(smooth_scene(*camera.size, 3, seed=2).float()[None], generator=0)
    check_nothing_changes(PatchEstimator(prior_of(3), camera.taps(), camera.noise), frames, "factors", 1e-5)


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("stride", [None, (3, 4), (2, 5)])
@pytest.mark.parametrize(("size", "period"), [((9, 40), (3, 4)), ((12, 33), (4, 5)), ((7, 23), None), ((3, 9), None)])
def test_frames_are_those_that_are_solved_alone(name, stride, size, period, kept):
    taps = camera(name, *size, period=period)
    scenes = torch.stack([smooth_scene(*size, seed=seed) for seed in (5, 6)])
    frames = noisy(snapshot(taps, scenes), NOISE.read, NOISE.shot)
    estimator = PatchEstimator(PRIOR, taps, NOISE, stride=stride, dtype=torch.float64)
    check_nothing_changes(estimator, frames, kept, 1e-10 if kept == "bank" else 1e-12)


def test_moving_scenes_are_decoded_so(kept):
    shown = TAKEN["two buckets"]
    frames = shown(smooth_scene(21, 30, seed=2).float()[None], generator=0)
    check_nothing_changes(PatchEstimator(prior_of(6), frame_taps(shown, 2), shown.noise), frames, kept, 1e-4)


@pytest.mark.parametrize("name", TAKEN)
def test_every_camera_decodes_a_stream_of_frames_that_have_nothing_in_common(name, kept):
    shown = TAKEN[name] if kept == "bank" else TAKEN[name].replace(period=None)
    channels = shown.taps().scene_shape[0]
    prior = prior_of(channels)
    prepared = make_decoder("lmmse", shown.kind, {"uncertainty": True}).prepare(shown, prior)
    assert getattr(prepared.state, kept) is not None
    scenes = [smooth_scene(*shown.size, channels, seed=s).float().reshape(1, *shown.scene_shape) for s in range(2)]
    frames = [Snapshot(shown(scene, generator=s).requires_grad_(), shown) for s, scene in enumerate(scenes)]
    for frame, estimate in zip(frames, prepared.stream(frames), strict=True):
        alone = decode(frame, "lmmse", prior=prior, uncertainty=True)
        assert not estimate.values.requires_grad
        torch.testing.assert_close(estimate.values, alone.values, rtol=0, atol=1e-4)
        torch.testing.assert_close(estimate.deviation, alone.deviation, rtol=0, atol=1e-4)
        estimate.deviation.mul_(100)


@pytest.mark.parametrize("what", ["written over", "replaced", "sensor"])
def test_a_camera_that_changed_since_is_refused(what):
    shown = TAKEN["two buckets"].replace()
    prepared = make_decoder("lmmse", shown.kind).prepare(shown, prior_of(3))
    frame = shown(smooth_scene(*shown.size, seed=2).float()[None], generator=0)
    prepared(frame)
    if what == "written over":
        [part for part in (*shown.buffers(), *shown.parameters()) if part.ndim > 2][-1][..., 0].zero_()
    elif what == "replaced":
        shown.load_state_dict(TAKEN["two buckets"].replace(seed=5).state_dict())
    else:
        shown.sensor = Sensor(read_noise=0.1)
    with pytest.raises(SettingError, match=r"changed after prepare.*call prepare again"):
        prepared(frame)


def test_a_copy_of_a_prepared_decoder_decodes():
    shown = TAKEN["two buckets"].replace()
    prepared = make_decoder("lmmse", shown.kind).prepare(shown, prior_of(3))
    frame = shown(smooth_scene(*shown.size, seed=2).float()[None], generator=0)
    other = deepcopy(prepared)
    assert torch.equal(other(frame).values, prepared(frame).values)
    shown.load_state_dict(shown.state_dict())
    prepared(frame)
    [part for part in other.camera.buffers() if part.ndim > 2][-1][..., 0].zero_()
    with pytest.raises(SettingError, match="changed after prepare"):
        other(frame)


def test_networks_start_from_what_was_prepared():
    shown = TAKEN["two buckets"]
    network = build_network("unrolled", bands=3, stages=1, buckets=2)
    run = CollapsedNetwork(network, TapOperator(shown.taps()), shown.noise, prior_of(3))
    frame = shown(smooth_scene(*shown.size, seed=2).float()[None], generator=0)
    alone = run(frame).values
    run.precompute()
    assert run.start.estimator.bank is not None
    torch.testing.assert_close(run(frame).values, alone, rtol=0, atol=1e-4)


@pytest.mark.parametrize("noise", [Noise(0.02), NOISE])
@pytest.mark.parametrize(("size", "period"), [((21, 30), (3, 4)), ((22, 33), (4, 4))])
@pytest.mark.parametrize("name", CAMERAS)
def test_frames_under_a_mixture_are_those_that_are_solved_alone(name, size, period, noise):
    taps = camera(name, *size, period=period)
    scenes = torch.stack([gain * smooth_scene(*size, seed=seed) for gain, seed in ((1, 5), (0.1, 6))])
    frames = noisy(snapshot(taps, scenes), noise.read, noise.shot)
    check_nothing_changes(PatchEstimator(mixture_of(3), taps, noise, dtype=torch.float64), frames, "kept", 1e-9)


@pytest.mark.parametrize("uncertainty", [True, False])
@pytest.mark.parametrize("name", TAKEN)
def test_a_stream_under_a_mixture_makes_its_components_once(name, uncertainty, monkeypatch):
    shown = TAKEN[name]
    channels = shown.taps().scene_shape[0]
    scenes = [smooth_scene(*shown.size, channels, seed=s).float().reshape(1, *shown.scene_shape) for s in range(2)]
    frames = [Snapshot(shown(scene, generator=s), shown) for s, scene in enumerate(scenes)]
    settings = {"uncertainty": uncertainty}
    alone = [decode(frame, "mixture", prior=mixture_of(channels), **settings) for frame in frames]
    prepared = make_decoder("mixture", shown.kind, settings).prepare(shown, mixture_of(channels))
    monkeypatch.setattr(MixturePosterior, "components", lambda *_: pytest.fail("made anew"))
    for estimate, other in zip(prepared.stream(frames), alone, strict=True):
        torch.testing.assert_close(estimate.values, other.values, rtol=0, atol=1e-4)
        if uncertainty:
            torch.testing.assert_close(estimate.deviation, other.deviation, rtol=0, atol=1e-4)


def test_variances_that_were_not_prepared_are_made_when_a_frame_wants_them():
    shown = TAKEN["fractional"]
    frames = shown(smooth_scene(*shown.size, seed=2).float()[None], generator=0)
    estimator = PatchEstimator(mixture_of(3), shown.taps(), shown.noise)
    solved, found = (one(frames, uncertainty=True) for one in (estimator, estimator.precompute(deviation=False)))
    torch.testing.assert_close(found.deviation, solved.deviation, rtol=0, atol=1e-4)


@pytest.mark.parametrize("noise", [Noise(0.02), NOISE])
def test_no_more_is_kept_of_a_mixture_than_is_reckoned_with(noise):
    taps = camera("single disperser", 9, 40, period=(3, 4))
    estimator = PatchEstimator(mixture_of(3), taps, noise, dtype=torch.float64).precompute()
    ((groups, posterior),) = estimator.kept
    tables = [posterior.cross, posterior.signal, posterior.inside, posterior.centre, *posterior.kept.within]
    for part in (*posterior.kept.glances, *posterior.kept.whole):
        tables += [*part.matrices, part.scale, part.offset]
    assert sum(table.nbytes for table in tables) == estimator.solver.kept_bytes(len(groups))


def test_a_subclass_that_prepares_otherwise_is_left_alone():
    class Paired(LMMSE):
        def setup(self, camera, prior):
            return camera, prior

    shown, prior = TAKEN["fractional"], prior_of(3)
    assert Paired().prepare(shown, prior).state == (shown, prior)


@pytest.mark.parametrize("hindrance", ["gradients", "memory"])
@pytest.mark.parametrize("prior", [PRIOR, GaussianMixturePrior.of(PRIOR)], ids=["gaussian", "mixture"])
def test_nothing_is_kept_where_it_cannot_be(hindrance, prior, monkeypatch):
    if hindrance == "memory":
        monkeypatch.setattr(bank, "MOST_BYTES", 1000)
        monkeypatch.setattr(lmmse, "MOST_BYTES", 1000)
        monkeypatch.setattr(lmmse, "MOST_FACTOR_BYTES", 1000)
    taps = camera("single disperser", 9, 40, period=(3, 4))
    estimator = PatchEstimator(prior, taps, NOISE, differentiable=hindrance == "gradients").precompute()
    assert estimator.bank is estimator.factors is None
    assert not estimator.kept


def test_no_room_is_made_for_factors_that_are_not_stored(monkeypatch, no_room_for_banks):
    dense = replace(PRIOR, moments=PRIOR.covariance)
    estimator, made = PatchEstimator(dense, camera("single disperser", 9, 40), NOISE, dtype=torch.float32), []
    room = FoldedFactors.room
    monkeypatch.setattr(FoldedFactors, "room", lambda *given: made.append(given) or room(*given))
    assert estimator.precompute().factors is None
    assert not made


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


def test_what_is_stored_are_the_factors(no_room_for_banks):
    taps = camera("single disperser", 7, 23)
    factors = PatchEstimator(PRIOR, taps, NOISE).precompute(deviation=False).factors
    for part, posterior in factors.parts:
        assert len(posterior.folded.triangles) == len(posterior.weights) == len(part)
        assert not posterior.factor.numel()
        assert posterior.known is None
        assert not {"cross", "cross_valid"} & set(vars(posterior))
    assert "rows" not in vars(posterior.solver)
    assert factors.deviation.shape == (1, 3, 7, 23)
    assert not {"rows", "valid_rows"} & set(vars(posterior.solver))
    assert not any({"cross", "cross_valid"} & set(vars(posterior)) for _, posterior in factors.parts)


def test_bytes_of_what_is_stored_are_those_of_its_room():
    layout = PatchEstimator(PRIOR, camera("single disperser", 7, 23), NOISE).layout
    solver = GaussianSolver(PRIOR, layout.grid.model, NOISE, torch.float32)
    room = FoldedPosterior.room(solver, 5)
    tensors = (room.weights, room.expected, room.folded.triangles, room.folded.across)
    assert FoldedPosterior.bytes_of(solver, 5) == sum(one.nbytes for one in tensors)


def test_frames_of_660_pixels_in_28_bands_have_room():
    model = BlockModel((28, 4, 148), tuple(range(28)), tuple(range(0, 56, 2)), 0)
    blocks = len(BlockGrid.cover(model, (660, 660), (3, 40)).positions)
    solver = SimpleNamespace(model=model, dtype=torch.float32)
    assert 2**31 < FoldedPosterior.bytes_of(solver, blocks) < lmmse.MOST_FACTOR_BYTES


def test_what_stored_blocks_say_is_what_others_say(no_room_for_banks):
    factors = PatchEstimator(PRIOR, camera("single disperser", 7, 23), NOISE).precompute(deviation=False).factors
    part, stored = factors.parts[0]
    windows = factors.layout.grid.code_windows(factors.layout.code, [places[0] for places in part])
    other, measured = stored.solver.posterior(windows, estimates=1), torch.rand(2, stored.expected.shape[1])
    for block in range(len(part)):
        torch.testing.assert_close(stored.log_evidence(block, measured), other.log_evidence(block, measured))
        for one, expected in zip(stored.linear(block), other.linear(block), strict=True):
            torch.testing.assert_close(one, expected)
    torch.testing.assert_close(stored.error_variance(), other.error_variance())


def test_covariances_with_pixels_stay_within_the_memory_where_blocks_are_seldom_alike(monkeypatch):
    taps = camera("single disperser", 40, 40, period=(4, 4))
    code = taps.code.clone()
    code[:, 20:] = torch.rand(code[:, 20:].shape, generator=torch.Generator().manual_seed(0))
    estimator = PatchEstimator(PRIOR, replace(taps, code=code), NOISE, dtype=torch.float32)
    layout, solver = estimator.layout, estimator.solver
    block = layout.grid.model.measurements * solver.mean.numel() * 4
    monkeypatch.setattr(lmmse, "MEMORY", 3 * block)
    for batch in (1, 8, 64):
        for _, posterior in lmmse.solved_parts(layout, solver, layout.groups, batch, False):
            assert posterior.known is None or posterior.known.nbytes <= 3 * block


def test_rows_of_a_covariance_import_no_sympy():
    prior = "GaussianPrior(torch.zeros(1, 2, 3, dtype=torch.float64), torch.ones(1, 1, 2, 3, dtype=torch.float64))"
    work = (
        f"import sys, torch; from tmca.priors import GaussianPrior; {prior}.covariance; print('sympy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", work], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False"]


def test_a_deviation_that_was_stopped_is_computed_anew(monkeypatch, no_room_for_banks):
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


@pytest.mark.parametrize("size", [1, 40, 131, 260])
def test_factors_are_inverted(size):
    root = torch.rand(2, size, size, generator=torch.Generator().manual_seed(size), dtype=torch.float64)
    factor = torch.linalg.cholesky(root @ root.mT + torch.eye(size))
    one = torch.eye(size, dtype=torch.float64).expand(2, -1, -1)
    torch.testing.assert_close(lower_inverse(factor) @ factor, one)
