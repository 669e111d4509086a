"""``tmca train`` as a user meets it."""

import os
import signal
import subprocess
import sys
import time

import pytest

from tests.cli.calls import answer
from tests.cli.refusals import refused
from tmca.cli import main
from tmca.decoders import Weights

TINY = """
camera: {size: [24, 32], slots: 2, period: 8, learn: both}
decoder: {kind: unrolled, stages: 1, widths: [4], blocks: 1, start: dagger}
data: {patch: 16, batch: 2, bands: 3}
validate_every: 2
"""


RUN = ("train", "spectral", "--config", "run.yaml", "--train", "chelsea", "--out", "run", "--steps")


@pytest.fixture(autouse=True)
def described(tmp_path):
    (tmp_path / "run.yaml").write_text(TINY + "checkpoint_every: 2\n")


def test_a_run_leaves_weights_that_reconstruct(tmp_path, capsys):
    said = answer(capsys, *RUN, "2", "--validation", "rocket")
    assert said["steps"] == 2
    assert said["best"]["psnr"] > 0
    assert Weights.load(said["weights"]).card["training"]["data"]["train"] == ["chelsea"]
    scene = ["coffee", "--bands", "3", "--crop", "24x32", "--slots", "2", "--no-figures", "--out", "s.nc"]
    main(["simulate", "spectral", *scene])
    main(["reconstruct", "s.nc", "--weights", said["weights"], "--no-figures"])
    assert (tmp_path / "s_network.nc").exists()
    other = ["coffee", "--bands", "4", "--crop", "24x32", "--no-figures", "--out", "other.nc"]
    main(["simulate", "spectral", *other])
    assert "3 bands" in refused(capsys, "reconstruct", "other.nc", "--weights", said["weights"])


def test_another_run_in_the_folder_is_refused(capsys):
    main([*RUN, "1"])
    assert "optimiser.steps = 1, now 2" in refused(capsys, *RUN, "2")


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_run_that_is_stopped_says_where(tmp_path, number):
    command, environment = [sys.executable, "-m", "tmca.cli", *RUN, "100000"], {**os.environ, "OMP_NUM_THREADS": "1"}
    process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
    begun = time.monotonic()
    while not list((tmp_path / "run").glob("checkpoints/0*")):
        assert time.monotonic() - begun < 240
        time.sleep(0.1)
    process.send_signal(number)
    said = process.communicate(timeout=120)[1]
    assert process.returncode == 130
    assert "stopped after step" in said.splitlines()[-1]
    assert "Traceback" not in said
