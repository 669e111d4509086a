"""Runs behind benches with faults that their decoders are not told of."""

import numpy as np
import pytest

from tests.training import test_spectral_depth as masks
from tests.training import tiny
from tmca.decoders import Weights
from tmca.errors import SettingError
from tmca.training.faults import DrawnFaults

pytestmark = pytest.mark.filterwarnings("ignore::tmca.optics.StrayLight")


def losses(folder):
    return tiny.logged(folder, "loss")


def test_a_step_has_its_own_faults_within_their_ranges():
    faults = DrawnFaults({"misregistration": (-0.5, 0.25), "contrast_ratio": (20, 100), "jitter": (0.1, 0.1)})
    drawn = [faults.drawn(np.random.default_rng(seed)) for seed in range(1000)]
    shifts = np.array([one.shift for one in drawn])
    assert -0.5 <= shifts.min() < -0.4
    assert 0.15 < shifts.max() <= 0.25
    assert abs(np.corrcoef(shifts.T)[0, 1]) < 0.2
    leaks = [1 / one.contrast_ratio for one in drawn]
    assert np.mean(leaks) == pytest.approx((1 / 20 + 1 / 100) / 2, rel=0.1)
    assert {one.jitter for one in drawn} == {0.1}


@pytest.mark.parametrize("learn", ["none", "both"])
def test_a_run_sees_snapshots_with_faults(tmp_path, learn):
    common = {"optimiser.steps": 2, "camera.learn": learn}
    tiny.train(tmp_path / "perfect", **common)
    tiny.train(tmp_path / "none", **common, faults={})
    found = tiny.train(tmp_path / "faulty", **common, faults={"misregistration": [-1, 1], "hot_pixels": 0.01})
    assert losses(tmp_path / "none") == losses(tmp_path / "perfect")
    assert losses(tmp_path / "faulty") != losses(tmp_path / "perfect")
    assert Weights.load(found.weights).card["training"]["faults"] == {
        "misregistration": [-1.0, 1.0],
        "hot_pixels": [0.01, 0.01],
    }


@pytest.fixture(scope="module", params=[0.0, 2.0])
def perfect(request, tmp_path_factory):
    """Settings of a run of moving scenes, and its losses without faults."""
    folder = tmp_path_factory.mktemp("perfect") / "run"
    common = {"optimiser.steps": 2, "camera.learn": "both", "data.motion": request.param}
    tiny.train(folder, **common)
    return common, losses(folder)


@pytest.mark.parametrize("fault", ["dispersion_error", "blur"])
def test_codes_learn_behind_another_prism_and_a_relay_that_blurs(tmp_path, fault, perfect):
    common, without = perfect
    tiny.train(tmp_path / "faulty", **common, faults={fault: 0.6})
    assert losses(tmp_path / "faulty") != without


@pytest.mark.slow
def test_a_stopped_run_meets_the_same_faults_again(tmp_path):
    faults = {"rolling": [0, 1], "leakage": [0, 0.1]}
    tiny.train(tmp_path / "whole", **{"optimiser.steps": 6}, faults=faults)
    with pytest.raises(KeyboardInterrupt):
        tiny.train(tmp_path / "parts", progress=tiny.stop_after(3), **{"optimiser.steps": 6}, faults=faults)
    tiny.train(tmp_path / "parts", **{"optimiser.steps": 6}, faults=faults)
    assert losses(tmp_path / "parts") == losses(tmp_path / "whole")


def test_masks_learn_behind_faults(tmp_path):
    faults = {"height_error": [-0.1, 0.1], "delay": [-0.2, 0.2]}
    found = masks.train(tmp_path, **{"optimiser.steps": 2, "camera.learn": ["mask"]}, faults=faults)
    assert found.steps == 2


@pytest.mark.parametrize(
    ("faults", "words"),
    [
        ({"wobble": 1}, "wobble"), ({"delay": [1, 0]}, "least value first"), ({"leakage": [0, 2]}, "0 to 1"),
        ({"motion": 1}, "contrast_ratio"), ({"hot_pixels": [0, 0.6], "dead_pixels": [0, 0.6]}, "1 together"),
        ({"height_error": 0.1}, "spectral run"), ({"delay": "late"}, "faults"),
    ],
)  # fmt: skip
def test_impossible_faults_leave_no_run(tmp_path, faults, words):
    with pytest.raises(SettingError, match=words):
        tiny.train(tmp_path / "run", faults=faults)
    assert not (tmp_path / "run" / "weights.safetensors").exists()


def test_a_prism_that_disperses_nothing_has_no_error_of_it(tmp_path):
    with pytest.raises(SettingError, match="dispersion_error"):
        tiny.train(tmp_path, **{"camera.disperser": "dual"}, faults={"dispersion_error": [-0.1, 0]})
