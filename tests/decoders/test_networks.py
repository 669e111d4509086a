"""Neural decoders: what they compute before they are trained, at any size, and where their gradients go."""

import json
from dataclasses import replace

import pytest
import torch

from tmca.cameras import SpectralCamera
from tmca.decoders import build_network, first_estimate
from tmca.decoders.nets.network import code_maps, local_level
from tmca.errors import SettingError, ShapeError
from tmca.operators import TapOperator
from tmca.sensor import Noise

TINY = {"widths": [6, 8], "blocks": 1}
NOISE = Noise(0.01, 0.002)
KINDS = {
    "thesis": ("unet", {"start": "adjoint", "codes": False, "noise_aware": False, **TINY}),
    "unet": ("unet", {"start": "dagger", "widths": [6, 8, 8], "blocks": 1}),
    "unrolled": ("unrolled", {"start": "dagger", "stages": 2, **TINY}),
    "shared": ("unrolled", {"start": "dagger", "stages": 3, "shared": True, **TINY}),
}


def camera(size=(9, 12), bands=3, **settings):
    return SpectralCamera(bands, size, slots=4, seed=2, **settings)


def trained(name, bands=3, spread=0.05, dtype=torch.float32):
    """A network whose last layers are not zero, as after training."""
    kind, settings = KINDS[name]
    torch.manual_seed(0)
    network = build_network(kind, bands=bands, **settings).to(dtype)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(spread * torch.randn(parameter.shape, dtype=dtype))
    return network


def scenes(operator, batch=2, dtype=torch.float32):
    generator = torch.Generator().manual_seed(7)
    return 0.1 + 0.8 * torch.rand(batch, *operator.scene_shape, generator=generator, dtype=dtype)


def decoded(network, operator, snapshot, noise=NOISE):
    return network(snapshot, operator, noise, first_estimate(network.start, snapshot, operator, noise))


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("size", [(16, 16), (9, 12), (7, 5), (1, 1), (2, 31)])
def test_every_size_of_scene_is_decoded_at_its_own_size(name, size):
    operator = camera(size).operator()
    scene = scenes(operator)
    estimate = decoded(trained(name), operator, operator.A(scene))
    assert estimate.shape == scene.shape
    assert estimate.isfinite().all()


@pytest.mark.parametrize("name", KINDS)
def test_one_band_is_enough(name):
    operator = camera(bands=1).operator()
    scene = scenes(operator)
    assert decoded(trained(name, bands=1), operator, operator.A(scene)).shape == scene.shape


@pytest.mark.parametrize("name", ["unet", "unrolled", "shared"])
@pytest.mark.parametrize("dispersion", [1.0, 0.5])
def test_a_network_that_was_not_trained_returns_its_first_estimate(name, dispersion):
    operator = camera(dispersion=dispersion).operator()
    kind, settings = KINDS[name]
    network = build_network(kind, bands=3, **settings)
    snapshot = operator.A(scenes(operator))
    start = first_estimate("dagger", snapshot, operator, NOISE)
    torch.testing.assert_close(network(snapshot, operator, NOISE, start), start, rtol=0, atol=0)


@pytest.mark.parametrize("name", KINDS)
def test_settings_survive_json_and_rebuild_the_same_function(name):
    network = trained(name)
    kind, settings = network.kind, json.loads(json.dumps(network.settings))
    again = build_network(kind, **settings)
    again.load_state_dict(network.state_dict())
    operator = camera().operator()
    snapshot = operator.A(scenes(operator))
    assert torch.equal(decoded(again, operator, snapshot), decoded(network, operator, snapshot))
    assert again.settings == network.settings


@pytest.mark.parametrize("name", KINDS)
def test_an_estimate_depends_on_its_own_snapshot_only(name):
    operator, network = camera().operator(), trained(name)
    bright = scenes(operator, batch=3) * torch.tensor([1.0, 0.3, 0.05])[:, None, None, None]
    together = decoded(network, operator, operator.A(bright))
    alone = torch.cat([decoded(network, operator, operator.A(scene[None])) for scene in bright])
    torch.testing.assert_close(together, alone, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("name", ["unet", "unrolled"])
def test_without_noise_brighter_light_makes_a_brighter_estimate_of_the_same_scene(name):
    operator, network = camera().operator(), trained(name, dtype=torch.float64).double()
    operator = operator.double()
    snapshot = operator.A(scenes(operator, dtype=torch.float64))
    once, twice = (decoded(network, operator, light * snapshot, Noise()) for light in (1.0, 2.0))
    torch.testing.assert_close(twice, 2 * once)


def test_the_thesis_network_sees_no_code():
    network, first, second = trained("thesis"), camera().operator(), camera(aperture="static").operator()
    snapshot = first.A(scenes(first))
    start = first_estimate("adjoint", snapshot, first, NOISE)
    assert torch.equal(network(snapshot, first, NOISE, start), network(snapshot, second, Noise(1.0), start))


@pytest.mark.parametrize("name", ["unet", "unrolled"])
def test_the_other_networks_see_code_and_noise(name):
    network, operator = trained(name), camera().operator()
    mirrored = TapOperator(replace(operator.taps, code=operator.code.flip(-1)))
    snapshot = operator.A(scenes(operator))
    start = first_estimate("dagger", snapshot, operator, NOISE)
    known = network(snapshot, operator, NOISE, start)
    assert (network(snapshot, mirrored, NOISE, start) - known).abs().max() > 1e-4
    assert (network(snapshot, operator, Noise(0.3), start) - known).abs().max() > 1e-4


def learned_code(operator, dtype=torch.float64):
    """The operator's code as a leaf, brought inside (0, 1) where no derivative is at a corner."""
    return (0.1 + 0.8 * operator.code.to(dtype)).detach().requires_grad_()


@pytest.mark.parametrize("dispersion", [1.0, 0.5])
@pytest.mark.parametrize("name", KINDS)
def test_the_derivative_by_the_code_is_that_of_finite_differences(name, dispersion):
    taps = camera((4, 6), 2, dispersion=dispersion).operator().taps
    code, network = learned_code(TapOperator(taps)), trained(name, bands=2, dtype=torch.float64)
    scene, generator = scenes(TapOperator(taps), 1, torch.float64), torch.Generator().manual_seed(1)
    given = scenes(TapOperator(taps), 1, torch.float64).flip(-1)

    def estimate(code):
        operator = TapOperator(replace(taps, code=code))
        return network(operator.A(scene), operator, Noise(0.01), given)

    reached = torch.autograd.grad(estimate(code).square().sum(), code, allow_unused=True)[0]
    if name == "thesis":  # it sees the code through its first estimate alone
        assert reached is None
        return
    assert reached.isfinite().all()
    assert (reached != 0).any(0).all()
    assert torch.autograd.gradcheck(estimate, code, fast_mode=True, rtol=1e-4, atol=1e-6)
    direction = torch.randn(code.shape, generator=generator, dtype=code.dtype)
    step = 1e-6 * direction
    slope = (estimate(code + step) - estimate(code - step)).detach() / 2e-6
    exact = torch.autograd.functional.jvp(estimate, code, direction)[1]
    torch.testing.assert_close(exact, slope, rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("kind", ["adjoint", "dagger"])
@pytest.mark.parametrize("dispersion", [1.0, 0.5, [0.0, 1.5, -0.7]])
def test_the_first_estimate_is_differentiable_in_the_code(kind, dispersion):
    taps = camera((3, 5), dispersion=dispersion).operator().taps
    code, snapshot = (
        learned_code(TapOperator(taps)),
        TapOperator(taps).double().A(scenes(TapOperator(taps), 1).double()),
    )

    def estimate(code):
        return first_estimate(kind, snapshot, TapOperator(replace(taps, code=code)), NOISE)

    assert torch.autograd.gradcheck(estimate, code, rtol=1e-3, atol=1e-5)


@pytest.mark.parametrize("dispersion", [1.0, 0.5])
@pytest.mark.parametrize("name", ["unet", "unrolled"])
def test_gradients_stay_finite_where_no_light_falls(name, dispersion):
    taps = camera((6, 9), dispersion=dispersion).operator().taps
    code = taps.code.clone()
    code[..., 2:6] = 0
    code.requires_grad_()
    operator = TapOperator(replace(taps, code=code))
    noise = 0.05 * torch.randn(2, *operator.snapshot_shape, generator=torch.Generator().manual_seed(4))
    network = trained(name)
    estimate = decoded(network, operator, operator.A(scenes(operator)) + noise)
    estimate.square().sum().backward()
    assert code.grad.isfinite().all()
    assert all(p.grad.isfinite().all() for p in network.parameters() if p.grad is not None)


@pytest.mark.parametrize("name", KINDS)
def test_every_weight_learns(name):
    operator, network = camera((12, 12)).operator(), trained(name)
    decoded(network, operator, operator.A(scenes(operator))).square().sum().backward()
    still = [n for n, p in network.named_parameters() if p.grad is None or not (p.grad != 0).any()]
    assert not still


@pytest.mark.parametrize("name", ["unet", "unrolled"])
def test_a_few_steps_on_one_scene_bring_the_estimate_closer(name):
    operator = camera((16, 16)).operator()
    scene = scenes(operator, 1)
    snapshot = operator.A(scene)
    torch.manual_seed(0)
    kind, settings = KINDS[name]
    network = build_network(kind, bands=3, **settings)
    start = first_estimate("dagger", snapshot, operator, Noise())
    optimiser = torch.optim.Adam(network.parameters(), lr=3e-3)
    for _ in range(60):
        optimiser.zero_grad()
        (network(snapshot, operator, Noise(), start) - scene).square().mean().backward()
        optimiser.step()
    with torch.no_grad():
        error = (network(snapshot, operator, Noise(), start) - scene).square().mean()
    assert error < 0.7 * (start - scene).square().mean()


def test_half_precision_leaves_the_data_step_precise():
    operator, network = camera((16, 16)).operator(), trained("unrolled")
    snapshot = operator.A(scenes(operator))
    exact = decoded(network, operator, snapshot)
    with torch.autocast("cpu", torch.bfloat16):
        rough = decoded(network, operator, snapshot)
    assert rough.dtype == torch.float32
    assert (rough - exact).abs().max() < 0.02


def test_other_bands_than_the_network_s_are_named():
    operator, network = camera(bands=4).operator(), trained("unrolled")
    snapshot = operator.A(scenes(operator))
    with pytest.raises(ShapeError, match=r"4.*3"):
        decoded(network, operator, snapshot)


@pytest.mark.parametrize(
    ("kind", "settings", "message"),
    [
        ("unet3", {}, "unet, unrolled"),
        ("unet", {"depth": 3}, "depth"),
        ("unet", {"start": "zero"}, "adjoint, dagger, tikhonov, lmmse"),
        ("unrolled", {"stages": 0}, "stages"),
        ("unrolled", {"widths": []}, "widths"),
        ("unrolled", {"blocks": 0}, "at least 1"),
        ("unet", {"bands": 0}, "bands"),
    ],
)
def test_impossible_settings_are_named(kind, settings, message):
    with pytest.raises(SettingError, match=message):
        build_network(kind, **settings)


def test_a_start_by_a_prior_needs_one():
    operator = camera().operator()
    with pytest.raises(SettingError, match="prior"):
        first_estimate("lmmse", operator.A(scenes(operator)), operator, NOISE)


def test_the_code_of_a_fractional_band_is_the_sum_of_its_taps():
    operator = camera(dispersion=0.5).operator()
    maps = code_maps(operator)[0]
    for band in range(3):
        own = [code for code, channel in zip(operator.code, operator.taps.channels, strict=True) if channel == band]
        torch.testing.assert_close(maps[band], torch.stack(own).sum(0))


def test_the_local_level_is_the_mean_of_a_flat_scene_and_never_zero():
    flat = torch.tensor([0.2, 0.4]).reshape(1, 2, 1, 1).expand(1, 2, 20, 50)
    torch.testing.assert_close(local_level(flat), torch.full((1, 1, 20, 50), 0.3))
    assert local_level(torch.zeros(1, 2, 5, 5)).min() > 0
