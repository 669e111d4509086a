"""What every network that starts from an estimate promises, whichever its kind: a new one is one row of ``KINDS``."""

import json
from dataclasses import replace

import pytest
import torch

from tmca.cameras import SpectralCamera
from tmca.decoders import build_network, first_estimate
from tmca.decoders.nets.network import code_maps, local_level
from tmca.decoders.nets.tiles import CollapsedNetwork
from tmca.errors import SettingError, ShapeError
from tmca.operators import TapOperator, Taps
from tmca.sensor import Noise

NOISE = Noise(0.01, 0.005)
TINY = {"widths": [6, 8], "blocks": 1}
VIEWS = {"width": 4, "blocks": 2}
KINDS = {
    "thesis": ("unet", {"start": "adjoint", "codes": False, "noise_aware": False, **TINY}),
    "unet": ("unet", {"start": "dagger", "widths": [6, 8, 8], "blocks": 1}),
    "unrolled": ("unrolled", {"start": "dagger", "stages": 2, **TINY}),
    "unrolled, shared": ("unrolled", {"start": "dagger", "stages": 3, "shared": True, **TINY}),
    "views": ("spatial-angular", {"start": "dagger", "stages": 0, **VIEWS}),
    "views, consistent": ("spatial-angular", {"start": "dagger", "stages": 2, **VIEWS}),
    "views, shared": ("spatial-angular", {"start": "adjoint", "stages": 2, "shared": True, "gather": 3, **VIEWS}),
    "subspace": ("subspace", {"start": "dagger", "stages": 2, "rank": 3, **TINY}),
}
BLIND = ("thesis", "views")  # they see the code through their first estimate alone
SEEING = ("unet", "unrolled", "views, consistent", "subspace")
every_kind = pytest.mark.parametrize("name", KINDS)
seeing = pytest.mark.parametrize("name", SEEING)


def views_of(name, views=(3, 1)):
    """The views that a network is of, none for cubes."""
    return views if name.startswith("views") else None


def operator_of(views=None, size=(9, 12), dtype=torch.float32, seed=2, dispersion=1.0, bands=3):
    """A spectral camera, or a light field's: every view behind a code of its own, all on the same sensor pixels."""
    if views is None:
        camera = SpectralCamera(bands, size, slots=4, seed=seed, dispersion=dispersion)
        return camera.to(dtype).operator()
    count = views[0] * views[1]
    code = torch.rand(count, *size, generator=torch.Generator().manual_seed(seed), dtype=dtype).round()
    return TapOperator(Taps(code, tuple(range(count)), (0,) * count, count, size[1]))


def recoded(operator, code):
    return TapOperator(replace(operator.taps, code=code))


def built(name, views=None, bands=3):
    kind, settings = KINDS[name]
    if kind == "subspace":
        network = build_network(kind, **settings)
        torch.nn.init.uniform_(network.basis)
        return network.at(torch.linspace(430e-9, 680e-9, bands).tolist())
    own = {} if views is None else {"views": list(views)}
    return build_network(kind, bands=bands if views is None else views[0] * views[1], **settings, **own)


def trained(name, views=None, dtype=torch.float32, spread=0.05, bands=3):
    """A network whose last layers are not zero, as after training."""
    torch.manual_seed(0)
    network = built(name, views, bands).to(dtype).eval()
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(spread * torch.randn(parameter.shape, dtype=dtype))
    return network


def scenes(operator, batch=2):
    """Dark at the foot, so that levels and shot noise differ from tile to tile."""
    generator = torch.Generator().manual_seed(7)
    light = torch.linspace(1, 0.1, operator.scene_shape[1])[:, None]
    scene = 0.1 + 0.8 * torch.rand(batch, *operator.scene_shape, generator=generator)
    return (scene * light).to(operator.code.dtype)


def decoded(network, operator, snapshot, noise=NOISE):
    return network(snapshot, operator, noise, first_estimate(network.start, snapshot, operator, noise))


def pair(name, dtype=torch.float32, size=(9, 12), **camera):
    """A trained network and a camera for it."""
    views = views_of(name)
    return trained(name, views, dtype), operator_of(views, size, dtype, **camera)


@every_kind
@pytest.mark.parametrize("size", [(16, 16), (9, 12), (7, 5), (1, 1), (2, 31)])
@pytest.mark.parametrize("views", [(3, 3), (1, 5), (1, 1)])
def test_any_grid_and_size_is_decoded_at_its_own(name, size, views):
    """A cube has as many bands as the grid has views."""
    count, grid = views[0] * views[1], views_of(name, views)
    operator = operator_of(grid, size, bands=count)
    scene = scenes(operator)
    estimate = decoded(trained(name, grid, bands=count), operator, operator.A(scene))
    assert estimate.shape == scene.shape
    assert estimate.isfinite().all()


@pytest.mark.parametrize("name", ["unet", "unrolled", "unrolled, shared", "views", "subspace"])
@pytest.mark.parametrize("dispersion", [1.0, 0.5])
def test_a_network_that_was_not_trained_returns_its_first_estimate(name, dispersion):
    operator = operator_of(views_of(name), dispersion=dispersion)
    snapshot = operator.A(scenes(operator))
    start = first_estimate("dagger", snapshot, operator, NOISE)
    assert torch.equal(built(name, views_of(name))(snapshot, operator, NOISE, start), start)


@every_kind
def test_settings_survive_json_and_rebuild_the_same_function(name):
    network, operator = pair(name)
    again = build_network(network.kind, **json.loads(json.dumps(network.settings)))
    again.load_state_dict(network.state_dict())
    again = again.at(network.wavelengths) if network.any_bands else again
    snapshot = operator.A(scenes(operator))
    assert torch.equal(decoded(again, operator, snapshot), decoded(network, operator, snapshot))
    assert again.settings == network.settings


@every_kind
def test_an_estimate_depends_on_its_own_snapshot_only(name):
    network, operator = pair(name)
    bright = scenes(operator, batch=3) * torch.tensor([1.0, 0.3, 0.05])[:, None, None, None]
    together = decoded(network, operator, operator.A(bright))
    alone = torch.cat([decoded(network, operator, operator.A(scene[None])) for scene in bright])
    torch.testing.assert_close(together, alone, rtol=1e-5, atol=1e-6)


@seeing
def test_without_noise_twice_the_light_makes_twice_the_estimate(name):
    network, operator = pair(name, torch.float64)
    snapshot = operator.A(scenes(operator))
    once, twice = (decoded(network, operator, light * snapshot, Noise()) for light in (1.0, 2.0))
    torch.testing.assert_close(twice, 2 * once)


@pytest.mark.parametrize("name", [*BLIND, *SEEING])
def test_blind_networks_see_no_code_and_no_noise_and_the_others_do(name):
    network, operator = pair(name)
    mirrored = recoded(operator, operator.code.flip(-1))
    snapshot = operator.A(scenes(operator))
    start = first_estimate("dagger", snapshot, operator, NOISE)
    known = network(snapshot, operator, NOISE, start)
    for other in (network(snapshot, mirrored, NOISE, start), network(snapshot, operator, Noise(0.3), start)):
        assert torch.equal(other, known) if name in BLIND else (other - known).abs().max() > 1e-4
    assert getattr(network, "codes", True) == (name not in BLIND)


def inner_code(operator):
    """The code as a leaf, brought inside (0, 1) where no derivative is at a corner."""
    return (0.1 + 0.8 * operator.code).detach().requires_grad_()


@seeing
@pytest.mark.parametrize("dispersion", [1.0, 0.5])
def test_the_derivative_by_the_code_is_that_of_finite_differences(name, dispersion):
    network, operator = pair(name, torch.float64, (4, 6), dispersion=dispersion)
    scene, code = scenes(operator, 1), inner_code(operator)

    def estimate(code):
        changed = recoded(operator, code)
        return network(changed.A(scene), changed, Noise(0.01), scene.flip(-1))

    reached = torch.autograd.grad(estimate(code).square().sum(), code)[0]
    assert reached.isfinite().all()
    assert (reached != 0).any(0).all()
    assert torch.autograd.gradcheck(estimate, code, fast_mode=True, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("kind", ["adjoint", "dagger"])
@pytest.mark.parametrize("dispersion", [1.0, 0.5, [0.0, 1.5, -0.7]])
def test_the_first_estimate_is_differentiable_in_the_code(kind, dispersion):
    operator = operator_of(size=(2, 4), dtype=torch.float64, dispersion=dispersion)
    snapshot = operator.A(scenes(operator, 1))

    def estimate(code):
        return first_estimate(kind, snapshot, recoded(operator, code), NOISE)

    assert torch.autograd.gradcheck(estimate, inner_code(operator), rtol=1e-3, atol=1e-5)


@seeing
@pytest.mark.parametrize("dispersion", [1.0, 0.5])
@pytest.mark.parametrize("noise", [NOISE, Noise()])
def test_gradients_stay_finite_where_no_light_falls(name, dispersion, noise):
    network, operator = pair(name, dispersion=dispersion)
    code = operator.code.clone()
    code[..., 2:6] = 0
    code.requires_grad_()
    dark = recoded(operator, code)
    snapshot = dark.A(scenes(operator)) + 0.05 * torch.randn(2, *dark.snapshot_shape)
    decoded(network, dark, snapshot, noise).square().sum().backward()
    assert code.grad.isfinite().all()
    assert all(p.grad.isfinite().all() for p in network.parameters() if p.grad is not None)


@every_kind
def test_every_weight_learns(name):
    network, operator = pair(name, size=(12, 12))
    decoded(network, operator, operator.A(scenes(operator))).square().sum().backward()
    still = [n for n, p in network.named_parameters() if p.grad is None or not (p.grad != 0).any()]
    assert not still


@pytest.mark.parametrize("name", ["unet", "unrolled", "views", "views, consistent"])
def test_a_few_steps_on_one_scene_bring_the_estimate_closer(name):
    operator = operator_of(views_of(name, (3, 3)), (16, 16))
    rows, columns = torch.arange(16.0)[:, None], torch.arange(16.0)
    scene = torch.stack([0.5 + 0.4 * torch.sin(rows + c + 0.7 * columns) for c in range(operator.scene_shape[0])])[None]
    snapshot = operator.A(scene)
    torch.manual_seed(0)
    network, start = built(name, views_of(name, (3, 3))), operator.A_dagger(snapshot)
    optimiser = torch.optim.Adam(network.parameters(), lr=1e-2)
    for _ in range(60):
        optimiser.zero_grad()
        (network(snapshot, operator, Noise(), start) - scene).square().mean().backward()
        optimiser.step()
    with torch.no_grad():
        error = (network(snapshot, operator, Noise(), start) - scene).square().mean()
    assert error < 0.7 * (start - scene).square().mean()


@pytest.mark.parametrize("name", ["unrolled", "views, consistent", "subspace"])
def test_half_precision_leaves_the_data_step_precise(name):
    network, operator = pair(name, size=(16, 16))
    snapshot = operator.A(scenes(operator))
    exact = decoded(network, operator, snapshot)
    with torch.autocast("cpu", torch.bfloat16):
        rough = decoded(network, operator, snapshot)
    assert rough.dtype == torch.float32
    assert (rough - exact).abs().max() < 0.02


@pytest.mark.parametrize(
    ("name", "axis"), [(name, axis) for name in KINDS for axis in (2, 3) if axis == 2 or views_of(name)]
)  # tiles of cubes are rows
def test_nothing_beyond_the_reach_of_a_network_changes_its_estimate(name, axis):
    views = views_of(name)
    network = trained(name, views, torch.float64, spread=0.1)
    length, place = 2 * network.reach + 9, network.reach + 4
    operator = operator_of(views, (length, 6) if axis == 2 else (6, length), torch.float64)
    snapshot = operator.A(scenes(operator, 1))
    start = operator.A_dagger(snapshot)
    near, far = start.clone(), start.clone()
    near.narrow(axis, place + 1, 1).add_(0.2)
    far.narrow(axis, place + network.reach + 1, length - place - network.reach - 1).add_(0.2)
    far.narrow(axis, 0, place - network.reach).add_(0.2)
    known, moved, still = (network(snapshot, operator, NOISE, x).select(axis, place) for x in (start, near, far))
    assert (moved - known).abs().max() > 1e-6
    torch.testing.assert_close(still, known, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    ("name", "dispersion"),
    [(name, share) for name in KINDS for share in (1.0, 0.5) if share == 1 or not views_of(name)],
)  # a light field is not dispersed
@pytest.mark.parametrize(("size", "tile"), [((160, 13), 64), ((131, 80), 50), ((203, 13), 37), ((65, 64), 64)])
def test_tiles_leave_no_seam(name, dispersion, size, tile):
    views = views_of(name)
    operator, network = operator_of(views, size, dispersion=dispersion), trained(name, views, spread=0.1)
    snapshot, told = operator.A(scenes(operator, 1)), []
    whole = CollapsedNetwork(network, operator, NOISE, tile=None)(snapshot)
    tiled = CollapsedNetwork(network, operator, NOISE, tile=tile)(snapshot, told.append)
    torch.testing.assert_close(tiled.values, whole.values, rtol=0, atol=1e-5)
    assert (whole.deviation is None) == (name != "subspace")
    if whole.deviation is not None:
        torch.testing.assert_close(tiled.deviation, whole.deviation, rtol=0, atol=1e-5)
    assert told == sorted(told)
    assert told[-1] == pytest.approx(1)


@pytest.mark.parametrize(
    ("kind", "settings", "where"),
    [
        ("unet3", {}, "decoder"), ("unet", {"depth": 3}, "decoder unet"), ("unet", {"start": "zero"}, "start"),
        ("unet", {"bands": 0}, "bands"), ("unrolled", {"stages": 0}, "stages"), ("unrolled", {"widths": []}, "widths"),
        ("unrolled", {"blocks": 0}, "widths"), ("spatial-angular", {"stages": -1}, "size"),
        ("spatial-angular", {"width": 0}, "size"), ("spatial-angular", {"gather": 0}, "size"),
        ("spatial-angular", {"views": [5]}, "decoder spatial-angular"), ("spatial-angular", {"start": "zero"}, "start"),
        ("spatial-angular", {"bands": 15}, "views"), ("spatial-angular", {"bands": 9, "views": [-3, -3]}, "views"),
        ("subspace", {"rank": 0}, "rank"), ("subspace", {"stages": 0}, "stages"), ("subspace", {"knots": 1}, "knots"),
        ("subspace", {"start": "zero"}, "start"),
    ],
)  # fmt: skip
def test_impossible_settings_are_named(kind, settings, where):
    with pytest.raises(SettingError) as caught:
        build_network(kind, **settings)
    assert caught.value.where == where


def test_what_does_not_fit_a_network_is_named():
    operator, light_field = operator_of(bands=4), operator_of((3, 1))
    sheared = TapOperator(replace(light_field.taps, offsets=(0, 1, 2), snapshot_width=14))
    for network, camera in (
        (trained("unrolled"), operator),
        (trained("views, consistent", (3, 3)), light_field),
        (trained("views, consistent", (3, 1)), sheared),
    ):
        with pytest.raises(ShapeError) as caught:
            decoded(network, camera, camera.A(scenes(camera)))
        assert caught.value.where == "network"
    for where, refused in (
        ("prior", lambda: first_estimate("lmmse", operator.A(scenes(operator)), operator, NOISE)),
        ("tile", lambda: CollapsedNetwork(trained("unet"), operator, NOISE, tile=0)),
    ):
        with pytest.raises(SettingError) as refusal:
            refused()
        assert refusal.value.where == where


def test_the_code_of_a_fractional_band_is_the_sum_of_its_taps():
    operator = operator_of(dispersion=0.5)
    maps = code_maps(operator)[0]
    for band in range(3):
        own = [code for code, channel in zip(operator.code, operator.taps.channels, strict=True) if channel == band]
        torch.testing.assert_close(maps[band], torch.stack(own).sum(0))


def test_the_local_level_is_the_mean_of_a_flat_scene_and_never_zero():
    flat = torch.tensor([0.2, 0.4]).reshape(1, 2, 1, 1).expand(1, 2, 20, 50)
    torch.testing.assert_close(local_level(flat), torch.full((1, 1, 20, 50), 0.3))
    assert local_level(torch.zeros(1, 2, 5, 5)).min() > 0


@pytest.mark.parametrize("size", [(7, 20), (40, 75), (33, 34)])
def test_the_local_level_is_the_mean_over_a_square(size):
    start = torch.rand(2, 3, *size, generator=torch.Generator().manual_seed(1))
    square = torch.nn.functional.avg_pool2d(start.mean(1, keepdim=True), 33, 1, 16, count_include_pad=False)
    torch.testing.assert_close(local_level(start), square)
