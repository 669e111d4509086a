"""The light-field camera on the table: views one by one, and a mask that is laid on the sensor's own grid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from tmca.cameras import LightFieldCamera
from tmca.lab.calibration.file import Calibration
from tmca.lab.calibration.pattern_image import moved, seen_patterns
from tmca.lab.calibration.registration import nominal_matrix
from tmca.lab.cameras.base import BRIGHT, Light, check_light
from tmca.lab.cameras.coded import MASK_STEPS, CodedLab, grey_codes, leaking_shutter, mixed_aperture
from tmca.lab.frames import Array
from tmca.optics import ViewShear
from tmca.sensor import Sensor


class LightFieldLab(CodedLab):
    """Light fields behind a mask in front of the sensor."""

    kind = "light-field"
    steps = MASK_STEPS | {"shear"}
    unmeasured = frozenset({"dispersion", "wavefront"})

    def brightness(self, camera: LightFieldCamera, light: Light) -> Array:
        seen = "none of a light-field camera, which sees white"
        check_light(light.wavelength is None, "one wavelength", seen)
        shares = np.ones(camera.views)
        if light.view is None:
            return shares
        row, column = (one + n // 2 for one, n in zip(light.view, camera.views, strict=True))
        inside = 0 <= row < camera.views[0] and 0 <= column < camera.views[1]
        views = f"one of {camera.views[0]}×{camera.views[1]}, from the middle"
        check_light(inside, f"view {light.view[0]}, {light.view[1]}", views)
        shares[:] = 0
        shares[row, column] = BRIGHT * camera.white / float(camera.response.detach().max())
        return shares

    def registration_light(self, wavelengths: Sequence[float]) -> Light:
        """See ``LabCamera``; the middle view alone is open."""
        return Light("white", view=(0, 0))

    def calibrated(self, camera: LightFieldCamera, calibration: Calibration, sensor: Sensor) -> LightFieldCamera:
        planes, light = mixed_aperture(camera.codes()[0], calibration)
        registration, shear = calibration.part("registration"), calibration.part("shear")
        vignetting = camera.vignetting.detach().double().numpy() * light
        step, scale = camera.shear.step, camera.shear.scale
        if shear is not None:
            relative = shear.vignetting(camera.views)
            vignetting = relative * vignetting.sum() / relative.sum()
        if registration is not None or shear is not None:
            # the mask is laid on the sensor's own grid, on which a step is one of sensor pixels
            on_grid = (step[0] / scale, step[1] / scale) if shear is None else shear.step
            step = (float(on_grid[0]), float(on_grid[1]))
            reach = ViewShear(camera.views, step, 1.0)
            matrix = self.code_map(camera, calibration) if registration is None else registration.matrix
            blur = 0.0 if registration is None else registration.blur
            border, scale = reach.border(camera.size), 1.0
            planes = seen_patterns(planes, moved(matrix, border), reach.mask_size(camera.size), blur)
        return camera.replace(
            codes=grey_codes(planes, leaking_shutter(camera, calibration)), shear=step, mask_scale=scale,
            vignetting=torch.as_tensor(vignetting).float(), sensor=sensor,
        )  # fmt: skip

    def drawn_map(self, camera: LightFieldCamera, wavelength: float | None) -> Array:
        return nominal_matrix(camera.mask_size, camera.size, 1 / camera.shear.scale)

    def code_map(self, camera: LightFieldCamera, calibration: Calibration) -> Array:
        return self.drawn_map(camera, None)
