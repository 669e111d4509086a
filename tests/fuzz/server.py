"""Reading in a child of its own: what a damaged file does to it, told in one word."""

from __future__ import annotations

import gc
import importlib
import json
import os
import pkgutil
import resource
import select
import signal
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass
from pathlib import Path
from typing import IO, Any, NoReturn

import numpy as np

from tests.fuzz.kinds import Kind
from tmca.errors import TmcaError

SECONDS, BYTES, BATCH = 10.0, 2 * 2**30, 20
"""Limits of one reading: time, and memory above what was used before; readings in one child."""
_PATIENCE = 6
"""Times as long by the clock as a reading may take where it is not the processor that it waits for."""
HEAVY = (
    "colour", "contourpy", "lightning_fabric", "matplotlib.backends.backend_agg", "matplotlib.pyplot", "networkx",
    "scipy.stats", "skimage.exposure", "skimage.io", "skimage.measure", "skimage.segmentation", "torch._dynamo",
    "torch._export", "torch.export", "torchmetrics",
)  # fmt: skip
"""What is imported where it is needed, which each child would do again."""
READ, REFUSED = "read", "refused"
"""Good ends; the bad ones: traceback, crash, hang, memory, not finite, unnamed."""


@dataclass(frozen=True)
class Verdict:
    """How a reading ended.

    Attributes:
        end: one of the words above.
        text: the message, or where it went wrong.
    """

    end: str
    text: str = ""

    @property
    def good(self) -> bool:
        """Whether the file was read or refused as promised."""
        return self.end in (READ, REFUSED)


def prepare(more: Sequence[str] = ()) -> None:
    """Import once what the readers import, and more, so that every child has it; use nothing that starts threads
    (Zarr)."""
    import h5netcdf  # noqa: F401
    import skimage.metrics  # noqa: F401
    import tifffile  # noqa: F401
    import torch
    import xarray
    import zarr  # noqa: F401
    from PIL import Image

    import tmca

    torch.set_num_threads(1)
    Image.init()
    xarray.backends.list_engines()
    for module in pkgutil.walk_packages(tmca.__path__, "tmca."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    for name in more:
        importlib.import_module(name)
    gc.collect()
    gc.freeze()


def verdicts(works: Sequence[Callable[[], Verdict]], seconds: float = SECONDS) -> Iterator[Verdict]:
    """The verdict of every piece of work: some are done one after the other in a forked child, until it falls.

    What takes too much memory behind others is done again first in a child: they may hold it.
    """
    done = 0
    while done < len(works):
        for place, verdict in enumerate(_batch(works[done : done + BATCH], seconds)):
            if verdict.end == "memory" and place:
                continue
            done += 1
            yield verdict


def _batch(works: Sequence[Callable[[], Verdict]], seconds: float) -> Iterator[Verdict]:
    out, into = os.pipe()
    child = os.fork()
    if not child:
        os.close(out)
        _work(works, into)
    os.close(into)
    with os.fdopen(out, "rb", buffering=0) as lines:  # a buffer would hide lines from select
        for _ in works:
            ready = _waited(lines, child, seconds)
            if not ready:
                os.kill(child, signal.SIGKILL)
                yield Verdict("hang", f"more than {seconds:g} s")
                break
            line = lines.readline()
            if not line:
                break
            yield Verdict(**json.loads(line))
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status) and ready:
        yield Verdict("crash", f"signal {os.WTERMSIG(status)}")


def _waited(lines: IO[bytes], child: int, seconds: float) -> bool:
    """Whether a child answers within some seconds, more of them by the clock where the processor has other work."""
    before = _processor_seconds(child)
    for _ in range(_PATIENCE):
        if select.select([lines], [], [], seconds)[0]:
            return True
        if _processor_seconds(child) - before > 0.9 * seconds:
            return False
    return False


def _processor_seconds(child: int) -> float:
    fields = Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _work(works: Sequence[Callable[[], Verdict]], into: int) -> NoReturn:
    """In the child: a line for each piece of work; it ends itself where one took much memory."""
    _silent()
    _limit()
    for work in works:
        verdict = _measured(work)
        os.write(into, (json.dumps(asdict(verdict)) + "\n").encode())
        if verdict.end == "memory":
            break
    os._exit(0)


def _silent() -> None:
    os.setsid()
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nowhere, stream)


def _limit() -> None:
    virtual = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (virtual + 2 * BYTES, virtual + 2 * BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def _measured(work: Callable[[], Verdict]) -> Verdict:
    before = _peak()
    try:
        verdict = work()
    except BaseException as error:  # nothing may escape a child
        verdict = Verdict("memory" if isinstance(error, MemoryError) else "traceback", _place(error))
    used = _peak() - before
    return Verdict("memory", f"{used / 2**30:.1f} GB") if used > BYTES else verdict


def _place(error: BaseException) -> str:
    steps = traceback.extract_tb(error.__traceback__)
    here = [step for step in steps if "/src/tmca/" in step.filename] or steps
    place = f"{here[-1].filename.rpartition('/src/')[2]}:{here[-1].lineno}" if here else "?"
    return f"{place} {type(error).__name__}: {str(error)[:200]}"


def judge(kind: Kind, path: Path) -> Verdict:
    """Read a file as its kind does, here and now."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            value = kind.read(path)
        except TmcaError as error:
            return _refusal(error, path)
    odd = None if kind.infinite or said else next((name for name, array in numbers(value) if not _finite(array)), None)
    return Verdict(READ) if odd is None else Verdict("not finite", odd)


def _refusal(error: TmcaError, path: Path) -> Verdict:
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, MemoryError):
            return Verdict("memory", _place(cause))
        cause = cause.__cause__ or cause.__context__
    names = [path.name] + ([file.name for file in path.rglob("*")] if path.is_dir() else [])
    text = str(error)
    if not any(name in text for name in names) or len(text) > 600:
        return Verdict("unnamed", f"{_place(error)}")
    return Verdict(REFUSED, text)


def _finite(array: Any) -> bool:
    return bool(np.isfinite(array).all())


def numbers(value: Any, name: str = "", seen: frozenset[int] = frozenset()) -> Iterator[tuple[str, Any]]:
    """Every number and array of numbers in what was read, by its place."""
    if id(value) in seen or len(seen) > 12:
        return
    seen = seen | {id(value)}
    if isinstance(value, bool | str | bytes | None):
        return
    if isinstance(value, int | float | complex):
        yield name, value if not isinstance(value, int) else 0
    elif hasattr(value, "detach"):
        yield name, value.detach().to("cpu").float().numpy() if not value.is_complex() else value.detach().numpy()
    elif isinstance(value, np.ndarray | np.generic):
        if value.dtype.kind in "fc":
            yield name, value
    elif hasattr(value, "data_vars") or hasattr(value, "coords"):
        parts = value.variables if hasattr(value, "data_vars") else {"": value.variable, **dict(value.coords)}
        for key, part in parts.items():
            yield from numbers(np.asarray(part), f"{name}.{key}", seen)
    elif isinstance(value, Mapping):
        for key, part in value.items():
            yield from numbers(part, f"{name}.{key}", seen)
    elif isinstance(value, list | tuple):
        for place, part in enumerate(value):
            yield from numbers(part, f"{name}[{place}]", seen)
    elif is_dataclass(value) and not isinstance(value, type):
        for field in fields(value):
            yield from numbers(getattr(value, field.name), f"{name}.{field.name}", seen)
    elif hasattr(value, "state_dict"):
        yield from numbers(dict(value.state_dict()), name, seen)
