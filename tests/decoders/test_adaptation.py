"""Test-time adaptation: what is hidden stays hidden, the error that says when to stop is honest, weights stay whole."""

import pytest
import torch

from tests.decoders.conformance import weights_for
from tests.decoders.test_networks import NOISE, built, operator_of
from tmca.cameras import LightFieldCamera, Snapshot, SpectralCamera, SpectralDepthCamera
from tmca.decoders import decode
from tmca.decoders.nets import adaptation
from tmca.decoders.nets.adaptation import Blind, adapted, without
from tmca.decoders.nets.tiles import CollapsedNetwork
from tmca.errors import SettingError
from tmca.operators import TapOperator
from tmca.sensor import Sensor

CAMERAS = {
    "single disperser": SpectralCamera(3, (9, 12), slots=4),
    "part of a pixel": SpectralCamera(3, (8, 11), slots=2, dispersion=0.6),
    "two buckets": SpectralCamera(4, (7, 10), slots=4, buckets=2, shutter="balanced"),
    "dual disperser": SpectralCamera(3, (8, 10), slots=4, disperser="dual"),
    "light field": LightFieldCamera(views=3, size=(8, 9), slots=4),
}


def run_of(name="unrolled", size=(33, 26)):
    operator = operator_of((3, 1) if name.startswith("views") else None, size)
    return CollapsedNetwork(built(name, (3, 1) if name.startswith("views") else None), operator, NOISE)


def taken(run, seed=3):
    random = torch.Generator().manual_seed(seed)
    scene = torch.nn.functional.interpolate(torch.rand(1, 3, 5, 4, generator=random), run.size, mode="bilinear")
    return run.operator.A(scene) + 0.01 * torch.randn(1, *run.operator.snapshot_shape, generator=random)


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_hidden_pixels_see_nothing_and_the_others_what_they_saw(camera):
    operator = TapOperator(camera.taps())
    hidden = torch.rand(operator.snapshot_shape[1:], generator=torch.Generator().manual_seed(1)) < 0.3
    scene = torch.rand(2, *operator.scene_shape)
    seen = TapOperator(without(operator.taps, hidden)).A(scene)
    torch.testing.assert_close(seen, operator.A(scene) * ~hidden)


@pytest.mark.parametrize("name", ["unrolled", "views, consistent", "subspace"])
def test_what_is_hidden_says_nothing_of_the_estimate(name):
    run = run_of(name)
    snapshot = taken(run)
    hidden = torch.rand(snapshot.shape[-2:], generator=torch.Generator().manual_seed(2)) < 0.2
    other = torch.where(hidden, torch.rand_like(snapshot), snapshot)
    one, same = (Blind.of(run, None, values, hidden) for values in (snapshot, other))
    assert torch.equal(one.snapshot, same.snapshot)
    assert torch.equal(one.start, same.start)


@pytest.mark.parametrize("stop", [True, False])
@pytest.mark.parametrize("name", ["unrolled", "views, consistent", "subspace"])
def test_hidden_pixels_are_predicted_better_and_the_given_network_stays(name, stop, monkeypatch):
    monkeypatch.setattr(adaptation, "RATE", 3e-3)
    run = run_of(name)
    before = {key: value.clone() for key, value in run.network.state_dict().items()}
    snapshot = taken(run)
    better = adapted(run, None, snapshot, 20, stop=stop)
    assert better.after < better.before
    assert better.steps == 20 if not stop else 0 < better.steps <= 20
    for key, value in run.network.state_dict().items():
        assert torch.equal(value, before[key])
    assert not torch.equal(better.run(snapshot).values, run(snapshot).values)
    assert str(better).startswith(f"{better.steps} steps, hidden pixels")


def test_where_nothing_is_gained_the_network_stays_as_it_was(monkeypatch):
    monkeypatch.setattr(adaptation, "RATE", 30.0)  # every step does harm
    run = run_of()
    snapshot = taken(run)
    spoilt = adapted(run, None, snapshot, 30)
    assert spoilt.steps == 0
    assert spoilt.after == spoilt.before
    torch.testing.assert_close(spoilt.run(snapshot).values, run(snapshot).values)
    assert not adapted(run, None, snapshot, 30, stop=False).after <= spoilt.before  # it may not even be a number


def test_frames_of_several_tiles_and_several_snapshots():
    run = CollapsedNetwork(built("unrolled"), operator_of(None, (130, 20)), NOISE, tile=48)
    snapshot = torch.cat([taken(run, 3), taken(run, 4)])
    heard = []
    better = adapted(run, None, snapshot, 6, progress=heard.append)
    assert better.run(snapshot).values.shape == (2, 3, 130, 20)
    assert heard == sorted(heard)
    assert heard[-1] == pytest.approx(1.0)


def test_a_decoder_adapts_where_it_is_asked_to():
    weights = weights_for("spectral", 1)
    camera = weights.camera_for(sensor=Sensor(read_noise=0.01))
    snapshot = Snapshot(camera(torch.rand(1, camera.channels, *camera.size)).detach(), camera)
    estimate = decode(snapshot, "network", weights=weights, adapt=2, early_stop=False)
    assert estimate.notes["adapted"].startswith("2 steps, hidden pixels")
    assert "adapted" not in decode(snapshot, "network", weights=weights).notes
    for steps, wanted in ((-1, "adapt"), ("many", "adapt")):
        with pytest.raises(SettingError, match=wanted):
            decode(snapshot, "network", weights=weights, adapt=steps)


def test_a_network_of_depth_has_none():
    weights = weights_for("spectral-depth", 1)
    camera = weights.camera_for()
    assert isinstance(camera, SpectralDepthCamera)
    snapshot = Snapshot(torch.rand(1, *camera.snapshot_shape), camera)
    with pytest.raises(SettingError, match="adapt: found 3 steps on a spectral-depth snapshot"):
        decode(snapshot, "network", weights=weights, adapt=3)
