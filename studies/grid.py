"""The engine of resumable cells, and what names their results: the one file that knows where they are in ``tmca``."""

from __future__ import annotations

import hashlib
from pathlib import Path

from tmca.experiments.cells import CellsFailed, Grid, Settings, Timed, cell_key, run_cells, timed
from tmca.experiments.results import check_new, repository_commit
from tmca.experiments.source import source_digest

__all__ = [
    "CellsFailed",
    "Grid",
    "Settings",
    "Timed",
    "cell_key",
    "check_new",
    "repository_commit",
    "run_cells",
    "source",
    "timed",
]


def source(*names: str) -> str:
    """Digest of the source of some numbers, which names their cells: other code makes other cells.

    Args:
        names: rooms of ``tmca``, such as ``"tmca.design"``, with all that they import; and files of this folder.
    """
    rooms = [name for name in names if name.startswith("tmca.")]
    digest = hashlib.sha256(source_digest(*rooms).encode())
    for name in names:
        if name not in rooms:
            digest.update((Path(__file__).parent / name).read_bytes())
    return digest.hexdigest()[:20]
