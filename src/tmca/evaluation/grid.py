"""Cells that are computed once: a file for every finished one, tracebacks of failed ones; a rerun does the rest."""

from __future__ import annotations

import hashlib
import json
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any
from warnings import simplefilter, warn

from pydantic import BaseModel

import tmca
from tmca.attributes import NamedJson, read_json
from tmca.data import make_folder, write_json, write_text
from tmca.data.atomic import sweep_all
from tmca.data.files import content_digest
from tmca.data.scene_names import SceneWarning
from tmca.errors import DataError, SettingError, TmcaError, one_line
from tmca.plugins import BrokenPlugin, source_digest
from tmca.workers import in_processes

_DIGEST = "digest"
"""Entry of a cell's file: of all the others."""
Settings = dict[str, Any]
Measured = dict[str, Any]
Compute = Callable[[Settings], Measured]
Work = tuple[Settings, Path, Compute]
"""A cell, its file, and what computes it."""
Timed = Callable[[int, int, str, float], None]
"""Called with (cells done, cells in all, name of the last, seconds that are left)."""


class CellsFailed(TmcaError):
    """Some cells of a grid could not be computed; the results of the others stay on disk.

    ``results`` is what a study made of them, None where there was nothing.
    """

    results: Measured | None = None


_REASON = 80
"""Characters of a reason in an error; the table has all of it."""


class DamagedCell(UserWarning):
    """A finished cell whose file is no longer what was written: it is computed again."""


@cache
def package_version() -> str:
    """Version and digest of the package's source: what cells are computed by, in a checkout or installed."""
    return f"{tmca.__version__}+{source_digest(Path(tmca.__file__).parent)[:12]}"


def cell_key(settings: Mapping[str, Any], foreign: Sequence[str] = ()) -> str:
    """Name of a cell's file: a digest of everything that makes it, the package's version among it, and what
    `foreign_source` says of classes of other packages."""
    text = json.dumps([package_version(), settings, *foreign], sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()[:20]


@dataclass
class Grid:
    """The cells of one table, computed part by part; what fails is raised at the end, when the rest is written.

    Args:
        compute: module-level function from settings to measured values (it runs in another process if jobs > 1).
        folder: of a file per finished cell.
        jobs: processes side by side.
        cluster: parameters of submitit (``timeout_min``, ``slurm_partition``, …) to send the cells to Slurm instead.
        progress: called with (done, all, name, seconds left) after each cell of a part.
        total: cells in all parts.
        failed: names of those that raised, the files of their tracebacks, and why in one line.
    """

    compute: Compute
    folder: Path
    jobs: int = 1
    cluster: Settings | None = None
    progress: Timed | None = None
    total: int = field(default=0, init=False)
    failed: list[tuple[str, Path, str]] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        make_folder(self.folder)

    def run(self, cells: Sequence[Settings | BaseModel]) -> list[Measured]:
        """Settings and measured values of the cells that could be computed, in their order; those that have a file in
        the folder are not computed again.

        Args:
            cells: settings of each cell, JSON values or a pydantic model of them, with a ``name``; a model may have
                ``foreign``, see `cell_key`.
        """
        sweep_all(self.folder)  # of one that was killed behind its last cell; nothing else would be written here
        asked = [cell.model_dump(mode="json") if isinstance(cell, BaseModel) else cell for cell in cells]
        names = [str(cell.get("name", index)) for index, cell in enumerate(asked)]
        foreign = [getattr(cell, "foreign", ()) for cell in cells]
        files = [self.folder / f"{cell_key(cell, of_it)}.json" for cell, of_it in zip(asked, foreign, strict=True)]
        measured = {file: cell for file in dict.fromkeys(files) if (cell := _finished(file)) is not None}
        waiting = {files[i]: i for i in range(len(asked)) if files[i] not in measured}  # equal cells once
        done, begun = len(asked) - len(waiting), time.monotonic()
        work = [(asked[index], file, self.compute) for file, index in waiting.items()]
        for computed, (place, reason) in enumerate(self._outcomes(work), 1):
            file = work[place][1]
            name, done = names[waiting[file]], done + 1
            if reason:
                self.failed.append((name, file.with_suffix(".error.txt"), reason))
                name = f"{name}: failed, {reason}"
            elif (cell := _finished(file)) is not None:
                measured[file] = cell
            if self.progress:
                left = (time.monotonic() - begun) / computed * (len(asked) - done)
                self.progress(done, len(asked), name, left)
        self.total += len(asked)
        return [dict(measured[file]) for file in files if file in measured]

    def check(self) -> None:
        """Raise CellsFailed if cells raised: the message names the first, the folder holds every traceback."""
        if self.failed:
            (first, trouble, reason), more = self.failed[0], ", …" if len(self.failed) > 1 else ""
            reason = reason if len(reason) <= _REASON else f"{reason[:_REASON]} …"
            raise CellsFailed(
                self.folder,
                f"{len(self.failed)} of {self.total} cells failed ({first}{more})",
                "",
                f"the first says: {reason}; see {trouble.name} there; a rerun computes only what is missing",
            )

    def reasons(self) -> dict[str, str]:
        """Name of every cell that failed → why."""
        return {name: reason for name, _, reason in self.failed}

    def _outcomes(self, work: Sequence[Work]) -> Iterator[tuple[int, str]]:
        """Places of the cells as they end, and why they failed, empty of those that did not."""
        if self.cluster is not None:
            yield from _submitted(work, self.folder, self.cluster)
            return
        if self.jobs <= 1:
            for place, cell in enumerate(work):
                yield place, _one_cell(*cell)
            return
        yield from in_processes(_one_cell, work, self.jobs, _without_warnings)


def run_cells(
    cells: Sequence[Settings | BaseModel], compute: Compute, folder: str | Path, **how: Any
) -> list[Measured]:
    """Settings and measured values of all cells, in their order; arguments as of `Grid`.

    Raises:
        CellsFailed: some cells raised.
    """
    grid = Grid(compute, Path(folder), **how)
    measured = grid.run(cells)
    grid.check()
    return measured


def _finished(file: Path) -> Measured | None:
    """A cell that was computed before; None of one that was not, or whose file is damaged.

    Warns:
        DamagedCell: a damaged one.
    """
    if not file.exists():
        return None
    try:
        cell: Measured = read_json(file, NamedJson)
        if cell.pop(_DIGEST, None) != content_digest(cell, _DIGEST):
            raise DataError(file, "other content than was written", "that of a finished cell")
    except DataError as error:
        warn(f"{error}; it is computed again", DamagedCell, stacklevel=3)
        return None
    return cell


def _submitted(work: Sequence[Work], folder: Path, parameters: Settings) -> Iterator[tuple[int, str]]:
    """The outcomes of cells sent to a cluster through submitit."""
    try:
        import submitit
    except ImportError:
        raise SettingError("--slurm", "no submitit", "the package submitit", "pip install submitit") from None
    if not work:
        return
    chosen = dict(parameters)
    executor = submitit.AutoExecutor(folder / "slurm", cluster=chosen.pop("cluster", "slurm"))
    executor.update_parameters(name="tmca", **chosen)
    with executor.batch():
        sent = [executor.submit(_one_cell, *cell) for cell in work]
    for place, job in enumerate(sent):
        try:
            yield place, job.result()
        except Exception as error:  # a job that ran out of time or memory
            write_text(traceback.format_exc(), work[place][1].with_suffix(".error.txt"), overwrite=True)
            yield place, one_line(error)


def _without_warnings() -> None:
    for said_before in (SceneWarning, BrokenPlugin):  # where scenes were opened, and decoders looked up, first
        simplefilter("ignore", said_before)


def _one_cell(cell: Settings, file: Path, compute: Compute) -> str:
    """Compute a cell and write its file; why it failed in one line, empty if it did not."""
    trouble = file.with_suffix(".error.txt")
    try:
        measured = compute(cell)
    except Exception as error:
        write_text(traceback.format_exc(), trouble, overwrite=True)
        return one_line(error)
    described = {**cell, **measured}
    write_json({**described, _DIGEST: content_digest(described, _DIGEST)}, file, overwrite=True)
    trouble.unlink(missing_ok=True)
    return ""
