"""Searches on a device: nothing but the codes comes from the processor."""

import json

import pytest
import torch

from tests.cli.refusals import refused
from tests.design.small_designs import PRIOR, block_error, designed
from tests.design.test_mask_search import PRIOR as WINDOWS
from tests.design.test_mask_search import TASK
from tests.small_scenes import smooth_scene
from tmca.applications.example_scenes import placed_error
from tmca.design import Effort, MaskEffort, MaskTask, TileMse, learn_examples, search, search_masks
from tmca.design.expected_error import windows
from tmca.design.flips import TileState
from tmca.design.spectral_depth import confusion, drawn_error, window_covariance
from tmca.design.transfer import TransferMse
from tmca.devices import computing_on
from tmca.errors import SettingError
from tmca.reports.cameras import design_codes

cuda = pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
WAVES = (4e-7, 5e-7, 6e-7)
SCENES = {name: smooth_scene(20 + 7 * s, 33, seed=10 + s) * (1 + s) for s, name in enumerate("abc")}


def nowhere():
    """Tensors that are made without a device lie where nothing can be computed with them."""
    return torch.device("meta")


def test_errors_of_codes_are_computed_where_the_moments_lie():
    camera, error = designed(), block_error().under(0.05, 0.01)
    code = camera.taps().code
    seen = windows(code.detach().double(), PRIOR.block, [(0, 0), (1, 2)])
    transfer, here = TransferMse.of(error, PRIOR, PRIOR), TileMse(error)(code.detach())
    with nowhere():
        there = TileMse(error)(code)
        there.log().backward()
        judged = transfer(seen, 0.05, 0.01)
    assert torch.equal(there.detach(), here)
    torch.testing.assert_close(judged, error(seen), rtol=1e-8, atol=0)


def test_flips_are_judged_where_the_moments_lie():
    camera, error = designed(), TileMse(block_error().under(0.05, 0.01))
    state = TileState.of(camera, error)
    changes = torch.zeros(2, *state.code.shape, dtype=torch.float64)
    changes[:, :, 1, 2] = torch.tensor([1.0, -0.5], dtype=torch.float64)[:, None]
    expected, before = state.gains(changes)[0], state.value
    with nowhere():
        gains, touched = state.gains(changes)
        state.move(state.code + changes[0], touched[0])
    assert torch.equal(gains, expected)
    assert state.value == pytest.approx(before - float(expected[0]), rel=1e-9)


def test_masks_are_judged_where_they_lie():
    camera = TASK.camera_of(2)
    expected = float(confusion(window_covariance(camera, WINDOWS, 4)).detach())
    camera = TASK.camera_of(2)
    with nowhere():
        covariance = window_covariance(camera, WINDOWS, 4)
        value = confusion(covariance)
        value.backward()
        drawn = drawn_error(covariance.detach(), 10)
    assert float(value.detach()) == expected
    assert drawn >= 0


def test_examples_and_masks_take_the_device_that_is_computed_on(monkeypatch):
    monkeypatch.setattr("tmca.devices._KINDS", ("cpu", "meta"))
    with computing_on("meta"):
        assert learn_examples(SCENES, block_error().model, WAVES).device == torch.device("meta")
        assert MaskTask(TASK.bench, TASK.camera).device == torch.device("meta")
    assert MaskTask(TASK.bench, TASK.camera).device == torch.device("cpu")


def test_a_device_that_is_not_there_is_refused_before_anything_is_written(tmp_path, capsys):
    with pytest.raises(SettingError, match="one of this machine"):
        design_codes("light-field", out=tmp_path / "out", device="cuda:99")
    for camera in ("spectral", "light-field", "spectral-depth"):
        said = refused(capsys, "design", camera, "--device", "cuda:99", "--out", tmp_path / "out")
        assert "found 'cuda:99', expected one of this machine: cpu" in said
    assert not (tmp_path / "out").exists()


@cuda
def test_a_graphics_processor_searches_codes_alike():
    settings = {"effort": Effort(1, 5, 20), "bands": WAVES}
    designs = []
    for name in ("cpu", "cuda"):
        with computing_on(name):
            examples = learn_examples(SCENES, block_error().model, WAVES)
        error = examples.tile_mse(0.05, 0.01)
        design = search("free", 2, (4, 6), error, **settings)
        assert error.error.device.type == name
        assert not next(design.camera.parameters()).is_cuda
        designs.append((design, examples.held_out(design.camera, 0.05, 0.01)))
    (here, judged), (there, alike) = designs
    assert there.random == pytest.approx(here.random, rel=1e-6)
    assert there.mse == pytest.approx(here.mse, rel=0.02)
    assert alike == pytest.approx(judged, rel=0.02)


@cuda
def test_a_graphics_processor_searches_masks_alike():
    found = []
    for name in ("cpu", "cuda"):
        with computing_on(name):
            task = MaskTask(TASK.bench, TASK.camera, window=4)
        found.append(search_masks(task, WINDOWS, [2], MaskEffort(1, 3), buckets=2))
    here, there = found
    for own, other in zip((*here.candidates, here.burst), (*there.candidates, there.burst), strict=True):
        assert not other.covariance.is_cuda
        assert not other.camera.point_spread.waves.is_cuda
        assert other.history[0] == pytest.approx(own.history[0], rel=1e-3)
        assert other.confusion == pytest.approx(own.confusion, rel=0.05)


@cuda
def test_a_graphics_processor_judges_masks_on_scenes_alike():
    scenes = [smooth_scene(80, 90, 2, seed=seed) for seed in range(2)]
    here, there = (placed_error(TASK.camera_of(2).to(name), WINDOWS, scenes, 4) for name in ("cpu", "cuda"))
    assert there == pytest.approx(here, rel=0.2)  # of other noise


@cuda
@pytest.mark.parametrize(
    ("camera", "effort"),
    [("spectral", Effort(1, 2, 4)), ("light-field", Effort(1, 2, 4)), ("spectral-depth", MaskEffort(1, 2))],
)
def test_a_whole_design_is_written_from_a_graphics_processor(tmp_path, camera, effort):
    shorter = {} if camera == "spectral-depth" else {"survey": effort, "period": 8}
    design_codes(camera, out=tmp_path / "out", slots=[2], device="cuda", effort=effort, **shorter)
    assert json.loads((tmp_path / "out" / "design.json").read_text())["device"] == "cuda"
    assert (tmp_path / "out" / "codes.nc").is_file()
