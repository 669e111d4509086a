"""A folder of captures with their truth: ``NAME.nc``, or ``NAME_snapshot.nc``, and ``NAME_truth.*``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tmca.errors import DataError, SettingError

_SNAPSHOTS = (".nc", ".h5")
_TRUTHS = (".nc", ".h5", ".nc4", ".hdf5", ".zarr", ".mat", ".hdr", ".tif", ".tiff", ".npy", ".png", ".jpg", "")
"""Suffixes of what may be a truth, first those that are looked for first; folders have none."""
_TRUTH, _SNAPSHOT = "_truth", "_snapshot"


@dataclass(frozen=True)
class PairFiles:
    """Where a capture and its truth lie."""

    name: str
    capture: Path
    truth: Path


def find_pairs(folder: str | Path) -> list[PairFiles]:
    """Captures of a folder with their truth, by name; other files beside them do not matter.

    Args:
        folder: of snapshot files, and beside each its truth: a cube, light field, or cube with depth in any form that
            tmca reads, as a file or a folder.

    Raises:
        DataError: no such folder, no captures, one without a truth, or a truth without a capture.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise DataError(folder, "no such folder", "one of captures NAME.nc with NAME_truth.nc", "check the path")
    captures = [f for f in sorted(folder.iterdir()) if f.suffix in _SNAPSHOTS and not f.stem.endswith(_TRUTH)]
    pairs = [_pair(file) for file in captures if not file.name.startswith(".")]
    names = [pair.name for pair in pairs]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise DataError(folder, f"two captures called {twice[0]}", "one of each name", "rename one and its truth")
    if stray := sorted({name for name in map(_truth_of, folder.iterdir()) if name} - set(names)):
        wanted = f"{stray[0]}.nc beside it"
        raise DataError(folder, f"a truth {stray[0]}{_TRUTH} without a capture", wanted, "add it or move the truth")
    if not pairs:
        remedy = "tmca capture --snapshot NAME.nc and tmca scan join --out NAME_truth.nc write them"
        raise DataError(folder, "no captures", "NAME.nc, each with NAME_truth.nc", remedy)
    return pairs


def _pair(capture: Path) -> PairFiles:
    name = capture.stem.removesuffix(_SNAPSHOT)
    there = [capture.with_name(f"{name}{_TRUTH}{suffix}") for suffix in _TRUTHS]
    truth = next((file for file in there if file.exists()), None)
    if truth is None:
        wanted = f"{name}{_TRUTH}.nc beside it, the scene that it shows"
        raise DataError(capture, "a capture without its truth", wanted, "add it or move the capture elsewhere")
    return PairFiles(name, capture, truth)


def _truth_of(path: Path) -> str:
    """Name of the capture whose truth a path is; "" for other files, pictures among them."""
    there = path.stem.endswith(_TRUTH) and path.suffix in _TRUTHS and path.suffix not in (".png", ".jpg")
    return path.stem.removesuffix(_TRUTH) if there else ""


def held_out(names: Sequence[str], asked: Sequence[str] | None, seed: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of captures to learn from, and of those that are held out.

    Args:
        names: all.
        asked: names of those that are held out, which may be numbers, or one share of all between 0 and 1, drawn by
            the seed; a fifth, one at least, without.
        seed: of the run.

    Raises:
        SettingError: an unknown name, a share that leaves none, or one capture alone.
    """
    if len(names) < 2:
        found = f"{len(names)} capture"
        raise SettingError("--captures", found, "two at least, of which one is held out", "capture another scene")
    if asked and set(asked) <= set(names):
        apart = tuple(name for name in names if name in asked)
    else:
        count = min(max(1, round(_share(asked, names) * len(names))), len(names) - 1)
        drawn = np.random.default_rng(seed).permutation(len(names))[:count]
        apart = tuple(names[i] for i in sorted(drawn))
    if len(apart) == len(names):
        raise SettingError("--validation", "all captures", "some that are left to learn from", "name fewer")
    return tuple(name for name in names if name not in apart), apart


def _share(asked: Sequence[str] | None, names: Sequence[str]) -> float:
    """The share of the captures that is held out.

    Raises:
        SettingError: what is neither a share nor the names of captures.
    """
    if not asked:
        return 0.2
    try:
        share = float(",".join(asked))
    except ValueError:
        share = np.nan
    if not 0 < share < 1:
        unknown = next(name for name in asked if name not in names)
        wanted = f"names of captures ({', '.join(names)}), or a share between 0 and 1"
        raise SettingError("--validation", unknown, wanted)
    return share
