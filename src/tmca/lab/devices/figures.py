"""What an export shows, as one picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.lab.devices.frames import read_frame
from tmca.lab.devices.mirror import read_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SLOTS = 4


def export_figure(manifest: dict[str, Any], folder: Path) -> Figure:
    """The first slots of every plane: frames as devices show them, Zernike terms as bars.

    Args:
        manifest: of the export.
        folder: of the export.
    """
    from matplotlib.figure import Figure

    planes, columns = manifest["planes"], min(_SLOTS, manifest["slots"])
    figure = Figure(figsize=(2.6 * columns, 2.4 * len(planes)), layout="constrained")
    axes = figure.subplots(len(planes), columns, squeeze=False)
    for row, plane in zip(axes, planes, strict=True):
        for slot, axis in enumerate(row):
            _draw(axis, plane, slot, folder)
        row[0].set_ylabel(f"{plane['plane']}\n{plane['device']['name']}", fontsize=8)
    return figure


def _draw(axis: Any, plane: dict[str, Any], slot: int, folder: Path) -> None:
    frame = plane["frames"][slot]
    axis.set_title(f"slot {slot}, from {frame['start_s'] * 1e3:g} ms", fontsize=8)
    if "placement" not in plane:
        terms = read_table(folder / frame["file"])
        axis.bar(np.arange(len(terms.noll)), terms.rms[slot] * 1e9, color="tab:blue")
        axis.set_xticks(np.arange(len(terms.noll)), [str(index) for index in terms.noll], fontsize=6)
        axis.tick_params("y", labelsize=6)
        axis.set_xlabel("Noll index; nm rms of surface", fontsize=7)
        return
    axis.imshow(read_frame(folder / frame["file"]), cmap="gray", interpolation="nearest")
    axis.set_xticks([])
    axis.set_yticks([])
