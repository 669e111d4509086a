"""The spectral-depth camera on the table: points in its planes, and mirrors with the wavefront that was measured."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import Any

import torch
from torch import Tensor, nn

from tmca.cameras import PhaseCodes, SpectralDepthCamera
from tmca.errors import DataError
from tmca.lab.calibration.file import Calibration
from tmca.lab.cameras.base import BRIGHT, LabCamera, Light, check_light
from tmca.lab.cameras.spectral import band_brightness, middle_first
from tmca.lab.display.codes import Planes
from tmca.optics import FreeForm, ZernikeHeights
from tmca.optics.zernike import noll, zernike_modes
from tmca.sensor import Sensor


class SpectralDepthLab(LabCamera):
    """Cubes with depth behind phase masks."""

    kind = "spectral-depth"
    steps = frozenset({"dark", "psf"})
    unmeasured = frozenset({"shear", "dispersion", "registration", "buckets", "timing"})
    masked = False

    def lit(self, camera: SpectralDepthCamera, light: Light) -> tuple[Tensor, ...]:
        """See ``LabCamera``: a point in the middle, in one plane; its image reaches the same peak in every frame."""
        check_light(light.kind == "point", f"a {light.kind} scene before a {self.kind} camera", "a point")
        clear = float(camera.filters.filters.min()) == 1
        check_light(clear, "a point behind colour filters", "clear ones (--filters clear)")
        planes, depth = [float(one) for one in camera.planes.metres], light.depth or 0.0
        nearest = min(planes, key=lambda one: abs(one - depth))
        distances = ", ".join(f"{one:.4g}" for one in planes)
        check_light(abs(nearest - depth) < 1e-4 * nearest, f"a point at {light.depth} m", f"a plane: {distances} m")
        scene, middle = torch.zeros(1, *camera.scene_shape), (camera.size[0] // 2, camera.size[1] // 2)
        scene[..., middle[0], middle[1]] = torch.from_numpy(band_brightness(camera, light.wavelength)).float()
        plane = torch.full((1, 1, *camera.size), nearest)
        return scene * BRIGHT * camera.white / float(camera.exact(scene, plane).max()), plane

    def showing(self, camera: SpectralDepthCamera, codes: Planes) -> Any:
        """See ``LabCamera``; heights are shown as a mirror's terms."""
        if not codes.modes:
            return camera
        size, modes = camera.point_spread.heights.size, [noll(int(index)) for index in codes.modes["noll"]]
        heights = ZernikeHeights(codes.modes["coefficients"], modes, size)
        return camera.replace(codes=PhaseCodes(camera.point_spread.behind(heights), camera.shutter))

    def opened(self, camera: SpectralDepthCamera, patterns: Sequence[int], shares: Tensor, **parts: Any) -> Any:
        optics = camera.point_spread.behind(FreeForm(camera.point_spread.heights()[list(patterns)]))
        return camera.replace(codes=PhaseCodes(optics, _OpenedShutter(camera.shutter, shares)), **parts)

    def wavelengths(self, camera: SpectralDepthCamera) -> Sequence[float]:
        """See ``LabCamera``; every other half of the bands."""
        bands = camera.wavelengths
        return middle_first(bands[:: max(1, len(bands) // 2)])

    def depths(self, camera: SpectralDepthCamera) -> Sequence[float]:
        """See ``LabCamera``; its farthest, middle and nearest plane."""
        planes = [float(one) for one in camera.planes.metres if isfinite(one)]
        return tuple(dict.fromkeys(planes[k] for k in (0, len(planes) // 2, -1))) if planes else ()

    def calibrated(self, camera: SpectralDepthCamera, calibration: Calibration, sensor: Sensor) -> SpectralDepthCamera:
        heights = camera.codes()[0].detach().double()
        fits = {name: part for name, part in calibration.parts.items() if name.startswith("wavefront")}
        if fits and set(fits) != {f"wavefront{k}" for k in range(camera.slots)}:
            found = f"wavefronts of {len(fits)} slots"
            raise DataError(calibration.where, found, f"{camera.slots}, those of the codes", "measure every slot")
        for name, fit in fits.items():
            modes = zernike_modes(fit.modes, camera.bench.mask_size)
            error = torch.tensordot(torch.from_numpy(fit.coefficients), modes, 1)
            heights[int(name.removeprefix("wavefront"))] += error
        optics = camera.point_spread.behind(FreeForm(heights.float()))
        return camera.replace(codes=PhaseCodes(optics, camera.shutter), sensor=sensor)


class _OpenedShutter(nn.Module):
    """A shutter that is open for a share (n, H) of the time in the place of a coded one."""

    period = None
    shares: Tensor

    def __init__(self, plane: nn.Module, shares: Tensor) -> None:
        super().__init__()
        self.plane = plane
        self.register_buffer("shares", shares)

    def forward(self) -> Tensor:
        coded = self.plane()
        return self.shares[:, :, None].expand(-1, -1, coded.shape[2]).to(coded)

    def part(self, rows: slice, columns: slice) -> Tensor:
        return self()[:, rows, columns]
