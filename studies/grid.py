"""The engine of resumable cells, and what names their results: the one file that knows where they are in ``tmca``."""

from __future__ import annotations

import hashlib
from pathlib import Path

from tmca.evaluation.grid import CellsFailed, Grid, Settings, Timed, cell_key, package_version, run_cells
from tmca.evaluation.tables import check_new, repository_commit

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
]


def source(*names: str) -> str:
    """Digest of the source of some numbers, which names their cells: that of the package, and of files of this folder.

    Args:
        names: files of this folder.
    """
    digest = hashlib.sha256(package_version().encode())
    for name in names:
        digest.update((Path(__file__).parent / name).read_bytes())
    return digest.hexdigest()[:20]
