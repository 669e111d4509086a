"""What training does to losses and codes, what it refuses, and what it leaves behind."""

import numpy as np
import pytest
import torch

from tests.training import tiny
from tmca.codes import CodePlane, hard_threshold
from tmca.decoders import Weights, build_network, first_estimate
from tmca.decoders.nets.tiles import CollapsedNetwork
from tmca.design import hold_throughput
from tmca.errors import DataError, OutputError, SettingError
from tmca.operators import single_disperser
from tmca.optics import Dispersion
from tmca.sensor import Noise
from tmca.training import TRAININGS, training_settings
from tmca.training.loop import TrainingError


def starting_camera(**changes):
    return TRAININGS["spectral"].camera(tiny.settings(**changes), lambda: tiny.load("first"))


def test_a_short_run_lowers_the_loss_and_moves_the_codes(tmp_path):
    found = tiny.train(tmp_path / "run", **{"optimiser.steps": 60, "optimiser.code_rate": 0.1, "validate_every": 10})
    rows = [line.split(",") for line in (tmp_path / "run" / "log.csv").read_text().splitlines()]
    psnr = [float(row[rows[0].index("psnr")]) for row in rows[1:]]
    assert max(psnr[-2:]) > psnr[0] + 0.3
    trained = Weights.load(found.weights)
    before = starting_camera().codes
    for name in ("aperture", "shutter"):
        now, then = getattr(trained, name), getattr(before, name).tile()
        assert set(now.unique().tolist()) <= {0.0, 1.0}
        assert not torch.equal(now, then)


def test_the_surrogate_gradient_is_the_smooth_relaxation_s_where_the_loss_is_linear():
    latent = torch.randn(3, 4, 5, dtype=torch.float64, requires_grad=True)
    weights = torch.randn(3, 4, 5, dtype=torch.float64)
    hard = torch.autograd.grad((weights * hard_threshold(latent, 6.0)).sum(), latent)[0]
    smooth = torch.autograd.grad((weights * torch.sigmoid(6.0 * latent)).sum(), latent)[0]
    assert torch.allclose(hard, smooth)


@pytest.mark.parametrize("kind", ["unet", "unrolled"])
@pytest.mark.parametrize("step", [1.0, 0.5])
def test_the_derivative_to_smooth_codes_passes_operator_start_and_network(kind, step):
    generator = torch.Generator().manual_seed(0)
    dispersion = Dispersion.of(step, 2)
    network = build_network(kind, bands=2, start="dagger", widths=[3], blocks=1, gather=1).double()
    for parameter in network.parameters():
        parameter.data = torch.randn(parameter.shape, generator=generator, dtype=torch.float64) * 0.1
    scene = torch.rand(1, 2, 4, 5, generator=generator, dtype=torch.float64)
    shutter = torch.rand(2, 4, 5 + dispersion.extent, generator=generator, dtype=torch.float64)

    def loss(latent):
        operator = single_disperser(torch.sigmoid(latent), shutter, dispersion)
        # networks take brightness and noise level as given: they come from the first estimate, held here
        return network(operator.A(scene), operator, Noise(0.01), 0.8 * scene).square().sum()

    latent = torch.randn(2, 4, 5, generator=generator, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(loss, (latent,), atol=1e-6)


def test_the_lmmse_passes_gradients_to_the_codes(tmp_path):
    tiny.train(tmp_path / "run", **{"optimiser.steps": 2})
    weights = Weights.load(tmp_path / "run" / "weights.safetensors")
    prior = weights.load_prior()
    code = torch.rand(2, 16, 16, requires_grad=True)
    operator = single_disperser(code, torch.ones(2, 16, 18), Dispersion.linear(3))
    snapshot = operator.A(torch.rand(1, 3, 16, 16))
    for differentiable in (False, True):
        found = first_estimate("lmmse", snapshot, operator, Noise(0.02), prior, differentiable=differentiable)
        assert found.requires_grad == differentiable
    gradient = torch.autograd.grad(found.square().sum(), code)[0]
    assert bool(gradient.isfinite().all())
    assert float(gradient.abs().max()) > 0


@pytest.mark.parametrize("target", [0.1, 0.3, 0.5])
def test_a_hard_target_for_the_light_is_held(target):
    camera = starting_camera(**{"camera.period": 16})
    hold_throughput(camera, target)
    assert camera.throughput() == pytest.approx(target, abs=0.01)


def test_the_target_is_held_through_a_run(tmp_path):
    changes = {"codes.throughput": 0.4, "codes.hold": "hard", "camera.period": 16, "optimiser.code_rate": 0.1}
    found = tiny.train(tmp_path / "run", **changes)
    assert Weights.load(found.weights).camera_for().throughput() == pytest.approx(0.4, abs=0.02)


def test_equal_slots_can_part_ways():
    pattern = torch.ones(2, 4, 4)
    plane = CodePlane(pattern, 2, (4, 4), learnable=True, jitter=0.9)
    assert torch.equal(plane(), pattern)
    assert not torch.equal(plane.latent[0], plane.latent[1])


def test_weights_give_back_the_network_and_the_camera(tmp_path):
    found = Weights.load(tiny.train(tmp_path / "run").weights)
    camera = found.camera_for((30, 41))
    scene = torch.from_numpy(tiny.load("fourth").values)[None, :, :30, :41]
    snapshot, noise = camera.A(scene), Noise(0.01)
    whole = CollapsedNetwork(found.network, camera.operator(), noise, found.load_prior())(snapshot)
    assert whole.shape == scene.shape
    assert found.card["best"]["psnr"] > 0
    assert (tmp_path / "run" / "weights.safetensors").stat().st_size < 100_000


@pytest.mark.parametrize("kind", ["unet", "unrolled"])
@pytest.mark.parametrize("noise", [Noise(0.01), Noise(0.0, 0.01)])
def test_tiles_join_without_a_seam(kind, noise):
    torch.manual_seed(0)
    network = build_network(kind, bands=2, start="dagger", widths=[4, 6], blocks=1)
    for parameter in network.parameters():
        parameter.data.normal_(std=0.2)
    operator = single_disperser((torch.rand(2, 203, 21) > 0.5).float(), torch.ones(2, 203, 22), Dispersion.linear(2))
    snapshot = operator.A(torch.rand(1, 2, 203, 21))
    whole, tiled = (CollapsedNetwork(network, operator, noise, None, tile)(snapshot) for tile in (None, 40))
    assert torch.allclose(whole, tiled, atol=1e-5)


@pytest.mark.parametrize("bands", [1, 3])
@pytest.mark.parametrize("size", [(16, 16), (13, 17)])
def test_an_untrained_network_that_starts_well_returns_its_start(bands, size):
    operator = single_disperser(
        torch.ones(1, *size), torch.ones(1, size[0], size[1] + bands - 1), Dispersion.linear(bands)
    )
    snapshot = operator.A(torch.rand(2, bands, *size))
    start = operator.A_dagger(snapshot)
    for kind in ("unet", "unrolled"):
        network = build_network(kind, bands=bands, start="dagger", widths=[4], blocks=1)
        assert torch.equal(network(snapshot, operator, Noise(0.01), start), start)


def test_a_moving_scene_is_an_augmentation(tmp_path):
    found = tiny.train(tmp_path / "run", **{"data.motion": 3.0, "optimiser.steps": 2, "checkpoint_every": 1})
    assert found.steps == 2


def test_a_loss_that_is_no_number_stops_and_names_batch_and_parameter(tmp_path):
    def poison(done, steps, said):
        if done == 4:
            for group in runs[0].optimizers["decoder"].param_groups:
                group["params"][0].data.fill_(float("nan"))

    runs = []
    import tmca.training.run as room

    original = room.Run

    class Noted(original):
        def __post_init__(self):
            super().__post_init__()
            runs.append(self)

    room.Run = Noted
    try:
        with pytest.raises(TrainingError, match=r"step 5.*not finite.*(first|second) at row.*0000004"):
            tiny.train(tmp_path / "run", poison)
    finally:
        room.Run = original
    assert (tmp_path / "run" / "checkpoints" / "0000004").is_dir()


def test_a_cube_that_cannot_be_read_in_the_middle_leaves_the_checkpoint(tmp_path):
    def scene_of(seed, step):
        return int(np.random.default_rng((seed, step, 0)).integers(2))

    late = next(seed for seed in range(100) if [scene_of(seed, step) for step in range(3)] == [0, 0, 1])

    def broken(name):
        if name == "second" and (tmp_path / "run" / "checkpoints").exists():
            raise DataError(name, "a truncated file", "a whole one")
        return tiny.load(name)

    with pytest.raises(DataError, match="truncated"):
        tiny.train(tmp_path / "run", load=broken, **{"seed": late, "checkpoint_every": 1, "data.batch": 1})
    assert sorted((tmp_path / "run" / "checkpoints").iterdir())[-1].name == "0000002"


def test_a_folder_of_another_run_and_foreign_folders_are_refused(tmp_path):
    tiny.train(tmp_path / "run", **{"optimiser.steps": 2})
    with pytest.raises(OutputError, match=r"camera.slots = 2, now 4"):
        tiny.train(tmp_path / "run", **{"optimiser.steps": 2, "camera.slots": 4})
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign" / "thesis.txt").write_text("mine")
    with pytest.raises(OutputError, match="other files"):
        tiny.train(tmp_path / "foreign")


def test_two_runs_do_not_share_a_folder(tmp_path):
    def again(done, steps, said):
        with pytest.raises(OutputError, match="going on"):
            tiny.train(tmp_path / "run", **{"optimiser.steps": 2})

    tiny.train(tmp_path / "run", again, **{"optimiser.steps": 2})


def test_a_damaged_checkpoint_is_named(tmp_path):
    tiny.train(tmp_path / "run")
    for kept in (tmp_path / "run" / "checkpoints").glob("*/state.safetensors"):
        kept.write_bytes(kept.read_bytes()[:100])
    with (
        pytest.raises(DataError, match="unreadable or truncated checkpoint"),
        pytest.warns(UserWarning, match="the one before"),
    ):
        tiny.train(tmp_path / "run")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"camera.slotz": 3}, ["camera.slotz", "slots"]),
        ({"camera.slots": 0}, ["camera.slots", "0"]),
        ({"data.patch": 100}, ["100"]),
        ({"noise": []}, ["noise"]),
        ({"optimiser.loss": "l3"}, ["optimiser.loss", "l3"]),
        ({"decoder.stages": 0}, ["stages"]),
        ({"decoder.kind": "resnet"}, ["resnet", "unrolled"]),
        ({"decoder.depth": 3}, ["depth", "widths"]),
        ({"codes.start": "nowhere.safetensors"}, ["codes.start", "nowhere"]),
        ({"data.validation": ["first"]}, ["first"]),
    ],
)
def test_impossible_settings_are_one_clear_line(tmp_path, changes, words):
    with pytest.raises(SettingError) as error:
        tiny.train(tmp_path / "run", **changes)
    assert "\n" not in str(error.value)
    for word in words:
        assert word in str(error.value)


def test_unknown_presets_and_yaml_that_is_none(tmp_path):
    with pytest.raises(SettingError, match="thesis, quick"):
        training_settings("spectral", "tesis")
    (tmp_path / "a.yaml").write_text("camera: [")
    with pytest.raises(DataError, match="YAML"):
        training_settings("spectral", None, tmp_path / "a.yaml")


def test_the_thesis_preset_is_the_thesis_setting():
    thesis = training_settings("spectral", "thesis", None, {"data.train": ["x"]})
    assert (thesis.camera.size, thesis.camera.slots, thesis.data.bands) == ((256, 256), 8, 12)
    assert (thesis.optimiser.epochs, thesis.optimiser.loss) == (500, "l2")
    assert thesis.decoder["start"] == "adjoint"
    assert np.allclose(thesis.data.shares, (0.8, 0.1, 0.1))
