"""From a snapshot back to its scene, whichever camera took it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class WayBack:
    """What `tmca reconstruct` needs of a camera.

    Args:
        files: (target, figures) to the files that will be written.
        truth: the name of a scene to what the estimate is measured against.
        decode: (decoder, truth=, progress=) to a reconstruction.
        pictures: (reconstruction, target, truth=, overwrite=) to the pictures that were written.
    """

    files: Callable[[Path, bool], list[Path]]
    truth: Callable[[str], Any]
    decode: Callable[..., Any]
    pictures: Callable[..., list[Path]]
