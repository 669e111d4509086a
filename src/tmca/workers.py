"""Work in processes side by side, which end with the one that asked for it."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import Any, TypeVar

Result = TypeVar("Result")


def in_processes(
    function: Callable[..., Result],
    work: Sequence[tuple[Any, ...]],
    jobs: int,
    prepare: Callable[[], None] | None = None,
) -> Iterator[tuple[int, Result]]:
    """The place of each piece of work and its result, as they come; what one raises stops the others.

    Args:
        function: of a module, called with the arguments of a piece; what it returns and raises is pickled.
        work: arguments of every piece.
        jobs: processes, each with one thread for its numbers; they are new Python processes.
        prepare: of a module, called first in each of them.
    """
    with ProcessPoolExecutor(jobs, get_context("spawn"), initializer=_begin, initargs=(os.getpid(), prepare)) as pool:
        running = {pool.submit(_call, function, piece): place for place, piece in enumerate(work)}
        try:
            for future in as_completed(running):
                yield running[future], future.result()
        except BaseException:
            workers = list((pool._processes or {}).values())
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in workers:
                worker.terminate()  # a training writes a checkpoint first
            raise


def _begin(parent: int, prepare: Callable[[], None] | None) -> None:
    """One thread for the numbers, and another that stops the work when its parent is gone."""
    import torch

    torch.set_num_threads(1)
    if prepare is not None:
        prepare()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1)
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=watch, daemon=True).start()


def _call(function: Callable[..., Result], piece: tuple[Any, ...]) -> Result:
    """A piece of work; a process that is asked to stop takes no other one."""
    try:
        return function(*piece)
    except KeyboardInterrupt:
        os._exit(130)
