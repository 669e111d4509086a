"""Scenes of which parts move and parts rest, under a mixture of motions."""

import pytest
import torch

from tests.decoders.test_moving import MOVED, error_db, light_field_that_moves, smoother_scene, taken
from tmca.cameras import Snapshot, SpectralCamera, moving_object
from tmca.cameras.frames import frame_taps
from tmca.decoders import decode
from tmca.decoders.motion_evidence import REST, Evidence, MotionPriors, Motions
from tmca.errors import DataError, SettingError
from tmca.priors import GaussianPrior
from tmca.sensor import Sensor


@pytest.fixture(scope="module")
def prior():
    return GaussianPrior.learn([smoother_scene(48, 52, seed=seed) for seed in range(4)], (14, 18))


def estimates(snapshot, prior, **settings):
    names = ("lmmse", "space-time-lmmse", "space-time-mixture")
    return [decode(snapshot, name, prior=prior, **(settings if name != "lmmse" else {})).values for name in names]


def test_the_parts_of_a_square_of_displacements_fill_it():
    parts = Motions((1.0, -2.0), 3.0).parts()
    assert {part.side for part in parts} == {1.0}
    assert sorted(part.centre for part in parts) == [(y, x) for y in (0.0, 1.0, 2.0) for x in (-3.0, -2.0, -1.0)]
    assert Motions((1.0, -2.0), 1.0).displacements() == [(y, x) for y in (0.75, 1.25) for x in (-2.25, -1.75)]
    assert REST.displacements() == [(0.0, 0.0)]


@pytest.mark.parametrize(("shutter", "buckets"), [("balanced", 2), ("burst", 4)])
def test_a_scene_that_moves_as_a_whole_is_recovered_better_than_without_knowing_how(prior, shutter, buckets):
    snapshot, truth = taken(shutter, buckets, read_noise=0.001)
    _, every, mixed = estimates(snapshot, prior)
    assert error_db(mixed[0], truth) < error_db(every[0], truth) - 1


@pytest.mark.parametrize("noise", [0.001, 0.03])
def test_a_scene_at_rest_loses_next_to_nothing(prior, noise):
    snapshot, truth = taken("balanced", 2, (0.0, 0.0), read_noise=noise)
    still, every, mixed = estimates(snapshot, prior)
    assert error_db(mixed[0], truth) < error_db(still[0], truth) + 0.3
    assert error_db(mixed[0], truth) < error_db(every[0], truth)


def test_an_object_before_a_scene_at_rest(prior):
    scene = smoother_scene(48, 52, seed=9).float()
    camera = SpectralCamera(3, (48, 52), 4, shutter="balanced", buckets=2, sensor=Sensor(read_noise=0.001))
    truth = moving_object(scene, MOVED, 4)
    snapshot = Snapshot(camera(truth[None], generator=0), camera)
    still, every, mixed = estimates(snapshot, prior)
    assert error_db(mixed[0], truth) < min(error_db(every[0], truth), error_db(still[0], truth)) - 1


def test_the_evidence_is_highest_for_the_motion_that_there_was(prior):
    snapshot, _ = taken("balanced", 2, read_noise=0.001)
    camera = snapshot.camera
    priors = MotionPriors(prior, 4, 4.0, (8, 10), frame_taps(camera, 4), camera.noise)
    evidence = Evidence(priors, snapshot.values)
    everywhere = torch.ones(len(evidence.places), dtype=torch.bool)

    def total(*centre):
        return float(evidence.of(priors.solver(0, Motions(centre, 0.5)), everywhere).sum())

    others = [(0.0, 0.0), (-3.0, 2.0), (3.0, 2.0), (1.5, -1.0), (3.0, -3.5)]
    assert total(*MOVED) > max(total(*other) for other in others)


def test_motion_of_nothing_is_the_still_estimate(prior):
    snapshot, _ = taken("balanced", 2, (0.0, 0.0), read_noise=0.01)
    narrow = GaussianPrior.learn([smoother_scene(48, 52, seed=seed) for seed in range(4)], (8, 12))  # no smoother kind
    frames = decode(snapshot, "space-time-mixture", prior=narrow, frames=2, motion=0.0).values
    still = decode(snapshot, "lmmse", prior=narrow).values
    torch.testing.assert_close(frames, still[:, None].expand_as(frames))


def test_the_predicted_deviation_is_that_of_the_errors(prior):
    for moved in (MOVED, (0.0, 0.0)):
        snapshot, truth = taken("balanced", 2, moved, read_noise=0.01)
        estimate = decode(snapshot, "space-time-mixture", prior=prior, uncertainty=True)
        assert estimate.deviation.shape == estimate.values.shape
        ratio = (estimate.values[0] - truth).square().mean() / estimate.deviation[0].square().mean()
        assert 0.4 < float(ratio.sqrt()) < 1.3


def test_a_light_field_that_moves():
    snapshot, moved, prior = light_field_that_moves()
    _, every, mixed = estimates(snapshot, prior)
    assert mixed.shape == moved.shape
    assert error_db(mixed, moved) < error_db(every, moved) - 0.5


@pytest.mark.parametrize(("rest", "motion"), [(0.0, 4.0), (1.0, 4.0), (1.0, 0.0), (0.0, 0.0)])
def test_certain_rest_and_certain_motion(prior, rest, motion):
    snapshot, truth = taken("balanced", 2, read_noise=0.01)
    both = Snapshot(torch.cat([snapshot.values, 0 * snapshot.values]), snapshot.camera)
    values = decode(both, "space-time-mixture", prior=prior, rest=rest, motion=motion).values
    assert values.shape == (2, *truth.shape)
    assert values.isfinite().all()
    alone = decode(snapshot, "space-time-mixture", prior=prior, rest=rest, motion=motion).values
    torch.testing.assert_close(values[:1], alone)


def test_without_evidence_rest_is_as_probable_as_it_was_said_to_be(prior, monkeypatch):
    snapshot, _ = taken("balanced", 2, read_noise=0.01)
    priors = MotionPriors(prior, 4, 4.0, (8, 10), frame_taps(snapshot.camera, 4), snapshot.camera.noise)
    evidence = Evidence(priors, snapshot.values)
    monkeypatch.setattr(evidence, "of", lambda solver, here: torch.where(here, 0.0, -torch.inf).double())
    probable = evidence.probable(0.7)
    at_rest = sum(share for (_, motion), share in probable.items() if motion == REST)
    torch.testing.assert_close(at_rest, torch.full_like(at_rest, 0.7), atol=0.02, rtol=0)


def test_a_prior_that_is_not_the_same_everywhere_is_refused(prior):
    snapshot, _ = taken("balanced", 2, read_noise=0.01)
    narrow = GaussianPrior.learn([smoother_scene(48, 52, seed=0)], (6, 6))
    with pytest.raises(DataError, match="not the same everywhere"):
        decode(snapshot, "space-time-mixture", prior=GaussianPrior(narrow.mean, narrow.covariance))


def test_a_probability_of_rest_beyond_one_is_refused(prior):
    snapshot, _ = taken("balanced", 2, read_noise=0.01)
    with pytest.raises(SettingError, match="rest: found 2, expected 0 to 1"):
        decode(snapshot, "space-time-mixture", prior=prior, rest=2)
