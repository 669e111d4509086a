"""Pictures of what a camera does: its snapshot, the rays through its mask, its point spread functions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from tmca.plots import codes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tmca.cameras import LightFieldCamera, Snapshot, SpectralDepthCamera

_POINTS = 4


def snapshot_figure(snapshot: Snapshot[Any], title: str) -> Figure:
    """The recorded image, mean of its colours or channels, and how its values fill the sensor's range."""
    title += snapshot.averaged
    return codes.snapshot_figure(snapshot.image(), snapshot.camera.full_scale, snapshot.camera.channel, title)


def rays_figure(camera: LightFieldCamera) -> Figure:
    """What each mask point does to the rays that cross it."""
    seen = camera.code_through_mask().detach().cpu().numpy()
    bucket = f", bucket 1 of {camera.buckets}" if camera.buckets > 1 else ""
    return codes.sub_images_figure(seen, f"code seen from the mask, K = {camera.slots}{bucket}")


def psf_figure(camera: SpectralDepthCamera) -> Figure:
    """Point spread functions of every slot over depth, and the equivalent ones of a few pixels (thesis figure 26)."""
    middle, planes = (camera.size[0] // 2, camera.size[1] // 2), range(camera.planes.count)
    places = [(middle[0], middle[1] + step) for step in range(_POINTS)]
    with torch.no_grad():
        rows = {f"slot {k + 1} of {camera.slots}": psf.sum(1).cpu().numpy() for k, psf in enumerate(camera.psf())}
        for place in places:
            seen = [camera.equivalent_psf(place, d).sum((0, 1)).cpu().numpy() for d in planes]
            rows[f"pixel {place[0]}, {place[1]}"] = np.stack(seen)
    return codes.psf_figure(rows, camera.planes.metres.tolist())
