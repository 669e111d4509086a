"""Where the studies are: beside the source of a checkout; the wheel has none."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import tmca
from tmca.errors import TmcaError


def study_module(name: str) -> Any:
    """A module of the ``studies`` of this checkout, and of no other folder.

    Args:
        name: within ``studies``, such as ``"codes.study"``.

    Raises:
        TmcaError: the package does not run from a checkout.
    """
    root = Path(tmca.__file__).resolve().parents[2]
    marker = root / "studies" / "__init__.py"
    if not marker.is_file():
        remedy = "git clone the repository and install it with pip install -e ."
        raise TmcaError("studies", "none beside this installation", f"the folder {marker.parent}", remedy)
    if str(root) != sys.path[0]:
        sys.path.insert(0, str(root))  # first, for other processes too: a folder of this name elsewhere is not run
    package = import_module("studies")
    if package.__file__ is None or Path(package.__file__).resolve() != marker:
        raise TmcaError("studies", f"{package.__file__}, imported before", str(marker), "start another process")
    return import_module(f"studies.{name}")
