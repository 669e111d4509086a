"""Two-headed networks: what they start from, tiles, depth in metres, weights as files."""

import numpy as np
import pytest
import torch

from tmca.cameras import Snapshot, SpectralDepthCamera
from tmca.decoders import PatchLikelihood, Weights, decode
from tmca.decoders.nets.build import build_depth_network
from tmca.decoders.nets.tiles import TwoHeadedNetwork
from tmca.decoders.nets.two_headed import DepthEstimate, first_likelihood, first_stage, white_level
from tmca.decoders.network import NetworkDecoder
from tmca.errors import SettingError
from tmca.operators.window_moments import needed_block
from tmca.optics import PhaseMaskBench
from tmca.priors import GaussianPrior
from tmca.sensor import Sensor

BENCH = PhaseMaskBench(window=(9, 9), mask_pixels=32)
SMALL = {"widths": [6, 8], "blocks": 1, "window": 4}


def camera(size=(30, 37), **changes):
    given = {"planes": 3, "bench": BENCH, "period": 2, "shutter": "one-hot", "filters": "rgbw", "channels": "rgb"}
    given |= {"sensor": Sensor(read_noise=0.01)}
    return SpectralDepthCamera((450e-9, 550e-9, 650e-9), size, 2, **{**given, **changes})


@pytest.fixture(scope="module")
def prior():
    source = torch.Generator().manual_seed(0)
    return GaussianPrior.learn([torch.rand(3, 40, 40, generator=source)], needed_block(4, BENCH.window))


def snapshot_of(made, count=2):
    source = torch.Generator().manual_seed(1)
    depth = torch.full((count, 1, *made.size), 0.7)
    return made(torch.rand(count, *made.scene_shape, generator=source), depth, generator=2)


def trained(made, start, seed=0):
    """A network whose last layers are not zero."""
    network = build_depth_network({**SMALL, "start": start}, made)
    source = torch.Generator().manual_seed(seed)
    for parameter in network.parameters():
        parameter.data += 0.05 * torch.randn(parameter.shape, generator=source)
    return network


@pytest.mark.parametrize("size", [(30, 37), (24, 32)])
def test_an_untrained_network_gives_what_its_first_stage_gives(prior, size):
    made = camera(size)
    network, snapshot = build_depth_network({**SMALL, "start": "likelihood"}, made), snapshot_of(camera(size))
    likelihood = PatchLikelihood(prior, made, 4)
    known, found = likelihood(snapshot), network(snapshot, made, made.noise, first_stage(likelihood, snapshot))
    torch.testing.assert_close(found.cube, known.values)
    assert torch.equal(found.logits.argmax(1), known.planes.argmax(1))
    assert found.logits.shape == (2, 3, *size)


@pytest.mark.parametrize("start", ["snapshot", "likelihood"])
@pytest.mark.parametrize(("size", "period"), [((150, 61), 2), ((149, 64), 3)])  # 3: no divisor of the network's steps
def test_tiles_change_nothing(prior, start, size, period):
    made = camera(size, period=period)
    network, snapshot = trained(made, start), snapshot_of(made, 1)
    whole, tiled = (TwoHeadedNetwork(network, made, prior, tile)(snapshot) for tile in (1000, 37))
    assert network.reach < 60 < whole.values.std() * 1e4  # tiles see less than the frame, and there is a picture
    for one, other in ((whole.values, tiled.values), (whole.depth, tiled.depth), (whole.planes, tiled.planes)):
        torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-5)


def test_prepared_for_many_frames_it_starts_from_the_prepared_likelihood(prior, tmp_path):
    made = camera()
    prior.save(tmp_path / "prior.nc")
    weights = Weights.of(trained(made, "likelihood"), made, str(tmp_path / "prior.nc"))
    taken = Snapshot(snapshot_of(made), made)
    one, other = decode(taken, "network", weights=weights), NetworkDecoder(weights=weights).prepare(made)(taken)
    torch.testing.assert_close(one.values, other.values, rtol=0, atol=5e-3)
    torch.testing.assert_close(1 / one.depth, 1 / other.depth, rtol=0, atol=5e-3)
    assert not torch.equal(one.values, other.values)


def test_white_is_the_level_of_a_white_scene_away_from_the_dark_rim():
    made = camera((40, 44), shutter="random", exposure="per-slot")
    seen = made.exact(torch.ones(1, *made.scene_shape), torch.full((1, 1, 40, 44), 0.7))
    assert float(white_level(made)) == pytest.approx(float(seen[..., 10:30, 10:30].mean()), rel=1e-5)


def test_brightness_changes_the_level_alone():
    made = camera(sensor=Sensor())
    network, snapshot = trained(made, "snapshot"), 0.2 + snapshot_of(made)
    one, other = (network(gain * snapshot, made, made.noise) for gain in (1.0, 3.0))
    torch.testing.assert_close(3 * one.cube, other.cube, rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(one.logits, other.logits, rtol=1e-4, atol=1e-5)


def test_weights_bring_camera_and_network_back(tmp_path, prior):
    made = camera(mask="free-form", rms=0.2e-6)
    network, snapshot = trained(made, "snapshot"), snapshot_of(made)
    file = Weights.of(network, made, "", {"best": {"psnr": 1.0}}).save(tmp_path / "weights.safetensors")
    again = Weights.load(tmp_path)
    assert (again.card, again.camera.planes, again.camera.bench) == ({"best": {"psnr": 1.0}}, made.planes, BENCH)
    torch.testing.assert_close(again.camera.psf(), made.psf())
    assert torch.equal(again.camera.colour(), made.colour())
    assert torch.equal(again.camera.shutter(), made.shutter())
    assert again.same_codes(made)
    assert not again.same_codes(camera(mask="free-form", rms=0.2e-6, seed=1))
    own = again.camera_for(made.size, sensor=made.sensor)
    one, other = TwoHeadedNetwork(network, made)(snapshot), TwoHeadedNetwork(again.network, own)(snapshot)
    torch.testing.assert_close(one.values, other.values, atol=5e-3, rtol=0)  # half precision
    assert again.path == file


def test_windows_hold_a_tile_of_the_codes(prior):
    large = camera(period=16)
    assert build_depth_network({"widths": [6, 8], "blocks": 1}, large).window == 16
    assert build_depth_network({"widths": [6, 8], "blocks": 1}, camera()).window == 12
    with pytest.raises(SettingError, match=r"decoder\.window: found 4 pixels, expected 16 .*leave it out"):
        build_depth_network({**SMALL, "start": "likelihood"}, large)
    network = build_depth_network({**SMALL, "start": "likelihood"}, camera())
    with pytest.raises(SettingError, match=r"window of the weights: found 4 pixels, expected 16 .*trained for such"):
        TwoHeadedNetwork(network, large, prior)


def test_weights_keep_the_first_stage_that_they_were_trained_behind(tmp_path, prior):
    made, own = camera(), {"temperature": 3.0, "reach": 5, "contamination": 0.3}
    network = build_depth_network({**SMALL, "start": "likelihood", **own}, made)
    Weights.of(network, made, "", {}).save(tmp_path / "weights.safetensors")
    again = Weights.load(tmp_path).network
    found = first_likelihood(again, prior, made)
    assert {name: getattr(found, name) for name in own} == own
    snapshot = snapshot_of(made)
    usual = first_likelihood(build_depth_network({**SMALL, "start": "likelihood"}, made), prior, made)
    assert not torch.allclose(found(snapshot).planes, usual(snapshot).planes)


@pytest.mark.parametrize("count", [1, 2, 7])
def test_surprise_is_the_cross_entropy_of_the_planes_around_a_place(count):
    source = torch.Generator().manual_seed(count)
    logits, place = torch.randn(2, count, 3, 4, generator=source), torch.rand(2, 1, 3, 4, generator=source)
    found = DepthEstimate(torch.empty(0), logits).surprise(place)
    for sample, row, column in np.ndindex(2, 3, 4):
        own = float(place[sample, 0, row, column]) * (count - 1)
        below, share = int(own), own - int(own)
        told = logits[sample, :, row, column].log_softmax(0)
        expected = -(1 - share) * told[below] - (share * told[below + 1] if share else 0)
        assert float(found[sample, 0, row, column]) == pytest.approx(float(expected), rel=1e-4, abs=1e-6)


def test_a_network_that_is_sure_of_the_wrong_plane_still_feels_a_slope():
    logits = torch.tensor([0.0, 0, 200, 0])[None, :, None, None].requires_grad_()
    found, place = DepthEstimate(torch.empty(0), logits), torch.zeros(1, 1, 1, 1)
    assert float(torch.autograd.grad((found.place() - place).abs().sum(), logits)[0].abs().max()) == 0
    slope = torch.autograd.grad(found.surprise(place).sum(), logits)[0]
    assert float(slope[0, 0]) < -0.9
    assert float(slope[0, 2]) > 0.9


def test_the_expected_error_is_the_mean_over_planes():
    logits = torch.randn(2, 4, 3, 5, generator=torch.Generator().manual_seed(0))
    place = torch.rand(2, 1, 3, 5, generator=torch.Generator().manual_seed(1))
    found = DepthEstimate(torch.zeros(0), logits).expected_error(place)
    shares = logits.exp() / logits.exp().sum(1, keepdim=True)
    expected = sum(shares[:, d : d + 1] * (d / 3 - place).abs() for d in range(4))
    torch.testing.assert_close(found, expected)
    assert bool((found >= (DepthEstimate(torch.zeros(0), logits).place() - place).abs() - 1e-6).all())


@pytest.mark.parametrize(
    ("call", "where"),
    [
        (lambda network, prior: TwoHeadedNetwork(network, camera(planes=4), prior), "weights"),
        (lambda network, prior: TwoHeadedNetwork(network, camera()), "prior"),
        *((lambda *_, own=own: build_depth_network({**SMALL, **own}, camera()), where) for own, where in (
            ({"start": "guess"}, "start"), ({"depth": 3}, "decoder two-headed"), ({"kind": "unet"}, "decoder"),
        )),
    ],
)  # fmt: skip
def test_networks_of_other_cameras_are_refused(prior, call, where):
    network = build_depth_network({**SMALL, "start": "likelihood"}, camera())
    with pytest.raises(SettingError) as caught:
        call(network, prior)
    assert caught.value.where == where
