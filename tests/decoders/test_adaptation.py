"""Test-time adaptation: what is hidden stays hidden, the error that says when to stop is honest, weights stay whole."""

from functools import partial

import pytest
import torch

from tests.decoders.conformance import weights_for
from tests.decoders.test_networks import NOISE, built, operator_of
from tmca.cameras import LightFieldCamera, Snapshot, SpectralCamera, SpectralDepthCamera
from tmca.decoders import Weights, build_network, decode
from tmca.decoders.nets import adaptation
from tmca.decoders.nets.adaptation import Blind, adapt_network, without
from tmca.decoders.nets.starts import VariationStart
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


def run_of(name="unrolled", size=(33, 26), starts=None):
    operator = operator_of((3, 1) if name.startswith("views") else None, size)
    return CollapsedNetwork(built(name, (3, 1) if name.startswith("views") else None), operator, NOISE, starts=starts)


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


@pytest.mark.parametrize("starts", [None, partial(VariationStart, noise=NOISE)], ids=["own", "variation"])
@pytest.mark.parametrize("name", ["unrolled", "views, consistent", "subspace"])
def test_what_is_hidden_says_nothing_of_the_estimate(name, starts):
    run = run_of(name, starts=starts)
    with torch.no_grad():
        for parameter in run.network.parameters():  # untrained ones say nothing
            parameter.add_(0.1 * torch.randn(parameter.shape, generator=torch.Generator().manual_seed(7)))
    check_blind(run, taken(run))


def test_nor_where_first_estimates_are_of_the_lmmse():
    weights = Weights.find("default", 8)
    camera = weights.camera_for((33, 40), sensor=Sensor(read_noise=0.01))
    prior = weights.load_prior(camera)
    run = CollapsedNetwork(weights.network, TapOperator(camera.taps()), camera.noise, prior)
    check_blind(run, camera(torch.rand(1, *camera.scene_shape)).detach())


@torch.no_grad()
def check_blind(run, snapshot):
    hidden = torch.rand(snapshot.shape[-2:], generator=torch.Generator().manual_seed(2)) < 0.2
    other = torch.where(hidden, torch.rand_like(snapshot), snapshot)
    one, same = (Blind.of(run, values, hidden) for values in (snapshot, other))
    assert torch.equal(one.start, same.start)
    estimates = [run.network.outputs(b.snapshot, b.operator, run.noise, b.start)[0] for b in (one, same)]
    assert torch.equal(*estimates)
    unmasked = run.network.outputs(one.snapshot, run.operator, run.noise, one.start)[0]
    assert not torch.equal(estimates[0], unmasked)  # it sees that they are hidden
    seen = torch.where(hidden, snapshot, torch.rand_like(snapshot))
    assert not torch.equal(one.start, Blind.of(run, seen, hidden).start)


@pytest.mark.parametrize("stop", [True, False])
@pytest.mark.parametrize("name", ["unrolled", "views, consistent", "subspace"])
def test_hidden_pixels_are_predicted_better_and_the_given_network_stays(name, stop, monkeypatch):
    monkeypatch.setattr(adaptation, "RATE", 3e-3)
    run = run_of(name)
    before = {key: value.clone() for key, value in run.network.state_dict().items()}
    snapshot = taken(run)
    better = adapt_network(run, snapshot, 20, stop=stop)
    assert better.after < better.before
    assert better.steps == 20 if not stop else 0 < better.steps <= 20
    for key, value in run.network.state_dict().items():
        assert torch.equal(value, before[key])
    assert not torch.equal(better.run(snapshot).values, run(snapshot).values)
    assert str(better).startswith(f"{better.steps} steps, hidden pixels")


def test_where_nothing_is_gained_it_stops_and_the_network_stays_as_it_was(monkeypatch):
    monkeypatch.setattr(adaptation, "RATE", 30.0)  # every step does harm
    learn, steps = adaptation._learn, []
    monkeypatch.setattr(adaptation, "_learn", lambda *given: steps.append(learn(*given)))
    run = run_of()
    snapshot = taken(run)
    spoilt = adapt_network(run, snapshot, 60)
    assert spoilt.steps == 0
    assert spoilt.after == spoilt.before
    assert len(steps) == 15  # three looks
    torch.testing.assert_close(spoilt.run(snapshot).values, run(snapshot).values)
    assert not adapt_network(run, snapshot, 30, stop=False).after <= spoilt.before  # it may not even be a number


def test_dark_pixels_teach_nothing():
    run = CollapsedNetwork(built("unrolled"), operator_of(None, (200, 20)), NOISE)
    dark = torch.zeros(1, *run.operator.snapshot_shape)
    assert str(adapt_network(run, dark, 4)) == "0 steps: the hidden pixels are dark"
    dark[..., 170:, :] = torch.rand(30, dark.shape[-1])
    partly = adapt_network(run, dark, 12, stop=False)
    assert partly.run(dark).values.isfinite().all()
    tiny = CollapsedNetwork(built("unrolled"), operator_of(None, (2, 3)), NOISE)
    few = adapt_network(tiny, torch.rand(1, *tiny.operator.snapshot_shape), 3, stop=False)
    assert few.run(torch.rand(1, *tiny.operator.snapshot_shape)).values.isfinite().all()


@pytest.mark.parametrize("name", [name for name in CAMERAS if name != "light field"])
def test_every_kind_of_taps_is_adapted_to(name):
    camera = CAMERAS[name]
    network = build_network(
        "unrolled", bands=camera.channels, start="dagger", stages=1, widths=[6, 8], blocks=1, buckets=camera.buckets
    )
    run = CollapsedNetwork(network, TapOperator(camera.taps()), NOISE)
    snapshot = camera(torch.rand(1, *camera.scene_shape)).detach()
    assert adapt_network(run, snapshot, 3, stop=False).run(snapshot).values.isfinite().all()


def test_frames_of_several_tiles_count_every_pixel_once():
    operator = operator_of(None, (130, 20))
    whole, parted = (CollapsedNetwork(built("unrolled"), operator, NOISE, tile=tile) for tile in (None, 48))
    heard, snapshot = [], taken(whole, 3)
    one = adapt_network(whole, snapshot, 6, progress=heard.append)
    other = adapt_network(parted.with_network(whole.network), snapshot, 6)
    assert one.before == pytest.approx(other.before, rel=1e-4)
    assert one.after == pytest.approx(other.after, rel=1e-3)
    assert heard == sorted(heard)
    assert heard[-1] == pytest.approx(1.0)


def test_a_decoder_adapts_where_it_is_asked_to_each_snapshot_alone():
    weights = weights_for("spectral", 1)
    camera = weights.camera_for(sensor=Sensor(read_noise=0.01))
    values = camera(torch.rand(2, camera.channels, *camera.size)).detach()
    how = {"weights": weights, "adapt": 2, "early_stop": False}
    both = decode(Snapshot(values, camera), "network", **how)
    alone = [decode(Snapshot(one, camera), "network", **how) for one in values.split(1)]
    torch.testing.assert_close(both.values, torch.cat([one.values for one in alone]))
    assert both.notes["adapted"] == "; ".join(one.notes["adapted"] for one in alone)
    assert both.notes["adapted"].startswith("2 steps, hidden pixels")
    assert "adapted" not in decode(Snapshot(values, camera), "network", weights=weights).notes
    for steps in (-1, "many"):
        with pytest.raises(SettingError, match="adapt"):
            decode(Snapshot(values, camera), "network", weights=weights, adapt=steps)


@pytest.mark.parametrize("exposure", ["equal", "per-slot"])
def test_another_first_estimate_is_that_of_the_decoder_of_its_name(exposure):
    weights = weights_for("spectral", 1)
    camera = weights.camera_for(sensor=Sensor(read_noise=0.01)).replace(exposure=exposure)
    snapshot = Snapshot(camera(torch.rand(2, camera.channels, *camera.size)).detach(), camera)
    singly = [decode(Snapshot(one, camera), "admm-tv-joint").values for one in snapshot.values.split(1)]
    start = VariationStart(camera.operator(), camera.noise, camera.exposures)
    torch.testing.assert_close(start(snapshot.values, None), torch.cat(singly), rtol=0, atol=1e-4)


def test_a_network_adapts_from_another_first_estimate():
    weights = weights_for("spectral", 1)
    camera = weights.camera_for(sensor=Sensor(read_noise=0.01))
    snapshot = Snapshot(camera(torch.rand(1, camera.channels, *camera.size)).detach(), camera)
    own, other = (decode(snapshot, "network", weights=weights, start=start) for start in ("own", "admm-tv-joint"))
    assert not torch.equal(own.values, other.values)
    assert "start" not in own.notes
    assert other.notes["start"] == "admm-tv-joint"
    adapted = decode(snapshot, "network", weights=weights, start="admm-tv-joint", adapt=2, early_stop=False)
    assert adapted.notes["adapted"].startswith("2 steps")
    with pytest.raises(SettingError, match="start: found 'nearest', expected one of own, admm-tv-joint"):
        decode(snapshot, "network", weights=weights, start="nearest")
    with pytest.raises(SettingError, match=r"prior: .* expected none where the network starts from admm-tv-joint"):
        decode(snapshot, "network", weights=weights, start="admm-tv-joint", prior="any.nc")


def test_a_network_of_depth_has_none():
    weights = weights_for("spectral-depth", 1)
    camera = weights.camera_for()
    assert isinstance(camera, SpectralDepthCamera)
    snapshot = Snapshot(torch.rand(1, *camera.snapshot_shape), camera)
    with pytest.raises(SettingError, match="adapt: found 3 on a spectral-depth snapshot"):
        decode(snapshot, "network", weights=weights, adapt=3)
    with pytest.raises(SettingError, match="start: found admm-tv-joint on a spectral-depth snapshot, expected own"):
        decode(snapshot, "network", weights=weights, start="admm-tv-joint")
