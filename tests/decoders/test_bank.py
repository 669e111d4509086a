"""Matrices that are computed once give what solving every frame gives, for every camera, size and stride."""

import pytest
import torch

from tests.small_scenes import CAMERAS, camera, noisy, smooth_scene, snapshot
from tmca.cameras import LightFieldCamera, Snapshot, SpectralCamera
from tmca.cameras.frames import frame_taps
from tmca.decoders import LMMSE, bank, decode, make_decoder
from tmca.decoders.lmmse import PatchEstimator
from tmca.priors import GaussianPrior
from tmca.sensor import Noise, Sensor

PRIOR = GaussianPrior.learn([smooth_scene(60, 80, seed=1)], (4, 14))
NOISE = Noise(0.02, 0.01)


def compared(estimator, frames):
    """What an estimator says of frames before and after its matrices are there."""
    solved = estimator(frames, uncertainty=True)
    estimator.precompute()
    assert estimator.bank is not None
    return estimator(frames, uncertainty=True), solved


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("stride", [None, (3, 4), (2, 5)])
@pytest.mark.parametrize(("size", "period"), [((9, 40), (3, 4)), ((12, 33), (4, 5)), ((7, 23), None), ((3, 9), None)])
def test_frames_are_those_that_are_solved_alone(name, stride, size, period):
    taps = camera(name, *size, period=period)
    scenes = torch.stack([smooth_scene(*size, seed=seed) for seed in (5, 6)])
    frames = noisy(snapshot(taps, scenes), NOISE.read, NOISE.shot)
    found, solved = compared(PatchEstimator(PRIOR, taps, NOISE, stride=stride, dtype=torch.float64), frames)
    torch.testing.assert_close(found.estimate, solved.estimate, rtol=0, atol=1e-10)
    torch.testing.assert_close(found.deviation, solved.deviation, rtol=0, atol=1e-8)


SENSOR = Sensor(read_noise=0.01)
TAKEN = {
    "two buckets": SpectralCamera(3, (21, 30), slots=4, shutter="balanced", buckets=2, period=(4, 6), sensor=SENSOR),
    "fractional": SpectralCamera(3, (22, 31), slots=2, shutter="random", dispersion=0.7, period=4, sensor=SENSOR),
    "light field": LightFieldCamera(3, (20, 25), slots=2, shutter="random", period=6, sensor=SENSOR),
}


@pytest.mark.parametrize("name", TAKEN)
def test_every_camera_is_decoded_so(name):
    shown = TAKEN[name]
    channels = shown.taps().scene_shape[0]
    prior = GaussianPrior.learn([smooth_scene(40, 50, channels, seed=1)], (6, 12))
    frames = shown(
        smooth_scene(*shown.size, channels, seed=2).float()[None].reshape(1, *shown.scene_shape), generator=0
    )
    found, solved = compared(PatchEstimator(prior, shown.taps(), shown.noise), frames)
    torch.testing.assert_close(found.estimate, solved.estimate, rtol=0, atol=1e-4)
    torch.testing.assert_close(found.deviation, solved.deviation, rtol=0, atol=1e-4)


def test_moving_scenes_are_decoded_so():
    shown = TAKEN["two buckets"]
    taps = frame_taps(shown, 2)
    prior = GaussianPrior.learn([smooth_scene(40, 50, 6, seed=1)], (6, 12))
    frames = shown(smooth_scene(21, 30, seed=2).float()[None], generator=0)
    found, solved = compared(PatchEstimator(prior, taps, shown.noise), frames)
    torch.testing.assert_close(found.estimate, solved.estimate, rtol=0, atol=1e-4)


def test_a_prepared_decoder_decodes_a_stream_of_frames():
    shown = TAKEN["fractional"]
    prior = GaussianPrior.learn([smooth_scene(40, 50, seed=1)], (6, 12))
    prepared = make_decoder("lmmse", "spectral", {"uncertainty": True}).prepare(shown, prior)
    assert prepared.state.bank is not None
    frames = [Snapshot(shown(smooth_scene(*shown.size, seed=s).float()[None], generator=s), shown) for s in range(3)]
    for frame, estimate in zip(frames, prepared.stream(frames), strict=True):
        alone = decode(frame, "lmmse", prior=prior, uncertainty=True)
        torch.testing.assert_close(estimate.values, alone.values, rtol=0, atol=1e-4)
        torch.testing.assert_close(estimate.deviation, alone.deviation, rtol=0, atol=1e-4)


def test_what_is_done_to_an_estimate_does_not_reach_the_next():
    shown = TAKEN["fractional"]
    prior = GaussianPrior.learn([smooth_scene(40, 50, seed=1)], (6, 12))
    prepared = make_decoder("lmmse", "spectral", {"uncertainty": True}).prepare(shown, prior)
    frame = shown(smooth_scene(*shown.size, seed=2).float()[None], generator=0).requires_grad_()
    first = prepared(frame)
    assert not first.values.requires_grad
    kept = first.deviation.clone()
    first.deviation.mul_(100)
    torch.testing.assert_close(prepared(frame).deviation, kept, rtol=0, atol=0)


def test_where_gradients_are_asked_for_nothing_is_prepared():
    taps = camera("single disperser", 9, 40, period=(3, 4))
    estimator = PatchEstimator(PRIOR, taps, NOISE, differentiable=True)
    assert estimator.precompute().bank is None


def test_a_subclass_that_prepares_otherwise_is_left_alone():
    class Paired(LMMSE):
        def setup(self, camera, prior):
            return camera, prior

    shown = TAKEN["fractional"]
    prior = GaussianPrior.learn([smooth_scene(40, 50, seed=1)], (6, 12))
    assert Paired().prepare(shown, prior).state == (shown, prior)


def test_matrices_that_take_too_much_room_are_left_out(monkeypatch):
    monkeypatch.setattr(bank, "MOST_BYTES", 1000)
    estimator = PatchEstimator(PRIOR, camera("single disperser", 9, 40), NOISE)
    estimator.precompute()
    assert estimator.bank is None
