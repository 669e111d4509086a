"""Which files of a folder make up an RGB-D scene: layouts of file names."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from tmca.errors import DataError

_PICTURE = r"\.(?:png|jpe?g|bmp)"
MIDDLEBURY_2005, MIDDLEBURY_2014, SKIMAGE = "Middlebury 2005", "Middlebury 2014", "Middlebury 2014 of scikit-image"
NYUV2, OPEN3D = "NYU Depth v2", "Open3D"


@dataclass(frozen=True)
class Layout:
    """How a data set names picture and depth.

    Args:
        data_set: its name.
        picture, depth: patterns of the file names, with the groups ``set`` and ``stem`` where a folder holds several.
        names: how they read, for messages.
    """

    data_set: str
    picture: re.Pattern[str]
    depth: re.Pattern[str]
    names: tuple[str, str]


def _layout(data_set: str, picture: str, depth: str, names: tuple[str, str]) -> Layout:
    return Layout(data_set, re.compile(picture, re.IGNORECASE), re.compile(depth, re.IGNORECASE), names)


_STEM, _FRAME = r"(?P<stem>.+)", r"(?P<stem>[^._]+)"
LAYOUTS = (
    _layout(MIDDLEBURY_2005, rf"{_STEM}_rgb{_PICTURE}", rf"{_STEM}_disp\.png", ("<scene>_rgb.png", "<scene>_disp.png")),
    _layout(MIDDLEBURY_2005, r"view1\.png", r"disp1\.png", ("view1.png", "disp1.png")),
    _layout(MIDDLEBURY_2014, r"im0\.png", r"disp0(?:GT)?\.pfm", ("im0.png", "disp0.pfm")),
    _layout(SKIMAGE, rf"{_STEM}_left{_PICTURE}", rf"{_STEM}_disp\.npz", ("<scene>_left.png", "<scene>_disp.npz")),
    _layout(
        NYUV2, rf"rgb_{_FRAME}{_PICTURE}", rf"sync_depth_{_FRAME}\.png", ("rgb_<frame>.jpg", "sync_depth_<frame>.png")
    ),
    _layout(
        OPEN3D,
        rf"(?P<set>.+_)?color_{_FRAME}{_PICTURE}",
        rf"(?P<set>.+_)?depth_{_FRAME}\.png",
        ("<set>color_<frame>.jpg", "<set>depth_<frame>.png"),
    ),
)


@dataclass(frozen=True)
class RgbdFiles:
    """The files of one scene.

    Args:
        layout: how they are named.
        folder: where they are.
        set, stem: the parts of their names that tell the scene, empty where the folder holds one.
        picture, depth: the two files, None for a missing one.
    """

    layout: Layout
    folder: Path
    set: str
    stem: str
    picture: Path | None
    depth: Path | None

    @property
    def path(self) -> Path:
        """How a user names the scene: its folder, or folder and stem."""
        return self.folder / self.stem if self.stem else self.folder

    @property
    def name(self) -> str:
        """The scene's name; a number has its folder's before it."""
        return self.path.name if not self.stem.isdigit() else f"{self.folder.name}_{self.stem}"

    @property
    def complete(self) -> bool:
        """Whether both files are there."""
        return self.picture is not None and self.depth is not None

    def both(self) -> tuple[Path, Path]:
        """Picture and depth.

        Raises:
            DataError: one of them is missing.
        """
        if self.picture is not None and self.depth is not None:
            return self.picture, self.depth
        there, gone = (self.depth, "picture") if self.picture is None else (self.picture, "depth map")
        pattern = self.layout.names[gone != "picture"].replace("<set>", self.set)
        expected = re.sub(r"<(?:scene|frame)>", self.stem, pattern)
        raise DataError(there, f"no {gone} beside it", f"{expected} ({self.layout.data_set})", "add the file")


def scenes_in(folder: Path) -> list[RgbdFiles]:
    """The RGB-D scenes of a folder by name, also those with one file missing."""
    found: dict[tuple[str, str, int], dict[str, Path]] = {}
    for file in sorted(folder.iterdir()) if folder.is_dir() else ():
        role = _role(file.name)
        if role is not None:
            found.setdefault(role[0], {}).setdefault(role[1], file)
    return [
        RgbdFiles(LAYOUTS[number], folder, group, stem, files.get("picture"), files.get("depth"))
        for (stem, group, number), files in sorted(found.items())
    ]


def _role(name: str) -> tuple[tuple[str, str, int], str] | None:
    """(Stem, set, layout) and part of a file name, by the first layout that fits."""
    for number, layout in enumerate(LAYOUTS):
        for part, pattern in (("picture", layout.picture), ("depth", layout.depth)):
            match = pattern.fullmatch(name)
            if match:
                words = match.groupdict()
                return (words.get("stem") or "", words.get("set") or "", number), part
    return None


def find_rgbd(path: str | Path) -> RgbdFiles | None:
    """The scene that a folder, one of its files, or folder and stem name; None where there is none.

    Raises:
        DataError: it could be several.
    """
    path = Path(path)
    if path.is_dir():
        scenes = scenes_in(path)
    elif path.exists():
        if _role(path.name) is None:
            return None
        return next((s for s in scenes_in(path.parent) if path in (s.picture, s.depth)), None)
    else:
        scenes = [s for s in scenes_in(path.parent) if path.name in (s.stem, s.set + s.stem)]
    scenes = [s for s in scenes if s.complete] or scenes
    if len(scenes) > 1:
        names = ", ".join(str(s.folder / (s.set + s.stem)) for s in scenes[:4]) + (" …" if len(scenes) > 4 else "")
        raise DataError(path, f"{len(scenes)} RGB-D scenes", "one", f"name one of {names}")
    return scenes[0] if scenes else None
