"""Pictures of what a camera does: its snapshot and its codes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from tmca.experiments.figures import add_bar, bare, evenly, grid, image, plain_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tmca.cameras import Camera, CodedCamera

_CORNER = 48


def snapshot_figure(snapshot: np.ndarray, camera: Camera, title: str) -> Figure:
    """The recorded image (H, W') and how its values fill the sensor's range."""
    figure, axes = grid(1, 2, width=6.0, aspect=snapshot.shape[0] / snapshot.shape[1])
    shown = axes[0, 0].imshow(snapshot, cmap="gray", vmin=0)
    bare(axes[0, 0], title)
    add_bar(axes[0, 0], shown, f"snapshot (1 = one {camera.channel} of a white scene)")
    share = np.clip(np.asarray(snapshot).ravel() / camera.full_scale, -0.05, 1.1)
    axes[0, 1].hist(share, bins=120, color="#00798c")
    axes[0, 1].set_yscale("log")
    plain_axes(axes[0, 1], "levels", "share of full scale", "pixels")
    return figure


def codes_figure(camera: CodedCamera, corner: int = _CORNER) -> Figure:
    """Aperture T, shutter S and the code cube T̂ (thesis figure 19), a corner of ``corner`` pixels of each."""
    aperture, shutter = (plane.detach().cpu().numpy() for plane in camera.codes())
    code = camera.code_cube().detach().cpu().numpy()
    code = code.reshape(-1, *code.shape[-2:])
    names = [f"T̂, {name}" for name in camera.channel_names]
    slots = [f"slot {k + 1} of {camera.slots}" for k in range(camera.slots)]
    rows = [(aperture, [f"T, {s}" for s in slots]), (shutter, [f"S, {s}" for s in slots]), (code, names)]
    if camera.slots == 1:
        # one of them is larger: it holds the dispersed light, or the shear of the views
        height, width = (min(corner, aperture.shape[axis], shutter.shape[axis]) for axis in (1, 2))
        both = np.stack([plane[0, :height, :width] for plane in (aperture, shutter)])
        few = code[evenly(len(code), 6), :height, :width]
        rows = [(np.concatenate((both, few)), ["T", "S", *_picked(names, 6)])]
    columns = min(8, max(len(planes) for planes, _ in rows))
    figure, axes = grid(len(rows), columns, width=1.5, aspect=1.0)
    for row, (planes, titles) in zip(axes, rows, strict=True):
        chosen = evenly(len(planes), columns)
        for axis, index in zip(row, chosen, strict=False):
            image(axis, planes[index, :corner, :corner], titles[index], "gray", max(float(planes.max()), 1e-9))
        for axis in row[len(chosen) :]:
            axis.set_axis_off()
    add_bar(axes[-1, len(evenly(len(rows[-1][0]), columns)) - 1], axes[-1, 0].images[0], "transmittance")
    size = f"first {min(corner, camera.size[0])} × {min(corner, camera.size[1])} of {camera.size[0]} × {camera.size[1]}"
    figure.suptitle(f"{size} pixels, K = {camera.slots}, light throughput {camera.throughput():.1%}", fontsize=9)
    return figure


def _picked(names: Sequence[str], most: int) -> list[str]:
    return [names[index] for index in evenly(len(names), most)]
