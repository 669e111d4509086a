"""The recipe of the network that comes with the package: cubes, drawn cameras and scenes, and pieces of training."""

from dataclasses import replace
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from studies.shipped import train
from studies.shipped.pool import KNOTS, drawn_camera, example
from studies.shipped.presets import PRESETS, RANK, Preset
from studies.shipped.scenes import drawn_scene, read_cubes, write_cubes
from studies.shipped.train import STATE, Fit, Trained, figures, loss_of
from tests.small_scenes import smooth_scene
from tmca.cameras import SpectralCamera
from tmca.decoders import SubspaceNetwork
from tmca.operators import TapOperator
from tmca.priors import SubspacePrior, block_of
from tmca.sensor import Noise

CPU = torch.device("cpu")
SIZE = (24, 20)
TINY = {"stages": 2, "widths": (8,), "blocks": 1, "gather": 2}
PRESET = Preset(TINY, 24, 1, 2, 70.0, 2)
FEW = {"bands": 4, "slots": 2, "aperture": "random", "shutter": "random", "seed": 3}
LAMPS = torch.from_numpy(np.exp(-((KNOTS * 1e9 - np.array([[450], [550], [650]])) ** 2) / 5000).T).float()
"""(31, 3) spectra of which the scenes are mixed."""


def cubes(number=3):
    maps = [smooth_scene(24, 24, seed=seed).float() for seed in range(number)]
    return [torch.einsum("lk,khw->lhw", LAMPS, one).mul(0.6).clamp(0, 1) for one in maps]


def rng(seed=0):
    return np.random.default_rng(seed)


@pytest.fixture(autouse=True)
def tiny(monkeypatch):
    """Blocks, networks and cameras that take milliseconds."""
    given = {"BLOCK": (4, 12), "RANK": 4, "PRESETS": {"small": PRESET}, "CAMERAS": {"few": (FEW, Noise(0.01))}}
    for name, value in given.items():
        monkeypatch.setattr(train, name, value)
    monkeypatch.setattr(train, "benchmark_camera", lambda mask: (SpectralCamera(size=mask.shape, **FEW), Noise(0.0)))


@pytest.fixture(scope="module")
def prior():
    return SubspacePrior.learn([cube.double() for cube in cubes()], (4, 12), rank=4, wavelengths=KNOTS.tolist())


@pytest.fixture(scope="module")
def seen(prior):
    """Three scenes behind a small camera with little noise."""
    return example(SpectralCamera(size=SIZE, **FEW), Noise(0.01), cubes(), prior, rng(), 3, CPU)


@pytest.fixture
def folder(tmp_path):
    """What ``pack`` writes."""
    write_cubes(cubes(), tmp_path / "train.xz")
    write_cubes(cubes(1), tmp_path / "val.xz")
    torch.save({"train": ["noise"], "mask": torch.rand(24, 24).round()}, tmp_path / "about.pt")
    return tmp_path


def piece(folder, monkeypatch, seconds, *more):
    """A piece of training in which every look at the clock takes a second; its state afterwards."""
    monkeypatch.setattr(train, "time", SimpleNamespace(perf_counter=count().__next__))
    given = {"seconds": seconds, "size": 24, "cameras": 1, "scenes": 2, "batch": 2, "device": "cpu", "out": folder}
    train.main(["fit", str(folder), *(f"--{name}={value}" for name, value in given.items()), *more])
    return torch.load(folder / STATE, weights_only=True)


def same(one, other):
    return all(torch.equal(value, other["network"][name]) for name, value in one["network"].items())


def test_all_weights_together_are_small_enough_for_the_package():
    assert sum(file.stat().st_size for file in train.FOLDER.glob("*.safetensors")) <= 12e6


def test_cubes_are_kept_to_16_bits(tmp_path):
    given = [torch.rand(31, 6, 8) for _ in range(2)]
    given[0][0, 0, :2] = torch.tensor([0.0, 1.0])
    write_cubes(given, tmp_path / "cubes.xz")
    for cube, kept in zip(given, read_cubes(tmp_path / "cubes.xz"), strict=True):
        assert (kept - cube).abs().max() <= 0.5001 / 65535


def test_drawn_scenes_are_irradiances_of_the_shape_of_the_cubes_and_differ():
    bright, draw = [cube / cube.max() for cube in cubes()], rng()
    scenes = torch.stack([drawn_scene(bright, draw) for _ in range(40)])
    assert scenes.shape == (40, 31, 24, 24)
    assert scenes.min() >= 0
    assert scenes.max() <= 1
    assert len({round(float(one.double().sum()), 3) for one in scenes}) > 20


def test_scenes_are_drawn_from_every_cube():
    given, draw = [torch.eye(31)[band].mul(0.5)[:, None, None].expand(31, 8, 8) for band in range(3)], rng()
    shown = sum(drawn_scene(given, draw) for _ in range(40)).sum((1, 2))
    assert (shown > 0).tolist() == [True] * 3 + [False] * 28


def test_drawn_cameras_differ_and_the_network_serves_them():
    draw, network, kinds = rng(), SubspaceNetwork(rank=4, **TINY), set()
    for _ in range(20):
        camera, noise = drawn_camera(draw, SIZE)
        scene = torch.rand(1, *camera.scene_shape)
        snapshot = camera(scene, generator=0)
        moments = network.at(camera.wavelengths).moments(snapshot, TapOperator(camera.taps()), noise, 0.5 * scene)
        assert moments.estimate.shape == scene.shape
        assert moments.estimate.isfinite().all()
        kinds.add((len(camera.wavelengths), camera.slots, camera.buckets))
    assert len(kinds) > 10
    assert {buckets for *_, buckets in kinds} == {1, 2}


def test_the_prior_is_as_large_as_drawn_cameras_need(monkeypatch):
    monkeypatch.undo()
    draw = rng()
    blocks = [block_of(drawn_camera(draw, SIZE)[0], "subspace") for _ in range(100)]
    assert max(rows for rows, _ in blocks) <= train.BLOCK[0]
    assert max(columns for _, columns in blocks) <= train.BLOCK[1]


def test_first_estimates_of_an_example_are_better_than_nothing(seen):
    assert seen.scenes.shape == seen.starts.shape == (3, 4, *SIZE)
    assert seen.snapshots.shape[:3] == (3, 1, SIZE[0])
    truth, start = seen.scenes.float(), seen.starts.float()
    assert (start - truth).square().mean() < 0.1 * truth.square().mean()


def test_rows_of_an_example_are_what_the_camera_saw_there(seen):
    truth, snapshot, operator, start = seen.part(slice(8, 16), torch.tensor([2, 0]))
    assert truth.shape == start.shape == (2, 4, 8, SIZE[1])
    assert (operator.A(truth) - snapshot).std() == pytest.approx(0.01, rel=0.3)


def test_steps_change_the_network_and_it_stays_finite(prior, seen):
    trained = Trained.new(prior, PRESET)
    before = [one.detach().clone() for one in trained.network.parameters()]
    fit = Fit(trained, [seen], batch=2, seed=0)
    assert all(fit.step(number, 0.0).isfinite() for number in range(2))
    after = list(trained.network.parameters())
    assert all(one.isfinite().all() for one in (*after, *fit.average.values))
    assert any(not torch.equal(one, other) for one, other in zip(before, after, strict=True))
    assert trained.steps == 2


def test_the_average_is_stored_and_learning_goes_on_without_it(prior, seen, tmp_path):
    fit = Fit(Trained.new(prior, PRESET), [seen], batch=2, seed=0)
    for number in range(3):
        fit.step(number, 0.0)
    before = [one.detach().clone() for one in fit.network.parameters()]
    figures(fit, {}, "now", tmp_path / STATE)
    stored = Trained.load(tmp_path / STATE).network.parameters()
    assert all(torch.equal(one, mean) for one, mean in zip(stored, fit.average.values, strict=True))
    assert all(torch.equal(one, its) for one, its in zip(fit.network.parameters(), before, strict=True))
    assert any(not torch.equal(one, mean) for one, mean in zip(before, fit.average.values, strict=True))


def test_the_loss_falls_on_one_example(prior, seen):
    trained = Trained.new(prior, PRESET)
    fit = Fit(trained, [seen], batch=3, seed=0)
    truth, snapshot, operator, start = seen.part(slice(None), torch.arange(3))

    def loss():
        network = trained.network.at(seen.wavelengths)
        return float(loss_of(list(network.steps(snapshot, operator, seen.noise, start)), truth).detach())

    before = loss()
    for number in range(30):
        fit.step(number + 100, 0.0)
    assert loss() < before - 0.1


def test_a_second_piece_goes_on_from_the_first(folder, monkeypatch):
    first = piece(folder, monkeypatch, 20)
    assert first["steps"] > 2
    assert first["seconds"] > first["steps"]
    nothing_more = piece(folder, monkeypatch, 0)
    assert same(nothing_more, first)
    assert nothing_more["steps"] == first["steps"]
    second = piece(folder, monkeypatch, 20)
    assert second["steps"] == 2 * first["steps"]
    assert second["seconds"] == 2 * first["seconds"]
    assert not same(second, first)
    assert piece(folder, monkeypatch, 0, "--fresh")["steps"] == 0


def test_pieces_draw_other_scenes(folder, monkeypatch):
    pools = []
    monkeypatch.setattr(train, "learn", lambda fit, *_: pools.append(fit.pool))
    for steps in (0, 0, 7):
        prior = train.learned(read_cubes(folder / "train.xz"), CPU)
        Trained(Trained.new(prior, PRESET).network, steps, 1.0).save(folder / STATE)
        piece(folder, monkeypatch, 20)
    first, again, other = (pool[0].scenes for pool in pools)
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


def test_stopped_it_keeps_what_it_reported_last(folder, monkeypatch):
    learning = Fit.step

    def stopped(fit, number, done):
        if number == 23:
            raise KeyboardInterrupt
        return learning(fit, number, done)

    monkeypatch.setattr(Fit, "step", stopped)
    with pytest.raises(KeyboardInterrupt):
        piece(folder, monkeypatch, 1000)
    assert torch.load(folder / STATE, weights_only=True)["steps"] == 20
    assert {path.name for path in folder.iterdir()} == {"train.xz", "val.xz", "about.pt", STATE}


def test_a_state_says_what_network_it_holds(prior, folder, monkeypatch):
    wide = Trained.new(prior, replace(PRESET, network={**TINY, "widths": (16,)}))
    wide.save(folder / STATE)
    assert piece(folder, monkeypatch, 0)["settings"]["widths"] == [16]
    with pytest.raises(SystemExit, match="another preset than small"):
        piece(folder, monkeypatch, 0, "--preset=small")
    assert piece(folder, monkeypatch, 0, "--fresh")["settings"]["widths"] == [8]
    torch.save({"network": wide.network.state_dict()}, folder / STATE)
    with pytest.raises(SystemExit, match="begin anew with --fresh"):
        piece(folder, monkeypatch, 0)


@pytest.mark.parametrize("machine", ["cpu", "cuda"])
def test_the_machine_chooses_the_preset_unless_it_is_named(folder, monkeypatch, machine):
    chosen = []
    monkeypatch.setattr(train, "PRESETS", PRESETS)
    monkeypatch.setattr(train, "fit", lambda folder, out, device, preset, how: chosen.append(preset))
    for more in ((), ("--preset=small",), ("--preset=large", "--batch=3")):
        train.main(["fit", str(folder), f"--device={machine}", *more])
    usual = PRESETS["large" if machine == "cuda" else "small"]
    assert chosen == [usual, PRESETS["small"], replace(PRESETS["large"], batch=3)]


def test_the_true_state_is_below_16_MB(prior, tmp_path, monkeypatch):
    monkeypatch.undo()
    Trained(SubspaceNetwork(rank=RANK, **PRESETS["large"].network)).save(tmp_path / STATE)
    assert (tmp_path / STATE).stat().st_size < 16e6


def test_what_is_written_says_how_long_it_was_trained(folder, monkeypatch):
    state = piece(folder, monkeypatch, 20)
    train.main(
        ["ship", str(folder), "--load", str(folder / STATE), "--trained", "on nothing", "--out", str(folder / "made")]
    )
    weights = train.Weights.load(folder / "made/universal.safetensors")
    assert weights.card["trained"] == "on nothing"
    assert weights.card["steps"] == state["steps"]
    assert weights.card["seconds"] == state["seconds"]
    kept = weights.network.state_dict()
    assert all(torch.equal(value.half().float(), kept[name]) for name, value in state["network"].items())
