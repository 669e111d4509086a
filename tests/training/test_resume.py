"""A run that is killed at any moment and resumed ends as the run that was not, to the last bit."""

import multiprocessing
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

from tests.prepared import processes
from tests.training import tiny
from tmca.errors import DataError, OutputError, SettingError
from tmca.training.loop import Stopped

TINY = Path(tiny.__file__)


def last_state(folder, steps=8):
    newest = sorted((folder / "checkpoints").iterdir())[-1]
    assert int(newest.name) == steps
    return load_file(newest / "state.safetensors")


def same(one, other):
    return one.keys() == other.keys() and all(torch.equal(one[name], other[name]) for name in one)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("undisturbed") / "run"
    tiny.train(folder)
    return folder


@pytest.mark.parametrize("step", [1, 2, 5, 7])
def test_a_run_that_breaks_off_after_any_step_ends_the_same(undisturbed, tmp_path, step):
    with pytest.raises(RuntimeError, match="stopped"):
        tiny.train(tmp_path / "run", tiny.stop_after(step, RuntimeError))
    tiny.train(tmp_path / "run")
    assert same(last_state(tmp_path / "run"), last_state(undisturbed))
    assert (tmp_path / "run" / "log.csv").read_text() == (undisturbed / "log.csv").read_text()
    weights = [load_file(folder / "weights.safetensors") for folder in (tmp_path / "run", undisturbed)]
    assert same(*weights)


def _carried_out(folder, steps, told):
    """In a process of its own: every step is told when it is done."""
    torch.set_num_threads(1)
    tiny.train(folder, lambda done, every, said: told.send(done), **{"optimiser.steps": steps})


def begun(folder, steps):
    """A run in a process of its own, and what it tells."""
    told, tell = multiprocessing.Pipe(duplex=False)
    process = processes().Process(target=_carried_out, args=(folder, steps, tell))
    process.start()
    tell.close()
    return process, told


@pytest.mark.slow
def test_sigkill_at_random_moments_changes_nothing(tmp_path):
    """Killed while it sets up, then at random moments after random steps, each time in another piece of the run."""
    moments, steps, reached = random.Random(0), 40, [0]
    for phase in ("set-up", "steps", "steps"):
        process, told = begun(tmp_path / "run", steps)
        if phase == "set-up":
            since = time.monotonic()
            while not (tmp_path / "run" / "run.json").exists() and time.monotonic() - since < 120:
                time.sleep(0.005)
        else:
            seen = [told.recv() for _ in range(moments.randrange(3, 14))]
            assert seen[0] > reached[-1] - 2  # from the newest of the checkpoints, which come every two steps
            reached.append(seen[-1])
        time.sleep(moments.uniform(0, 0.05))
        process.kill()
        process.join()
        assert process.exitcode == -signal.SIGKILL
    process, told = begun(tmp_path / "run", steps)
    assert reached[-1] - 2 < told.recv() < steps
    process.join()
    assert process.exitcode == 0
    tiny.train(tmp_path / "undisturbed", **{"optimiser.steps": steps})
    assert same(last_state(tmp_path / "run", steps), last_state(tmp_path / "undisturbed", steps))


def test_what_a_killed_run_left_half_written_is_cleared_away(undisturbed, tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    left = folder / ".run.json.0123456789ab.tmp"
    left.mkdir()
    (left / "run.json").write_text("{")
    tiny.train(folder)
    assert same(last_state(folder), last_state(undisturbed))
    assert not list(folder.rglob(".*.tmp*"))


def test_what_a_killed_run_had_no_time_to_delete_is_deleted(undisturbed, tmp_path):
    run = shutil.copytree(undisturbed, tmp_path / "run")
    kept = sorted(path.name for path in (run / "checkpoints").iterdir())
    shutil.copytree(run / "checkpoints" / kept[0], run / "checkpoints" / "0000001")
    tiny.train(run)
    assert sorted(path.name for path in (run / "checkpoints").iterdir()) == kept


def test_a_run_goes_on_from_the_checkpoint_before_a_damaged_one(undisturbed, tmp_path):
    shutil.copytree(undisturbed, tmp_path / "run")
    newest = sorted((tmp_path / "run" / "checkpoints").iterdir())[-1]
    (newest / "state.safetensors").write_bytes(b"\0" * 64)
    with pytest.warns(UserWarning, match="going on from the one before"):
        tiny.train(tmp_path / "run")
    assert same(last_state(tmp_path / "run"), last_state(undisturbed))


def test_a_run_is_never_worse_than_the_decoder_it_starts_from(undisturbed, tmp_path):
    """On its validation scenes, whatever the learning rate does: the start is validated before the first step."""
    start = str(undisturbed)
    changes = {"codes.start": start, "codes.decoder": start, "optimiser.decoder_rate": 3.0, "optimiser.code_rate": 1.0}
    found = tiny.train(tmp_path / "run", **changes)
    assert found.best["step"] == 0
    log = (tmp_path / "run" / "log.csv").read_text().splitlines()
    assert log[1].startswith("0,")
    kept, before = (load_file(folder / "weights.safetensors") for folder in (tmp_path / "run", undisturbed))
    assert same(kept, before)


def test_a_run_that_never_came_to_a_checkpoint_can_be_told_otherwise(tmp_path):
    with pytest.raises(SettingError, match="nonsense"):
        tiny.train(tmp_path / "run", **{"camera.aperture": "nonsense"})
    tiny.train(tmp_path / "run", **{"optimiser.steps": 1})
    with pytest.raises(OutputError, match="another run"):
        tiny.train(tmp_path / "run", **{"optimiser.steps": 2})


@pytest.mark.parametrize("when", ["set-up", "later"])
def test_a_run_that_bad_input_ends_leaves_nothing_behind(tmp_path, when):
    def load(name):
        if name == ("third" if when == "set-up" else "second"):
            raise DataError(name, "no light", "some", "switch it on")
        return tiny.load(name)

    with pytest.raises(DataError, match="no light"):
        tiny.train(tmp_path / "new" / "run", load=load)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "run").mkdir()
    with pytest.raises(DataError, match="no light"):
        tiny.train(tmp_path / "run", load=load)
    assert list((tmp_path / "run").iterdir()) == []
    (tmp_path / "run" / "run.json").write_text("{}")  # of a run that was killed before its first checkpoint
    with pytest.raises(DataError, match="no light"):
        tiny.train(tmp_path / "run", load=load)
    assert list((tmp_path / "run").iterdir()) == []


def test_a_run_that_has_a_checkpoint_keeps_it_when_its_input_goes_bad(undisturbed, tmp_path):
    def load(name):
        if name == "second":
            raise DataError(name, "no light")
        return tiny.load(name)

    shutil.copytree(undisturbed, tmp_path / "run")
    for part in ("cubes", "starts"):
        shutil.rmtree(tmp_path / "run" / part, ignore_errors=True)
    for checkpoint in sorted((tmp_path / "run" / "checkpoints").iterdir())[1:]:
        shutil.rmtree(checkpoint)
    with pytest.raises(DataError, match="no light"):
        tiny.train(tmp_path / "run", load=load)
    tiny.train(tmp_path / "run")
    assert same(last_state(tmp_path / "run"), last_state(undisturbed))


@pytest.mark.slow
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


def launches(nodes):
    """Commands that start two processes: on one machine, or as if on two."""
    base = [sys.executable, "-m", "torch.distributed.run", "--master-port", "29651"]
    if nodes == 1:
        return [[*base, "--nproc-per-node", "2"]]
    base += ["--nnodes", "2", "--nproc-per-node", "1", "--master-addr", "127.0.0.1"]
    return [[*base, "--node-rank", rank] for rank in ("0", "1")]


@pytest.mark.slow
@pytest.mark.parametrize("nodes", [1, 2])
def test_two_processes_learn_what_one_does_with_the_doubled_batch(undisturbed, tmp_path, nodes):
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    running = [
        subprocess.Popen([*launch, str(TINY), str(tmp_path / "two")], env=environment, stdout=subprocess.DEVNULL)
        for launch in launches(nodes)
    ]
    assert [process.wait(300) for process in running] == [0] * nodes
    one, two = last_state(undisturbed), last_state(tmp_path / "two")
    assert one.keys() == two.keys()
    for name, value in one.items():
        if name.startswith("system."):
            torch.testing.assert_close(two[name], value, rtol=1e-3, atol=1e-4, msg=name)
