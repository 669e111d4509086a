"""What training does to losses and codes, what it refuses, and what it leaves behind."""

import numpy as np
import pytest
import torch

from tests.training import tiny
from tmca.codes import CodePlane
from tmca.decoders import Weights
from tmca.decoders.nets.weights import FOLDER, UNIVERSAL
from tmca.design import hold_throughput
from tmca.errors import DataError, OutputError, SettingError
from tmca.sensor import Sensor
from tmca.training import TRAININGS, training_settings
from tmca.training import run as training_run
from tmca.training.loop import TrainingError

ANY_CODES = str(FOLDER / f"{UNIVERSAL}.safetensors")


def starting_camera(**changes):
    return TRAININGS["spectral"].camera(tiny.settings(**changes), lambda: tiny.load("first"))


def test_a_short_run_lowers_the_loss_and_moves_the_codes(tmp_path):
    changes = {"optimiser.steps": 40, "optimiser.code_rate": 0.1, "validate_every": 10, "decoder.start": "dagger"}
    found = tiny.train(tmp_path / "run", **changes)
    psnr = tiny.logged(tmp_path / "run", "psnr")
    assert max(psnr[-2:]) > psnr[0] + 0.3
    trained = Weights.load(found.weights)
    before = starting_camera(**changes).codes
    for name in ("aperture", "shutter"):
        now, then = getattr(trained, name), getattr(before, name).tile()
        assert set(now.unique().tolist()) <= {0.0, 1.0}
        assert not torch.equal(now, then)


def test_what_a_run_leaves_says_how_it_went_and_gives_its_camera(tmp_path):
    trained = tiny.train(tmp_path / "run")
    assert f"PSNR {trained.best['psnr']:.2f} dB at step {trained.best['step']}" in repr(trained)
    assert len(trained.plot().axes[0].lines[0].get_xdata()) == len(tiny.logged(tmp_path / "run", "psnr"))
    camera = trained.camera_for((16, 24), sensor=Sensor(read_noise=0.1))
    assert (camera.size, camera.noise.read) == ((16, 24), pytest.approx(0.1))
    assert torch.equal(camera.codes.aperture()[:, :8, :8], Weights.load(trained.weights).aperture[:, :8, :8])


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
    tiny.train(tmp_path / "run", **{"optimiser.steps": 4})
    for kept in (tmp_path / "run" / "checkpoints").glob("*/state.safetensors"):
        kept.write_bytes(kept.read_bytes()[:100])
    with (
        pytest.raises(DataError, match="unreadable or truncated checkpoint"),
        pytest.warns(UserWarning, match="the one before"),
    ):
        tiny.train(tmp_path / "run", **{"optimiser.steps": 4})


def test_the_thesis_preset_is_the_thesis_setting():
    thesis = training_settings("spectral", "thesis", None, {"data.train": ["x"]})
    assert (thesis.camera.size, thesis.camera.slots, thesis.data.bands) == ((256, 256), 8, 12)
    assert (thesis.optimiser.epochs, thesis.optimiser.loss) == (500, "l2")
    assert thesis.decoder["start"] == "adjoint"
    assert np.allclose(thesis.data.shares, (0.8, 0.1, 0.1))


def test_a_loss_that_is_no_number_stops_and_names_batch_and_parameter(tmp_path, monkeypatch):
    runs = []

    class Noted(training_run.Run):
        def __post_init__(self):
            super().__post_init__()
            runs.append(self)

    def poison(done, steps, said):
        if done == 4:
            runs[0].optimizers["decoder"].param_groups[0]["params"][0].data.fill_(float("nan"))

    monkeypatch.setattr(training_run, "Run", Noted)
    with pytest.raises(TrainingError, match=r"step 5.*not finite.*(first|second) at row.*0000004"):
        tiny.train(tmp_path / "run", poison)
    assert (tmp_path / "run" / "checkpoints" / "0000004").is_dir()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"camera.slotz": 3}, "camera.slotz"), ({"camera.slots": 0}, "camera.slots"), ({"data.patch": 100}, "100"),
        ({"noise": []}, "noise"), ({"optimiser.loss": "l3"}, "optimiser.loss"), ({"decoder.stages": 0}, "stages"),
        ({"decoder.kind": "resnet"}, "resnet"), ({"decoder.depth": 3}, "depth"),
        ({"decoder.kind": "subspace"}, "decoder.kind"),
        ({"codes.start": "nowhere.safetensors"}, "codes.start"), ({"codes.start": ANY_CODES}, "brings none"),
        ({"data.validation": ["first"]}, "first"),
    ],
)  # fmt: skip
def test_impossible_settings_are_one_clear_line(tmp_path, changes, words):
    with pytest.raises(SettingError, match=words) as error:
        tiny.train(tmp_path / "run", **changes)
    assert "\n" not in str(error.value)
