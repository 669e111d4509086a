"""The spectral-depth camera in training: patches, losses, codes that move, exact resume."""

import zlib
from pathlib import Path

import numpy as np
import pytest
import torch
import xarray as xr

from tests.training import tiny
from tmca.cameras import SpectralDepthCamera
from tmca.cameras.phase_codes import write_phase_codes
from tmca.data import label
from tmca.decoders import Weights
from tmca.decoders.nets.build import build_depth_network
from tmca.decoders.nets.tiles import TwoHeadedNetwork
from tmca.decoders.nets.two_headed import DepthEstimate
from tmca.errors import SettingError
from tmca.optics import PhaseMaskBench, RotationalProfile, StrayLight, Stroke, ZernikeHeights
from tmca.sensor import Sensor
from tmca.training import train as train_camera
from tmca.training import training_settings
from tmca.training.depth_system import SURPRISE, DepthSystem
from tmca.training.patches import CubeStore, Patch, PatchSource
from tmca.training.spectral_depth import depth_channels
from tmca.training.starting_masks import starting_camera

pytestmark = pytest.mark.filterwarnings("ignore::tmca.optics.StrayLight")  # windows of 11 pixels
TINY = {
    "camera.size": [24, 24], "camera.slots": 2, "camera.planes": 3, "camera.period": 2, "camera.preset": "quick",
    "camera.bench": {"window": [11, 11]},
    "camera.channels": "monochrome", "camera.filters": "clear", "camera.shutter": "one-hot",
    "noise": [{"read_noise": 0.01}],
    "decoder": {"kind": "two-headed", "start": "snapshot", "widths": [6, 8], "blocks": 1, "window": 4},
    "data.train": ["first", "second"], "data.validation": ["third"], "data.patch": 24, "data.batch": 2,
    "data.margin": 0,
    "optimiser.steps": 6, "validate_every": 3, "checkpoint_every": 2, "precision": "32-true",
}  # fmt: skip


CHOSEN_BY_CODES = ("camera.planes", "camera.period", "camera.channels", "camera.filters", "camera.shutter")


def described(changes):
    return training_settings("spectral-depth", None, None, changes)


def settings(**changes):
    return described(TINY | changes)


def load(name):
    """A smooth random cube (8, 60, 64) before a slope, some of whose depth is unknown."""
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    coarse = torch.from_numpy(rng.random((1, 8, 12, 13), dtype=np.float32))
    fine = torch.nn.functional.interpolate(coarse, size=(60, 64), mode="bicubic").clamp(0, 1)[0]
    waves = np.array(SpectralDepthCamera.from_preset("quick", size=(32, 32)).wavelengths)
    depth = 1 / np.linspace(0.5, 2.5, 64)[None].repeat(60, 0)
    depth[:5] = np.nan
    return xr.Dataset({"radiance": label(fine.numpy(), waves), "depth": (("y", "x"), depth)})


def train(folder, progress=None, **changes):
    how = {"accelerator": "cpu", "progress": progress}
    return train_camera(settings(**changes), Path(folder), load, **how)


def test_a_short_run_lowers_the_loss_and_its_weights_decode(tmp_path):
    found = train(tmp_path, **{"optimiser.steps": 30, "optimiser.decoder_rate": 0.02, "validate_every": 10})
    score = tiny.logged(tmp_path, "score")
    assert max(score) > score[0] + 0.01
    assert found.best["score"] == pytest.approx(max(score), rel=1e-4)
    weights = Weights.load(found.weights)
    camera = weights.camera_for((30, 27))
    decoded = TwoHeadedNetwork(weights.network, camera, weights.load_prior())(
        camera(torch.rand(1, 8, 30, 27), torch.full((1, 1, 30, 27), 0.8))
    )
    assert decoded.values.shape == (1, 8, 30, 27)
    assert bool(camera.planes.within(decoded.depth).all())


@pytest.mark.parametrize("learn", [[], ["mask"]])
def test_half_precision_is_for_the_layers_of_the_network_alone(tmp_path, learn):
    small = {"precision": "bf16-mixed", "optimiser.steps": 2, "validate_every": 2, "camera.learn": learn}
    found = train(tmp_path, **small)
    assert found.steps == 2
    assert found.best["psnr"] > 0


@pytest.mark.parametrize("learn", [("mask",), ("shutter",), ("mask", "shutter", "filters")])
def test_what_learns_moves_and_the_rest_stays(tmp_path, learn):
    changes = {"camera.learn": list(learn), "camera.filters": "gaussian"}
    changes |= {"optimiser.code_rate": 2.0, "optimiser.mask_rate": 0.005}
    found = train(tmp_path, **changes, **{"codes.frozen": 0.0, "codes.slope": [1.0, 2.0]})
    before, after = starting_camera(settings(**changes)), Weights.load(found.weights).camera
    moved = {
        "mask": not torch.allclose(before.point_spread.heights(), after.point_spread.heights()),
        "shutter": not torch.equal(before.tile()[1], after.tile()[1]),
        "filters": not torch.equal(before.filters.cells(), after.filters.cells()),
    }
    assert {name for name, is_moved in moved.items() if is_moved} == set(learn)
    assert set(after.tile()[1].unique().tolist()) <= {0.0, 1.0}


@pytest.mark.parametrize("start", ["snapshot", "likelihood"])
def test_two_buckets_learn_and_their_weights_decode(tmp_path, start):
    changes = {"camera.buckets": 2, "camera.shutter": "random", "camera.learn": ["mask", "shutter"]}
    changes |= {"optimiser.code_rate": 2.0, "codes.frozen": 0.0, "codes.slope": [1.0, 2.0]}
    found = train(tmp_path / start, **changes, decoder={**TINY["decoder"], "start": start})
    before, weights = starting_camera(settings(**changes)), Weights.load(found.weights)
    camera = weights.camera_for((30, 27))
    first, second = camera.tile()[1]
    torch.testing.assert_close(first + second, torch.ones_like(first))
    assert not torch.equal(first, before.tile()[1][0])
    snapshot = camera(torch.rand(1, 8, 30, 27), torch.full((1, 1, 30, 27), 0.8))
    assert snapshot.shape == (1, 2, 30, 27)
    decoded = TwoHeadedNetwork(weights.network, camera, weights.load_prior())(snapshot)
    assert decoded.values.shape == (1, 8, 30, 27)
    own = {name: value for name, value in (TINY | changes).items() if name not in (*CHOSEN_BY_CODES, "camera.bench")}
    own |= {"codes.start": str(found.weights)}
    for again in (own, {name: value for name, value in own.items() if name != "camera.buckets"}):
        torch.testing.assert_close(starting_camera(described(again)).tile()[1], camera.tile()[1])
    with pytest.raises(SettingError, match=r"camera\.buckets: found 1, expected 2, as in"):
        starting_camera(described(own | {"camera.buckets": 1}))


def test_the_frames_of_a_burst_go_on_as_a_burst(tmp_path):
    changes = {"camera.buckets": 2, "camera.shutter": "burst", "codes.start": "random"}
    first = train(tmp_path, **changes, **{"optimiser.steps": 1, "validate_every": 1}).weights
    kept = ("camera.planes", "camera.period", "camera.channels", "camera.filters", "camera.bench")
    going = {name: value for name, value in (TINY | changes).items() if name not in kept} | {"codes.start": str(first)}
    camera = starting_camera(described(going | {"camera.learn": ["mask"]}))
    torch.testing.assert_close(camera.tile()[1], Weights.load(first).camera.tile()[1])
    for family in ("open", "balanced"):
        with pytest.raises(SettingError, match=rf"camera\.shutter: found {family}"):
            starting_camera(described(going | {"camera.shutter": family}))


def test_masks_that_learn_to_send_light_away_are_told(tmp_path):
    changes = {"camera.learn": ["mask"], "optimiser.mask_rate": 0.2, "codes.frozen": 0.0}
    with pytest.warns(StrayLight, match="of a point's light"):
        train(tmp_path, **changes)


def test_the_first_stage_follows_codes_that_learn(tmp_path):
    decoder = {**TINY["decoder"], "start": "likelihood"}
    changes = {"decoder": decoder, "camera.learn": ["mask"], "optimiser.mask_rate": 0.01, "codes.frozen": 0.5}
    found = train(tmp_path, **changes, **{"data.pool": 8, "optimiser.steps": 4, "validate_every": 2})
    weights = Weights.load(found.weights)
    assert weights.prior == "prior.nc"
    assert weights.load_prior() is not None
    assert not (tmp_path / "starts").exists()


@pytest.mark.parametrize("start", ["snapshot", pytest.param("likelihood", marks=pytest.mark.slow)])
def test_a_run_that_is_stopped_ends_as_one_that_is_not(tmp_path, start):
    changes = {"decoder": {**TINY["decoder"], "start": start}, "camera.learn": ["mask"], "codes.frozen": 0.5}
    changes |= {"data.pool": 8}
    train(tmp_path / "whole", **changes)
    with pytest.raises(KeyboardInterrupt):
        train(tmp_path / "parts", progress=tiny.stop_after(4), **changes)
    train(tmp_path / "parts", **changes)
    one, other = (Weights.load(tmp_path / name) for name in ("whole", "parts"))
    for name, value in one.network.state_dict().items():
        assert torch.equal(value, other.network.state_dict()[name]), name
    assert one.card == other.card
    assert one.same_codes(other.camera)


def source(tmp_path, **changes):
    camera = starting_camera(settings())
    store = CubeStore(["first"], lambda name: depth_channels(load(name), camera), tmp_path)
    return PatchSource(store, 24, 0, **changes)


@pytest.mark.parametrize("redrawn", [0.0, 1.0])
def test_depth_stays_in_the_range_and_light_does_not_change_it(tmp_path, redrawn):
    dull, bright = source(tmp_path, redrawn=redrawn), source(tmp_path, redrawn=redrawn, brightness=2.0, tint=0.3)
    seen = []
    for index in range(30):
        one, other = dull(3, index).scene, bright(3, index).scene
        known = torch.isfinite(one[-1])
        assert one.shape == (9, 24, 24)
        assert 0 <= one[-1][known].min() <= one[-1][known].max() <= 1
        assert not torch.equal(one[:-1], other[:-1])
        seen.append(float(known.float().mean()))
    assert (min(seen) < 1) == (redrawn == 0)  # depth that is drawn is known everywhere
    assert torch.equal(dull(3, 4).scene.nan_to_num(9), dull(3, 4).scene.nan_to_num(9))


def test_channels_are_the_cube_and_the_share_of_the_range():
    camera, scene = starting_camera(settings()), load("first")
    channels = depth_channels(scene, camera)
    inverse = 1 / scene["depth"].values[10]
    assert np.isnan(channels[-1, :5]).all()
    np.testing.assert_allclose(channels[-1, 10], (inverse - 0.5) / 2.0, atol=1e-6)
    np.testing.assert_array_equal(channels[:-1], scene["radiance"].values)


def test_unknown_depth_has_no_part_in_the_loss():
    camera = starting_camera(settings())
    network = build_depth_network(TINY["decoder"], camera)
    system = DepthSystem(camera, network, [camera.sensor], None, [], depth_weight=1.0)
    scenes = torch.rand(1, 9, 24, 24)
    scenes[:, -1, :12] = torch.nan
    logits = 40 * torch.eye(3)[2][None, :, None, None].expand(1, 3, 24, 24)
    loss = system.cost(DepthEstimate(scenes[:, :-1], logits), scenes)
    known = scenes[:, -1, 12:]  # of the range, the sure plane at 1
    surprise = 40 * (1 - (2 * known - 1).clamp_min(0))
    assert float(loss) == pytest.approx(float((1 - known + SURPRISE * surprise).mean()), rel=1e-5)


def test_a_patch_is_lit_by_its_margin_which_is_not_learned():
    seen, camera = [], starting_camera(settings(**{"data.margin": None}))
    assert camera.size == (24 + 2 * 6, 24 + 2 * 6)  # half of 11 pixels, in whole tiles of 2
    network = build_depth_network(TINY["decoder"], camera)
    forward = network.forward
    network.forward = lambda snapshot, *how: seen.append(snapshot) or forward(snapshot, *how)
    system = DepthSystem(camera, network, [Sensor()], None, [], margin=6, depth_weight=1.0)
    scene = torch.from_numpy(depth_channels(load("first"), camera)[:, 4:40, 8:44])
    wide = SpectralDepthCamera.from_preset(
        "quick", size=(60, 64), slots=2, bench=camera.bench, planes=3, period=2, channels="monochrome",
        filters="clear", shutter="one-hot",
    )  # fmt: skip
    whole = torch.from_numpy(depth_channels(load("first"), camera))[None]
    metres = 1 / (1 / wide.planes.far + whole[:, -1:] * (1 / wide.planes.near - 1 / wide.planes.far))
    with torch.no_grad():
        loss = float(system([Patch(scene, scene, "")], 0, [0]))
        changed = scene.clone()
        changed[:, :6] = torch.rand(9, 6, 36)
        dark = float(system([Patch(changed, changed, "")], 0, [0]))
        expected = wide.exact(whole[:, :-1], metres)[..., 10:34, 14:38]
    torch.testing.assert_close(seen[0], expected, rtol=1e-4, atol=1e-5)
    assert not torch.allclose(seen[1], expected)
    estimate = DepthEstimate(torch.zeros(1, 8, 24, 24), torch.zeros(1, 3, 24, 24))
    assert float(system.cost(estimate, scene[None])) == pytest.approx(float(system.cost(estimate, changed[None])))
    assert np.isfinite([loss, dark]).all()


def test_codes_bring_the_camera_they_were_made_for(tmp_path):
    bench = PhaseMaskBench(window=(11, 11), mask_pixels=32)
    made = SpectralDepthCamera.from_preset(
        "quick", size=(32, 32), slots=2, depth=(0.5, 1.5), planes=4, bench=bench, channels="monochrome", period=2,
        filters="gaussian", mask="free-form", stroke=Stroke(-2e-7, 3e-7, 9), shutter="random", energy="aperture",
    )  # fmt: skip
    file = write_phase_codes(made, tmp_path / "codes.nc", "gaussian", "monochrome")
    own = {"codes.start": str(file), "camera.bench": {}, "data.margin": None}
    free = {name: value for name, value in (TINY | own).items() if name not in CHOSEN_BY_CODES}
    camera = starting_camera(described(free))
    assert (camera.planes, camera.bench) == (made.planes, made.bench)
    assert camera.point_spread.heights.stroke == Stroke(-2e-7, 3e-7, 9)
    assert (camera.point_spread.energy, len(camera.filters.filters)) == ("aperture", len(made.filters.filters))
    torch.testing.assert_close(camera.codes()[0], made.codes()[0])
    torch.testing.assert_close(camera.tile()[1], made.tile()[1])
    with pytest.raises(SettingError, match=r"camera\.planes: found 3, expected 4, as in .*codes\.nc"):
        starting_camera(described(free | {"camera.planes": 3}))
    for name, value in {"rms": 3e-7, "shutter": "open", "filters": "clear", "channels": "rgb", "mask": "flat"}.items():
        with pytest.raises(SettingError, match=rf"camera\.{name}: found {value}"):
            starting_camera(described(free | {f"camera.{name}": value}))
    with pytest.raises(SettingError, match=r"camera\.bench.*brings its own"):
        described(free | {"camera.bench": {"pitch": 5e-6}})


@pytest.mark.filterwarnings("ignore::tmca.optics.Undersampled")
@pytest.mark.parametrize(("family", "kept"), [("zernike", ZernikeHeights), ("rotational", RotationalProfile)])
def test_masks_go_on_in_their_family(tmp_path, family, kept):
    first = {"camera.mask": family, "camera.shutter": "one-hot", "optimiser.steps": 2, "validate_every": 2}
    static = first | {"camera.slots": 1, "camera.shutter": "open", "camera.stroke": (-3e-7, 3e-7)}
    before = train(tmp_path / "static", **static).weights
    maps = Weights.load(before).camera.point_spread.heights
    assert isinstance(maps, kept)
    first |= {"optimiser.mask_rate": 0.01}
    asked = ("camera.bench", *CHOSEN_BY_CODES[:3])
    own = {name: value for name, value in (TINY | first).items() if name not in asked}
    going = own | {"codes.start": str(before), "camera.learn": ["mask"], "codes.frozen": 0.0}
    found = starting_camera(described(going)).point_spread.heights
    assert isinstance(found, kept)
    assert found.stroke == Stroke(-3e-7, 3e-7)
    torch.testing.assert_close(found().detach(), maps().expand(2, -1, -1))
    run = train_camera(described(going), tmp_path / "learned", load)
    learned = Weights.load(run.weights).camera.point_spread.heights
    assert isinstance(learned, kept)
    assert float((learned() - found()).detach().abs().max()) > 1e-9
    going |= {"camera.mask": "free-form"}
    free = starting_camera(described(going)).point_spread.heights
    torch.testing.assert_close(free().detach(), found().detach())
    assert free.heights.requires_grad
    with pytest.raises(SettingError, match=r"camera\.filters: found rgbw"):
        starting_camera(described(going | {"camera.filters": "rgbw", "camera.slots": 1}))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"camera.size": [32, 24]}, "patches"),
        ({"data.bands": 31}, "data.bands"),
        ({"data.margin": 3}, "whole tiles of 2"),
        ({"data.side": 40, "data.margin": 10}, "a patch and its margin, 44"),
        ({"data.side": 35, "data.margin": None}, "a patch and its margin, 36"),
        ({"decoder": {"kind": "two-headed", "window": 1}}, r"decoder\.window: found 1 pixels, expected 2"),
        ({"codes.throughput": 0.5}, "throughput"),
        ({"codes.through_start": True}, "an unknown name"),
        ({"data.redrawn": 5}, "redrawn"),
        ({"camera.learn": ["filters"]}, "filters, of which there is one"),
        ({"camera.bench": {"lens": 3}}, "bench: found 'lens'"),
        ({"camera.levels": 4}, r"beside camera\.stroke"),
        ({"camera.bench": {"window": [31, 31]}}, "at least 31"),
        ({"camera.learn": ["lens"]}, "learn"),
        ({"camera.preset": "huge"}, "preset"),
        ({"decoder": {"kind": "two-headed", "levels": 3}}, "levels"),
        ({"camera.mask": "spiral"}, "mask"),
    ],
)
def test_impossible_settings_are_named(tmp_path, changes, said):
    with pytest.raises(SettingError, match=said):
        train(tmp_path, **changes)


def test_codes_learn_depth_from_the_likelihood_alone_if_the_network_sees_none(tmp_path):
    changes = {"camera.learn": ["mask"], "optimiser.depth_weight": 0.0, "codes.frozen": 0.0, "optimiser.steps": 2}
    heights = {}
    for weight in (0.0, 1.0):
        folder = tmp_path / str(weight)
        weights = train(folder, **changes, **{"optimiser.likelihood_weight": weight, "validate_every": 2}).weights
        heights[weight] = Weights.load(weights).camera.point_spread.heights().detach()
        assert Weights.load(weights).prior == ""
        assert (folder / "prior.nc").exists() == (weight > 0)
    assert not torch.equal(heights[0.0], heights[1.0])
