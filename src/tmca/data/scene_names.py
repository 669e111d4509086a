"""What scenes are called, how it is noted that they were read, and what tells that their files have changed."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from warnings import warn

from tmca.data.rendering import rendered_names
from tmca.data.rgbd import rgbd_sources
from tmca.data.splits import checksum_of, read_split
from tmca.errors import SettingError

READING = "scene_reading"
"""Attribute of scenes, snapshots and estimates: how the scene was read, as JSON."""


class SceneWarning(UserWarning):
    """What is odd about a scene, said when it is read."""


def identity_of(source: str) -> str | None:
    """Checksum of a scene's file, of a folder's files, or of an RGB-D scene's, which a stem may name; of every scene of
    a split; None for a rendered scene, or one that is not there."""
    path = Path(source)
    if path.suffix == ".txt" and path.is_file():
        return " ".join(str(identity_of(str(scene))) for scene in read_split(path))
    if not path.exists() and source in rendered_names():
        return None
    files = sorted(file for file in path.iterdir() if file.is_file()) if path.is_dir() else rgbd_sources(path)
    if path.is_dir() or files:
        parts = [f"{file.name} {checksum_of(file)}" for file in files]
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()
    return checksum_of(path) if path.is_file() else None


def short_names(scenes: Sequence[str]) -> dict[str, str]:
    """A short name for every scene, longer where two would be the same.

    Raises:
        SettingError: a scene that is named twice.
    """
    if len(set(scenes)) < len(scenes):
        raise SettingError("scenes", "one that is named twice", "different scenes")
    stems = [Path(scene).name if Path(scene).is_dir() else Path(scene).stem for scene in scenes]
    return {
        scene: stem if stems.count(stem) == 1 else str(Path(scene).with_suffix(""))
        for scene, stem in zip(scenes, stems, strict=True)
    }


def compare_source(source: str, truth: str) -> None:
    """Warns where a truth is another scene than the one that was read for the snapshot.

    Warns:
        SceneWarning: their names differ.
    """
    if Path(source).stem != Path(truth).stem:
        warn(f"truth: {truth} is beside a snapshot of {source}; is that the same scene?", SceneWarning, stacklevel=3)
