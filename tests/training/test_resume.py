"""A run that is killed at any moment and resumed ends as the run that was not, to the last bit."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

from tests.training import tiny
from tmca.training.loop import Stopped

TINY = Path(tiny.__file__)


def last_state(folder):
    newest = sorted((folder / "checkpoints").iterdir())[-1]
    assert newest.name == "0000008"
    return load_file(newest / "state.safetensors")


def same(one, other):
    return one.keys() == other.keys() and all(torch.equal(one[name], other[name]) for name in one)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("undisturbed") / "run"
    tiny.train(folder)
    return folder


@pytest.mark.parametrize("step", range(1, 8))
def test_a_run_that_breaks_off_after_any_step_ends_the_same(undisturbed, tmp_path, step):
    def break_off(done, steps, said):
        if done == step:
            raise RuntimeError("power cut")

    with pytest.raises(RuntimeError, match="power cut"):
        tiny.train(tmp_path / "run", break_off)
    tiny.train(tmp_path / "run")
    assert same(last_state(tmp_path / "run"), last_state(undisturbed))
    assert (tmp_path / "run" / "log.csv").read_text() == (undisturbed / "log.csv").read_text()
    weights = [load_file(folder / "weights.safetensors") for folder in (tmp_path / "run", undisturbed)]
    assert same(*weights)


def test_sigkill_at_random_moments_changes_nothing(undisturbed, tmp_path):
    moments = random.Random(0)
    command = [sys.executable, str(TINY), str(tmp_path / "run")]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    for _ in range(3):
        process = subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL)
        begun = time.monotonic()
        while not (tmp_path / "run" / "checkpoints").exists() and process.poll() is None:
            assert time.monotonic() - begun < 120
            time.sleep(0.02)
        time.sleep(moments.uniform(0, 0.5))
        process.send_signal(signal.SIGKILL)
        process.wait()
    subprocess.run(command, env=environment, check=True, capture_output=True)
    assert same(last_state(tmp_path / "run"), last_state(undisturbed))


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_run_that_is_asked_to_stop_keeps_its_last_step(undisturbed, tmp_path, number):
    def ask(done, steps, said):
        if done == 3:
            os.kill(os.getpid(), number)

    with pytest.raises(Stopped, match="after step 4"):
        tiny.train(tmp_path / "run", ask)
    assert sorted((tmp_path / "run" / "checkpoints").iterdir())[-1].name == "0000004"
    tiny.train(tmp_path / "run")
    assert same(last_state(tmp_path / "run"), last_state(undisturbed))


def test_two_processes_learn_what_one_does_with_the_doubled_batch(tmp_path):
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    launch = [sys.executable, "-m", "torch.distributed.run", "--nproc-per-node", "2", "--master-port", "29651"]
    subprocess.run([*launch, str(TINY), str(tmp_path / "two")], env=environment, check=True, capture_output=True)
    tiny.train(tmp_path / "one")
    one, two = last_state(tmp_path / "one"), last_state(tmp_path / "two")
    assert one.keys() == two.keys()
    for name, value in one.items():
        if name.startswith("system."):
            torch.testing.assert_close(two[name], value, rtol=1e-3, atol=1e-4, msg=name)
