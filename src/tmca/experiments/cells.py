"""A grid of cells that is computed once: finished cells are kept, failed ones named, a rerun does the rest."""

from __future__ import annotations

import hashlib
import json
import os
import signal
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from warnings import simplefilter

from tmca.data import make_folder, write_json, write_text
from tmca.data.scene_names import SceneWarning
from tmca.errors import SettingError, TmcaError

Settings = dict[str, Any]
Measured = dict[str, Any]
Progress = Callable[[int, int, str], None]
"""Called with (cells done, cells in all, name of the last)."""
Timed = Callable[[int, int, str, float], None]
"""The same with the seconds that are left."""


def timed(told: Timed | None) -> Progress | None:
    """Turn (done, all, name) into (done, all, name, seconds left)."""
    if told is None:
        return None
    start, kept = time.monotonic(), []

    def report(done: int, total: int, name: str) -> None:
        kept.append(done)
        told(done, total, name, (time.monotonic() - start) / len(kept) * (total - done))

    return report


class CellsFailed(TmcaError):
    """Some cells of a grid could not be computed; the others are kept."""


@dataclass
class Failures:
    """Cells of a grid that raised.

    Args:
        folder: of the grid.
        total: cells in all.
        met: name of each and the file of its traceback.
    """

    folder: Path
    total: int = 0
    met: list[tuple[str, Path]] = field(default_factory=list)

    def check(self) -> None:
        """Raise CellsFailed if there are any."""
        if self.met:
            named = ", ".join(name for name, _ in self.met[:3])
            raise CellsFailed(
                self.folder,
                f"{len(self.met)} of {self.total} cells failed ({named}{', …' if len(self.met) > 3 else ''})",
                "",
                f"see {self.met[0][1]}; a rerun computes only what is missing",
            )


@dataclass
class Grid:
    """The cells of one table, computed part by part; what fails is kept for the end, when the rest is written.

    Args:
        compute: module-level function from settings to measured values.
        folder: where a file per finished cell is kept.
        jobs: processes side by side.
        cluster: parameters of submitit, to send the cells to Slurm instead.
        progress: told (done, all, name, seconds left) after each cell of a part.
        failures: cells that raised.
    """

    compute: Callable[[Settings], Measured]
    folder: Path
    jobs: int = 1
    cluster: Settings | None = None
    progress: Timed | None = None
    failures: Failures = field(init=False)

    def __post_init__(self) -> None:
        self.failures = Failures(make_folder(self.folder))

    def run(self, cells: Sequence[Settings], compute: Callable[[Settings], Measured] | None = None) -> list[Measured]:
        """Measured values of the cells that could be computed, in their order."""
        return run_cells(
            cells, compute or self.compute, self.folder, jobs=self.jobs, cluster=self.cluster,
            progress=timed(self.progress), failures=self.failures,
        )  # fmt: skip


def cell_key(settings: Settings) -> str:
    """Name of a cell's file: a digest of everything that makes it."""
    text = json.dumps(settings, sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def run_cells(
    cells: Sequence[Settings],
    compute: Callable[[Settings], Measured],
    folder: str | Path,
    *,
    jobs: int = 1,
    cluster: Settings | None = None,
    progress: Progress | None = None,
    failures: Failures | None = None,
) -> list[Measured]:
    """Compute every cell that has no file in ``folder`` yet.

    Args:
        cells: settings of each cell, JSON values only.
        compute: module-level function from settings to measured values (it runs in another process if jobs > 1).
        folder: where a file per finished cell is kept.
        jobs: processes side by side.
        cluster: parameters of submitit (``timeout_min``, ``slurm_partition``, …) to send the cells to Slurm instead.
        progress: told after each cell.
        failures: takes the cells that raised, for a later ``failures.check()``; they are then left out of the answer.

    Returns:
        Measured values of all cells, in their order.

    Raises:
        CellsFailed: some cells raised and nobody takes them; the message names the first, the folder keeps every
            traceback.
    """
    place = make_folder(folder)
    files = [place / f"{cell_key(cell)}.json" for cell in cells]
    waiting = [i for i, file in enumerate(files) if not file.exists()]
    done, own = len(cells) - len(waiting), Failures(place)
    for index, error in _outcomes(cells, waiting, files, compute, jobs, cluster):
        done += 1
        if error:
            own.met.append((str(cells[index].get("name", index)), files[index].with_suffix(".error.txt")))
        if progress:
            progress(done, len(cells), str(cells[index].get("name", index)))
    own.total = len(cells)
    if failures is None:
        own.check()
    else:
        failures.met, failures.total = failures.met + own.met, failures.total + own.total
    return [json.loads(file.read_text()) for file in files if file.exists()]


def _outcomes(
    cells: Sequence[Settings],
    waiting: Sequence[int],
    files: Sequence[Path],
    compute: Callable[[Settings], Measured],
    jobs: int,
    cluster: Settings | None,
) -> Any:
    if cluster is not None:
        yield from _submitted(cells, waiting, files, compute, cluster)
        return
    if jobs <= 1:
        for index in waiting:
            yield index, _one_cell(cells[index], files[index], compute)
        return
    with ProcessPoolExecutor(jobs, get_context("spawn"), initializer=_worker, initargs=(os.getpid(),)) as pool:
        running = {pool.submit(_cell_of_a_worker, cells[i], files[i], compute): i for i in waiting}
        try:
            for future in as_completed(running):
                yield running[future], future.result()
        except BaseException:
            workers = list((pool._processes or {}).values())
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in workers:
                worker.terminate()  # a training keeps a checkpoint first
            raise


def _submitted(
    cells: Sequence[Settings],
    waiting: Sequence[int],
    files: Sequence[Path],
    compute: Callable[[Settings], Measured],
    parameters: Settings,
) -> Any:
    """The outcomes of cells sent to a cluster through submitit."""
    try:
        import submitit
    except ImportError:
        raise SettingError("--slurm", "no submitit", "the package submitit", "pip install submitit") from None
    if not waiting:
        return
    chosen = dict(parameters)
    executor = submitit.AutoExecutor(files[0].parent / "slurm", cluster=chosen.pop("cluster", "slurm"))
    executor.update_parameters(name="tmca", **chosen)
    with executor.batch():
        sent = [executor.submit(_one_cell, cells[i], files[i], compute) for i in waiting]
    for index, job in zip(waiting, sent, strict=True):
        yield index, job.result()


def _worker(parent: int) -> None:
    """One thread for the numbers, and another that stops the work when the process that asked for it is gone."""
    import torch

    torch.set_num_threads(1)
    simplefilter("ignore", SceneWarning)  # said where the scenes were opened first

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1)
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=watch, daemon=True).start()


def _cell_of_a_worker(cell: Settings, file: Path, compute: Callable[[Settings], Measured]) -> bool:
    """A cell; a process that is told to stop takes no other one."""
    try:
        return _one_cell(cell, file, compute)
    except KeyboardInterrupt:
        os._exit(130)


def _one_cell(cell: Settings, file: Path, compute: Callable[[Settings], Measured]) -> bool:
    """Compute and keep one cell; True if it failed."""
    trouble = file.with_suffix(".error.txt")
    try:
        measured = compute(cell)
    except Exception:
        write_text(traceback.format_exc(), trouble, overwrite=True)
        return True
    write_json({**cell, **measured}, file, overwrite=True)
    trouble.unlink(missing_ok=True)
    return False
