"""Commands in children of one prepared process, which start at once and are ended when it is asked for.

``python -m tests.kills.server`` takes a JSON line, a list of runs side by side, and answers with a line of how
each ended.
"""

from __future__ import annotations

import ctypes
import json
import os
import resource
import select
import signal
import subprocess
import sys
import time
import traceback
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NoReturn

_CHANGES = {"os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.truncate"}
_CAP_DAC_OVERRIDE, _CAPABILITIES = 1, 0x20080522


@dataclass(frozen=True)
class Asked:
    """A command and what happens to it.

    Attributes:
        words: of the command.
        folder: that it runs in.
        number: of the signal it gets; one that SIGSTOP holds up goes on when those asked for after it have ended.
        seconds: after which it gets it; None for another moment, or never.
        change: number of the change to the disk before which it gets it, from 1.
        largest: bytes of a file at most, as on a full disk.
        bound: whether permissions hold for this process, be it root or not.
    """

    words: list[str]
    folder: str
    number: int = signal.SIGKILL
    seconds: float | None = None
    change: int = 0
    largest: int | None = None
    bound: bool = False


@dataclass(frozen=True)
class End:
    """How a command ended: exit code or, negative, signal; what it said; its time, and changes to the disk."""

    code: int
    said: str
    seconds: float
    changes: int = 0


@dataclass
class Server:
    """A prepared process."""

    process: Any = field(init=False)

    def __post_init__(self) -> None:
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.kills.server"],
            cwd=Path(__file__).parents[2], env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip

    def run(self, *asked: Asked) -> list[End]:
        """How commands side by side ended."""
        self.process.stdin.write(json.dumps([asdict(one) for one in asked]) + "\n")
        self.process.stdin.flush()
        return [End(**one) for one in json.loads(self.process.stdout.readline())]

    def close(self) -> None:
        """End it."""
        self.process.stdin.close()
        self.process.wait(60)


def serve() -> None:
    """Answer until the input ends."""
    from tests.fuzz.server import HEAVY, prepare
    from tmca.priors import finding

    prepare(HEAVY)
    finding._SIZE = (64, 64)  # priors of the rendered scenes are learned in every cold cache
    for line in sys.stdin:
        running = [_started(Asked(**one)) for one in json.loads(line)]
        ends = [_ended(*one) for one in reversed(running)]
        print(json.dumps([asdict(end) for end in reversed(ends)]), flush=True)


def _started(asked: Asked) -> tuple[Asked, int, int, int, float]:
    (said, say), (counted, count) = os.pipe(), os.pipe()
    child = os.fork()
    if not child:
        os.close(said)
        os.close(counted)
        _work(asked, say, count)
    os.close(say)
    os.close(count)
    if asked.number == signal.SIGSTOP:
        os.waitid(os.P_PID, child, os.WSTOPPED | os.WEXITED | os.WNOWAIT)
    return asked, child, said, counted, time.monotonic()


def _ended(asked: Asked, child: int, said: int, counted: int, begun: float) -> End:
    text, due = b"", None if asked.seconds is None else begun + asked.seconds
    if asked.number == signal.SIGSTOP:
        os.kill(child, signal.SIGCONT)
    while True:
        ready, _, _ = select.select([said], [], [], None if due is None else max(0.0, due - time.monotonic()))
        if not ready:
            os.kill(child, asked.number)
            due = None
        elif part := os.read(said, 65536):
            text += part
        else:
            break
    _, status = os.waitpid(child, 0)
    seconds = time.monotonic() - begun
    with os.fdopen(counted) as number:
        changes = int(number.read() or 0)
    os.close(said)
    return End(os.waitstatus_to_exitcode(status), text.decode(errors="replace"), seconds, changes)


def _work(asked: Asked, say: int, count: int) -> NoReturn:
    """In the child."""
    os.setsid()
    os.chdir(asked.folder)
    os.environ["TMCA_CACHE"] = str(Path(asked.folder) / "cache")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(say, 1)
    os.dup2(say, 2)
    os.close(say)
    changes = _watched(asked)
    if asked.largest is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (asked.largest, resource.RLIM_INFINITY))
    if asked.bound:
        _without_override()
    code = _called(asked.words)
    os.write(count, str(changes[0]).encode())
    os._exit(code)


def _called(words: list[str]) -> int:
    sys.stdout, sys.stderr = (os.fdopen(number, "w", closefd=False) for number in (1, 2))
    from tmca.cli import main

    code: Any = 0
    try:
        main(words)
    except SystemExit as end:
        code = end.code or 0
    except BaseException:  # what a user would see
        traceback.print_exc()
        code = 1
    sys.stdout.flush()
    sys.stderr.flush()
    return int(code)


def _watched(asked: Asked) -> list[int]:
    """The number of changes to the disk so far; the signal comes before the one that is asked for."""
    changes = [0]

    def hook(event: str, place: tuple[Any, ...]) -> None:
        if event == "open":
            inside, write = place[0], bool((place[2] or 0) & (os.O_WRONLY | os.O_RDWR))
        else:
            inside, write = place[0] if place else None, event in _CHANGES
        if write and isinstance(inside, str | bytes | os.PathLike) and _within(os.fsdecode(inside), asked.folder):
            changes[0] += 1
            if changes[0] == asked.change:
                os.kill(os.getpid(), asked.number)

    sys.addaudithook(hook)
    return changes


def _within(place: str, folder: str) -> bool:
    return not place.startswith("/") or place.startswith(folder)


def _without_override() -> None:
    """Let permissions hold for root as well: this process gives up the right to pass over them."""
    header = (ctypes.c_uint32 * 2)(_CAPABILITIES, 0)
    data = (ctypes.c_uint32 * 6)()
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.capget(header, data) != 0:
        raise OSError(ctypes.get_errno(), "capget")
    for word in (0, 1):
        data[word] &= ~(1 << _CAP_DAC_OVERRIDE)
    if libc.capset(header, data) != 0:
        raise OSError(ctypes.get_errno(), "capset")


if __name__ == "__main__":
    serve()
