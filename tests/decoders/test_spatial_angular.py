"""The light field's network: convolutions over its two grids, steps on the exact operator, tiles without seams."""

import json
from dataclasses import replace

import pytest
import torch
from torch.nn.functional import conv2d

from tmca.decoders import build_network, first_estimate
from tmca.decoders.nets.spatial_angular import AngularConv, SpatialAngularBody, grid_of_views
from tmca.decoders.nets.tiles import CollapsedNetwork
from tmca.errors import SettingError, ShapeError
from tmca.evaluation.study import read_study
from tmca.operators import TapOperator, Taps
from tmca.sensor import Noise
from tmca.training.light_field import LIGHT_FIELD_PRESETS

NETWORKS = {name: network.decoder for name, network in read_study("light-field").networks.items()}

NOISE = Noise(0.02, 0.005)
TINY = {"width": 4, "blocks": 2}
KINDS = {
    "plain": {"start": "dagger", "stages": 0, **TINY},
    "consistent": {"start": "dagger", "stages": 2, **TINY},
    "shared": {"start": "adjoint", "stages": 2, "shared": True, "gather": 3, **TINY},
}


def operator(views=(3, 3), size=(13, 10), dtype=torch.float32, seed=3):
    """A light-field camera: every view behind a code of its own, all on the same sensor pixels."""
    count = views[0] * views[1]
    code = torch.rand(count, *size, generator=torch.Generator().manual_seed(seed), dtype=dtype).round()
    return TapOperator(Taps(code, tuple(range(count)), (0,) * count, count, size[1]))


def scene_of(camera, batch=2):
    """Views that get darker from top to bottom, so that levels and shot noise differ from tile to tile."""
    generator = torch.Generator().manual_seed(7)
    scene = torch.rand(batch, *camera.scene_shape, generator=generator, dtype=camera.code.dtype)
    return (0.1 + 0.8 * scene) * torch.linspace(1, 0.1, camera.scene_shape[1], dtype=scene.dtype)[:, None]


def trained(name, views=(3, 3), dtype=torch.float32, spread=0.1, **changes):
    """A network whose last layers are not zero, as after training."""
    torch.manual_seed(0)
    settings = {**KINDS[name], **changes}
    network = build_network("spatial-angular", bands=views[0] * views[1], views=list(views), **settings).to(dtype)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(spread * torch.randn(parameter.shape, dtype=dtype))
    return network.eval()


def decoded(network, camera, snapshot, noise=NOISE):
    return network(snapshot, camera, noise, first_estimate(network.start, snapshot, camera, noise))


@pytest.mark.parametrize("views", [(3, 3), (5, 5), (1, 3), (7, 1), (5, 3)])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("layout", [torch.channels_last, torch.contiguous_format])
@pytest.mark.parametrize("batch", [1, 2])
def test_the_angular_convolution_is_a_convolution_over_the_views_of_each_pixel(views, dtype, layout, batch):
    torch.manual_seed(1)
    height, width, inputs, outputs = 5, 4, 3, 6
    layer = AngularConv(inputs, outputs, views).to(dtype)
    light = torch.randn(batch, *views, inputs, height, width, dtype=dtype)
    found = layer(light.flatten(0, 2).contiguous(memory_format=layout)).reshape(batch, *views, outputs, height, width)
    for row, column in ((0, 0), (4, 3), (2, 1)):
        grid = light[..., row, column].permute(0, 3, 1, 2)
        expected = conv2d(grid, layer.weight[..., 0], layer.bias, padding=1)
        torch.testing.assert_close(found[..., row, column].permute(0, 3, 1, 2), expected, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("batch", [1, 2])
def test_the_angular_convolution_keeps_the_memory_as_spatial_ones_want_it(batch):
    layer = AngularConv(16, 16, (5, 5))
    x = torch.randn(25 * batch, 16, 24, 24).contiguous(memory_format=torch.channels_last)
    assert layer(x).is_contiguous(memory_format=torch.channels_last)


def test_dense_connections_bring_every_block_to_the_last_convolution():
    body = SpatialAngularBody(2, (3, 3), 4, 3, 1)
    inputs = [block.spatial.in_channels for block in body.blocks]
    assert inputs == [4, 8, 12]
    assert body.leave.in_channels == 16


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize(
    ("views", "size"), [((3, 3), (16, 16)), ((5, 5), (9, 12)), ((1, 3), (7, 5)), ((3, 5), (1, 1)), ((1, 1), (2, 31))]
)
def test_any_grid_and_size_is_decoded_at_its_own(name, views, size):
    camera = operator(views, size)
    scene = scene_of(camera)
    estimate = decoded(trained(name, views), camera, camera.A(scene))
    assert estimate.shape == scene.shape
    assert estimate.isfinite().all()


def test_the_plain_network_that_was_not_trained_returns_its_first_estimate():
    camera = operator()
    network = build_network("spatial-angular", bands=9, **KINDS["plain"])
    snapshot = camera.A(scene_of(camera))
    start = camera.A_dagger(snapshot)
    assert torch.equal(network(snapshot, camera, NOISE, start), start)


@pytest.mark.parametrize("name", ["consistent", "shared"])
def test_without_noise_the_estimate_explains_the_snapshot(name):
    camera = operator(dtype=torch.float64)
    network, snapshot = trained(name, dtype=torch.float64), camera.A(scene_of(camera))
    estimate = decoded(network, camera, snapshot, Noise())
    torch.testing.assert_close(camera.A(estimate), snapshot, rtol=0, atol=1e-10)
    assert (estimate - camera.A_dagger(snapshot)).abs().max() > 1e-3


def test_the_noisier_the_snapshot_the_less_the_estimate_follows_it():
    camera = operator()
    network = trained("consistent", spread=0.01)
    snapshot = camera.A(scene_of(camera))
    start = camera.A_dagger(snapshot + 0.3)
    misfits = [(camera.A(network(snapshot, camera, Noise(s), start)) - snapshot).abs().mean() for s in (0.0, 0.1, 1.0)]
    assert misfits[0] < misfits[1] < misfits[2]


def test_the_step_is_the_best_linear_one_for_an_error_of_known_size():
    camera = operator((3, 1), (3, 4), dtype=torch.float64)
    network = build_network("spatial-angular", bands=3, views=[3, 1], stages=1, start="dagger").double()
    flat = torch.full((1, 3, 3, 4), 0.5, dtype=torch.float64)
    snapshot = camera.A(flat) + 0.1
    matrix = torch.stack([camera.A(unit.reshape(1, 3, 3, 4)).flatten() for unit in torch.eye(36).double()], dim=1)
    spread = 0.5 * float(torch.nn.functional.softplus(network.error[0].detach()))
    inverse = torch.linalg.inv(spread**2 * matrix @ matrix.T + 0.1**2 * torch.eye(12, dtype=torch.float64))
    estimate = flat.flatten()
    for _ in range(2):  # before it is trained a stage is its step alone; one more step closes the chain
        estimate = estimate + spread**2 * matrix.T @ inverse @ (snapshot.flatten() - matrix @ estimate)
    found = network(snapshot, camera, Noise(0.1), flat)
    torch.testing.assert_close(found.flatten(), estimate, rtol=0, atol=1e-9)


def test_the_plain_network_sees_no_code_the_other_does():
    first, second = operator(), operator(seed=4)
    snapshot = first.A(scene_of(first))
    start = first.A_dagger(snapshot)
    plain, consistent = trained("plain"), trained("consistent")
    assert torch.equal(plain(snapshot, first, NOISE, start), plain(snapshot, second, Noise(1.0), start))
    known = consistent(snapshot, first, NOISE, start)
    assert (consistent(snapshot, second, NOISE, start) - known).abs().max() > 1e-4
    assert (consistent(snapshot, first, Noise(0.3), start) - known).abs().max() > 1e-4
    assert not plain.codes
    assert consistent.codes


def test_without_noise_twice_the_light_makes_twice_the_estimate():
    camera, network = operator(dtype=torch.float64), trained("consistent", dtype=torch.float64)
    snapshot = camera.A(scene_of(camera))
    once, twice = (decoded(network, camera, light * snapshot, Noise()) for light in (1.0, 2.0))
    torch.testing.assert_close(twice, 2 * once)


def test_the_derivative_by_the_codes_is_that_of_finite_differences():
    camera = operator((3, 1), (4, 5), dtype=torch.float64)
    network, scene = trained("consistent", (3, 1), torch.float64), scene_of(camera, 1)
    code = (0.1 + 0.8 * camera.code).requires_grad_()

    def estimate(code):
        changed = TapOperator(replace(camera.taps, code=code))
        return network(changed.A(scene), changed, Noise(0.01), scene.flip(-1))

    assert torch.autograd.gradcheck(estimate, code, fast_mode=True, rtol=1e-3, atol=1e-6)
    reached = torch.autograd.grad(estimate(code).square().sum(), code)[0]
    assert (reached != 0).all()


@pytest.mark.parametrize("noise", [NOISE, Noise()])
def test_gradients_stay_finite_where_no_light_falls(noise):
    camera = operator()
    code = camera.code.clone()
    code[..., 2:5] = 0
    code.requires_grad_()
    dark = TapOperator(replace(camera.taps, code=code))
    snapshot = dark.A(scene_of(camera)) + 0.05 * torch.randn(2, *dark.snapshot_shape)
    network = trained("consistent")
    decoded(network, dark, snapshot, noise).square().sum().backward()
    assert code.grad.isfinite().all()
    assert all(p.grad.isfinite().all() for p in network.parameters())


@pytest.mark.parametrize("name", KINDS)
def test_every_weight_learns(name):
    camera, network = operator(), trained(name)
    decoded(network, camera, camera.A(scene_of(camera))).square().sum().backward()
    still = [n for n, p in network.named_parameters() if p.grad is None or not (p.grad != 0).any()]
    assert not still


@pytest.mark.parametrize("name", ["plain", "consistent"])
def test_a_few_steps_on_one_light_field_bring_the_estimate_closer(name):
    camera = operator(size=(12, 12))
    rows, columns = torch.arange(12.0)[:, None], torch.arange(12.0)
    views = [0.5 + 0.4 * torch.sin(rows - v + 0.7 * (columns - u)) for v in (-1, 0, 1) for u in (-1, 0, 1)]
    scene = torch.stack(views)[None]
    snapshot = camera.A(scene)
    start = camera.A_dagger(snapshot)
    torch.manual_seed(0)
    network = build_network("spatial-angular", bands=9, **{**KINDS[name], "width": 8})
    optimiser = torch.optim.Adam(network.parameters(), lr=1e-2)
    for _ in range(40):
        optimiser.zero_grad()
        (network(snapshot, camera, Noise(), start) - scene).square().mean().backward()
        optimiser.step()
    with torch.no_grad():
        error = (network(snapshot, camera, Noise(), start) - scene).square().mean()
    assert error < 0.7 * (start - scene).square().mean()


@pytest.mark.parametrize("name", KINDS)
def test_settings_survive_json_and_rebuild_the_same_function(name):
    network = trained(name, (3, 5))
    again = build_network(network.kind, **json.loads(json.dumps(network.settings)))
    again.load_state_dict(network.state_dict())
    camera = operator((3, 5))
    snapshot = camera.A(scene_of(camera))
    assert torch.equal(decoded(again, camera, snapshot), decoded(network, camera, snapshot))
    assert again.settings == network.settings


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize(("size", "tile"), [((131, 150), 50), ((97, 61), 33), ((64, 64), 64), ((65, 129), 64)])
def test_tiles_leave_no_seam(name, size, tile):
    camera, network = operator((3, 1), size), trained(name, (3, 1))
    snapshot = camera.A(scene_of(camera, 1))
    whole = CollapsedNetwork(network, camera, NOISE, tile=None)(snapshot)
    tiled = CollapsedNetwork(network, camera, NOISE, tile=tile)(snapshot)
    torch.testing.assert_close(tiled, whole, rtol=0, atol=1e-5)


@pytest.mark.parametrize("axis", [2, 3])
@pytest.mark.parametrize("name", KINDS)
def test_nothing_beyond_the_reach_of_a_network_changes_its_estimate(name, axis):
    network = trained(name, (3, 1), torch.float64)
    length, place = 2 * network.reach + 9, network.reach + 4
    camera = operator((3, 1), (length, 6) if axis == 2 else (6, length), torch.float64)
    snapshot = camera.A(scene_of(camera, 1))
    start = camera.A_dagger(snapshot)
    near, far = start.clone(), start.clone()
    near.narrow(axis, place + 1, 1).add_(0.2)
    far.narrow(axis, place + network.reach + 1, length - place - network.reach - 1).add_(0.2)
    far.narrow(axis, 0, place - network.reach).add_(0.2)
    known, moved, still = (network(snapshot, camera, NOISE, x).select(axis, place) for x in (start, near, far))
    assert (moved - known).abs().max() > 1e-6
    torch.testing.assert_close(still, known, rtol=0, atol=1e-13)


def test_large_tiles_are_cut_to_what_memory_allows():
    small, large = (build_network("spatial-angular", bands=25, width=width) for width in (16, 256))
    assert large.tile < small.tile <= 512


@pytest.mark.parametrize(
    "settings",
    [
        *(pytest.param(own, id=name) for name, own in NETWORKS.items()),
        *(pytest.param(own["decoder"], id=f"training preset {name}") for name, own in LIGHT_FIELD_PRESETS.items()),
    ],
)
def test_a_tile_of_every_preset_takes_a_bounded_number_of_bytes(settings):
    network = build_network(**{**settings, "bands": 25})
    own, margin = network.settings, -(-network.reach // network.multiple) * network.multiple
    cells = ((network.tile + 2 * margin) / own["gather"]) ** 2
    # the features of all blocks but the last stand beside those that they are joined into
    features = 4 * 25 * cells * own["width"] * 2 * (own["blocks"] + 1)
    assert features < 2.5e9


def test_half_precision_leaves_the_steps_precise():
    camera, network = operator((5, 5), (16, 16)), trained("consistent", (5, 5), spread=0.05)
    snapshot = camera.A(scene_of(camera))
    with torch.autocast("cpu", torch.bfloat16):
        rough = decoded(network, camera, snapshot, Noise())
    assert rough.dtype == torch.float32
    torch.testing.assert_close(camera.A(rough), snapshot, rtol=1e-5, atol=1e-4)


def test_a_square_grid_needs_no_name_and_others_do():
    assert grid_of_views(25, None) == (5, 5)
    assert grid_of_views(15, [3, 5]) == (3, 5)
    for bands, views in ((15, None), (25, (3, 5)), (9, (-3, -3))):
        with pytest.raises(SettingError, match="views"):
            grid_of_views(bands, views)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"stages": -1}, "stages"),
        ({"width": 0}, "width 0"),
        ({"blocks": 0}, "0 blocks"),
        ({"gather": 0}, "gather 0"),
        ({"views": [5]}, "numbers that make a network"),
        ({"start": "zero"}, "adjoint, dagger, tikhonov, lmmse"),
        ({"depth": 3}, "depth"),
    ],
)
def test_impossible_settings_are_named(settings, message):
    with pytest.raises(SettingError, match=message):
        build_network("spatial-angular", **settings)


def test_other_views_and_a_dispersed_snapshot_are_named():
    camera, network = operator((3, 1)), trained("consistent", (3, 3))
    snapshot = camera.A(scene_of(camera))
    with pytest.raises(ShapeError, match=r"3.*9"):
        decoded(network, camera, snapshot)
    sheared = TapOperator(replace(camera.taps, offsets=(0, 1, 2), snapshot_width=12))
    with pytest.raises(ShapeError, match=r"12 columns.*10"):
        decoded(trained("consistent", (3, 1)), sheared, sheared.A(scene_of(camera)))
