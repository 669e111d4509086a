"""Nothing is lost: every command is killed, stopped, run out of disk, and run twice, and what it leaves is whole.

One moment of each signal; ``TMCA_KILL_MOMENTS=20`` (``make kills``) takes twenty.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
from itertools import count

import pytest

from tests.kills.server import Asked, Server
from tests.kills.table import COMMANDS, HELD, contents, inputs, left_over, workplace

pytestmark = pytest.mark.slow
MOMENTS = int(os.environ.get("TMCA_KILL_MOMENTS", "1"))
LARGEST = (0, 700, 9000) if MOMENTS > 1 else (700,)
"""Bytes of a file at most, where there is no room."""
KILLED = [name for name in COMMANDS if MOMENTS > 1 or name != "cold cache"]
WITH_DISK_TROUBLE = [name for name in COMMANDS if MOMENTS > 1 or name not in ("cold cache", "tune")]
"""Long ones that write as others do, ``reconstruct`` and ``train``, are only killed and run twice."""
SIGNALS = {"SIGKILL": signal.SIGKILL, "SIGTERM": signal.SIGTERM}
STOPPED = {signal.SIGKILL: (-signal.SIGKILL, 0), signal.SIGTERM: (130, 0)}


class Bench:
    """Commands, what each leaves undisturbed, and how long that takes."""

    def __init__(self, server, folder):
        self.server, self.folder, self.number = server, folder, count()
        self.read = inputs(server, folder / "read")
        self.known = {}

    def place(self):
        """A new folder to run a command in."""
        return workplace(self.read, self.folder / f"place{next(self.number)}")

    def run(self, name, folder, **how):
        (end,) = self.server.run(Asked(COMMANDS[name], str(folder), **how))
        return end

    def undisturbed(self, name):
        """What a command leaves, and how it ended."""
        if name not in self.known:
            folder = self.place()
            end = self.run(name, folder)
            assert end.code == 0, end.said
            assert left_over(folder) == []
            self.known[name] = contents(folder), end
        return self.known[name]

    def ends_well(self, name, folder):
        """The same command again, after whatever happened: it ends, leaves what it should, and cleans up."""
        end = self.run(name, folder)
        assert end.code == 0, end.said
        self.complete(name, folder)

    def complete(self, name, folder):
        """What a command leaves undisturbed is there, and nothing else."""
        left, wanted = contents(folder), self.undisturbed(name)[0]
        passing = UNFINISHED.get(name, set())  # a run that was stopped has another checkpoint before its last one
        assert {n: v for n, v in left.items() if n not in passing} == {
            n: v for n, v in wanted.items() if n not in passing
        }
        assert len(left) <= len(wanted) + (2 if passing else 0)  # the files of one checkpoint
        assert left_over(folder) == []
        shutil.rmtree(folder)


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    server = Server()
    yield Bench(server, tmp_path_factory.mktemp("kills"))
    server.close()


def refused(end):
    """Whether a command said in one line why it did nothing."""
    lines = [line for line in end.said.splitlines() if line.startswith("tmca: ") and "warning" not in line]
    assert "Traceback" not in end.said, end.said
    return end.code == 2 and len(lines) == 1


def whole(name, folder, bench):
    """Every file that is there is one of the command's, and its reader opens it; a recording is its beginning."""
    left, wanted = contents(folder), bench.undisturbed(name)[0]
    assert set(left) <= set(wanted) | UNFINISHED.get(name, set())
    for recording in (file for file in left if file.endswith(".zarr")):
        assert left[recording] == wanted[recording][: len(left[recording])]
        logged = len(list((folder / recording / "frames" / "log").glob("[0-9]*")))
        assert len(left[recording]) >= logged - 1  # the log of a frame is written last; that of one may be cut


def checkpoints(run, steps):
    """Files of a run's checkpoints before its last one."""
    return {f"{run}/checkpoints/{n:07d}/state.{end}" for n in range(1, steps) for end in ("json", "safetensors")}


UNFINISHED = {
    "train": checkpoints("trained", 6),
    "tune": {f"tuned/starts/{scene}-PLACE.npy" for scene in "ab"} | checkpoints("tuned", 2),
}
"""Files that a command deletes again, or may."""


@pytest.mark.parametrize("signal_name", SIGNALS)
@pytest.mark.parametrize("name", KILLED)
def test_a_command_that_is_killed_leaves_whole_files_and_goes_on(bench, name, signal_name):
    """At moments spread over what it changes on the disk, and over its time, in turn."""
    number, (_, end) = SIGNALS[signal_name], bench.undisturbed(name)
    for moment in range(MOMENTS):
        share = (moment + 0.5) / MOMENTS
        if (moment + (signal_name == "SIGTERM")) % 2:
            when = {"seconds": share * end.seconds}
        else:
            when = {"change": max(1, round(share * end.changes))}
        folder = bench.place()
        killed = bench.run(name, folder, number=number, **when)
        unbegun = moment < 2 and killed.code == -number and not killed.changes and not killed.said
        assert unbegun or killed.code in STOPPED[number], (when, killed.said)
        assert "Traceback" not in killed.said, (when, killed.said)
        whole(name, folder, bench)
        bench.ends_well(name, folder)


@pytest.mark.parametrize("name", WITH_DISK_TROUBLE)
def test_a_command_without_room_says_so_and_goes_on(bench, name):
    """The system ends files at a size, in the middle of a write."""
    for largest in LARGEST:
        folder = bench.place()
        end = bench.run(name, folder, largest=largest)
        assert end.code == 0 or refused(end), end.said
        whole(name, folder, bench)
        bench.ends_well(name, folder)


@pytest.fixture
def small_disk(tmp_path):
    """A file system of a few hundred kB."""
    place = tmp_path / "disk"
    place.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=300k", "tmpfs", str(place)], capture_output=True)
    if mounted.returncode:
        pytest.skip("no right to mount a small disk")
    yield place
    subprocess.run(["umount", "-l", str(place)], check=True)


@pytest.mark.parametrize("name", WITH_DISK_TROUBLE)
def test_a_command_on_a_full_disk_says_so_and_goes_on(bench, name, small_disk):
    for room in (0, 20_000) if MOMENTS > 1 else (20_000,):
        folder = workplace(bench.read, small_disk / f"place{room}")
        status = os.statvfs(small_disk)
        (small_disk / "filler").write_bytes(b"0" * max(0, status.f_bavail * status.f_frsize - room))
        end = bench.run(name, folder)
        (small_disk / "filler").unlink()
        assert end.code == 0 or refused(end), end.said
        whole(name, folder, bench)
        shutil.rmtree(folder)


@pytest.mark.parametrize("name", WITH_DISK_TROUBLE)
def test_a_command_in_a_folder_without_permission_says_so(bench, name):
    folder = bench.place()
    folder.chmod(0o500)
    end = bench.run(name, folder, bound=True)
    folder.chmod(0o700)
    assert refused(end) or not bench.undisturbed(name)[0], end.said
    assert contents(folder) == {}
    assert left_over(folder) == []


@pytest.mark.parametrize("name", COMMANDS)
def test_two_processes_at_once_leave_what_one_does(bench, name):
    """With one folder and one cold cache: both end well with the same files, or one is told in a line.

    A command that holds its folder is told nothing but that: what it does there is not undone by the other.
    """
    folder = bench.place()
    ends = bench.server.run(*[Asked(COMMANDS[name], str(folder))] * 2)
    assert any(end.code == 0 for end in ends), [end.said for end in ends]
    told = [end for end in ends if end.code]
    assert all(refused(end) and (name not in HELD or "going on" in end.said) for end in told), [
        end.said for end in ends
    ]
    bench.complete(name, folder)


@pytest.mark.parametrize("name", sorted(HELD))
def test_a_second_process_is_told_while_the_first_works(bench, name):
    """The first one stands still in the middle of what it changes on the disk until the second has ended."""
    folder, middle = bench.place(), bench.undisturbed(name)[1].changes // 2
    first, second = bench.server.run(
        Asked(COMMANDS[name], str(folder), signal.SIGSTOP, change=middle), Asked(COMMANDS[name], str(folder))
    )
    assert first.code == 0, first.said
    assert refused(second)
    assert "going on" in second.said
    bench.complete(name, folder)
