"""Pictures of what a camera does: its snapshot, its codes and masks, its point spread functions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from tmca.codes import bucket_shutters
from tmca.plots import codes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tmca.cameras import CodedCamera, LightFieldCamera, Snapshot, SpectralDepthCamera

_POINTS = 4


def snapshot_figure(snapshot: Snapshot[Any], title: str) -> Figure:
    """The recorded image, mean of its colours or channels, and how its values fill the sensor's range."""
    channels = snapshot.camera.snapshot_shape[0] // snapshot.camera.buckets
    title += f", mean of {channels} channels" if channels > 1 else ""
    return codes.snapshot_figure(snapshot.image(), snapshot.camera.full_scale, snapshot.camera.channel, title)


def codes_figure(camera: CodedCamera, corner: int = codes.CORNER) -> Figure:
    """Aperture T, shutter S and the code cube T̂ (thesis figure 19), a corner of ``corner`` pixels of each."""
    cube, (shown, shutters) = camera.code_cube(), camera.bucket_codes()
    cubes = cube.reshape(camera.buckets, -1, *cube.shape[-2:])
    parts = (shown, shutters, cubes) if camera.buckets > 1 else (shown, shutters[0], cubes[0])
    aperture, shutter, code = (plane.detach().cpu().numpy() for plane in parts)
    size = f"first {min(corner, camera.size[0])} × {min(corner, camera.size[1])} of {camera.size[0]} × {camera.size[1]}"
    buckets = f", {camera.buckets} buckets" if camera.buckets > 1 else ""
    title = f"{size} pixels, K = {camera.slots}{buckets}, light throughput {camera.throughput():.1%}"
    return codes.codes_figure(aperture, shutter, code, camera.channel_names, title, corner)


def rays_figure(camera: LightFieldCamera) -> Figure:
    """What each mask point does to the rays that cross it."""
    seen = camera.code_through_mask().detach().cpu().numpy()
    bucket = f", bucket 1 of {camera.buckets}" if camera.buckets > 1 else ""
    return codes.sub_images_figure(seen, f"code seen from the mask, K = {camera.slots}{bucket}")


def phase_codes_figure(camera: SpectralDepthCamera) -> Figure:
    """Height maps and shutter of every slot, filters over the pixels of a tile, and what filters and sensor pass."""
    with torch.no_grad():
        shown = bucket_shutters(camera.shutter(), camera.slots, camera.buckets)
        parts = (camera.codes.optics.heights(), shown, camera.filters.cells(), camera.filters.filters, camera.response)
        heights, shutter, cells, filters, response = (part.cpu().numpy() for part in parts)
    return codes.phase_codes_figure(heights, shutter, cells, filters, response, camera.wavelengths)


def psf_figure(camera: SpectralDepthCamera) -> Figure:
    """Point spread functions of every slot over depth, and the equivalent ones of a few pixels (thesis figure 26)."""
    middle, planes = (camera.size[0] // 2, camera.size[1] // 2), range(camera.planes.count)
    places = [(middle[0], middle[1] + step) for step in range(_POINTS)]
    with torch.no_grad():
        rows = {f"slot {k}": psf.sum(1).cpu().numpy() for k, psf in enumerate(camera.psf())}
        for place in places:
            seen = [camera.equivalent_psf(place, d).sum((0, 1)).cpu().numpy() for d in planes]
            rows[f"pixel {place[0]}, {place[1]}"] = np.stack(seen)
    return codes.psf_figure(rows, camera.planes.metres.tolist())
