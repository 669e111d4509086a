"""What cameras behind a mask of pixels share on the table."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from tmca.codes import Codes, leaked
from tmca.codes.buckets import bucket_shutters, changing, mixed_buckets
from tmca.errors import DataError, DeviceError
from tmca.lab.calibration.file import Calibration
from tmca.lab.cameras.base import LabCamera, Light, check_light
from tmca.lab.display.codes import Planes
from tmca.lab.frames import Array

MASK_STEPS = frozenset({"dark", "flat", "white", "linearity", "registration", "buckets", "timing"})
"""Steps of a camera behind a mask, whatever its optics."""


class CodedLab(LabCamera):
    """A camera with an aperture and a shutter of pixels."""

    @abstractmethod
    def brightness(self, camera: Any, light: Light) -> Array:
        """Of every band, or view, under a light; DeviceError for one that is not simulated."""

    def lit(self, camera: Any, light: Light) -> tuple[Tensor, ...]:
        check_light(light.kind != "point", f"a point before a {self.kind} camera", "a white scene")
        shares, shape = self.brightness(camera, light), tuple(camera.scene_shape)
        share = torch.from_numpy(shares).float().reshape(1, *shares.shape, *(1 for _ in shape[shares.ndim :]))
        return (share.expand(1, *shape) * light.reflectance * light.exposure,)

    def showing(self, camera: Any, codes: Planes) -> Any:
        nominal = dict(zip(camera.plane_names, camera.codes(), strict=True))
        shown = {name: codes.planes.get(name, plane) for name, plane in nominal.items()}
        if codes.slots != camera.slots:  # one slot after the other, none of them masked
            shown["shutter"] = torch.ones_like(nominal["shutter"][:1]).expand(codes.slots, -1, -1)
        for name, plane in shown.items():
            if plane.shape[1:] != nominal[name].shape[1:]:
                expected = f"the camera's {tuple(nominal[name].shape)}"
                found = f"{name} of {tuple(plane.shape)}"
                raise DeviceError("simulated bench", found, expected, "export them for it")
        return camera.replace(codes=Codes(shown["aperture"], shown["shutter"]), slots=codes.slots)

    def opened(self, camera: Any, patterns: Sequence[int], shares: Tensor, **parts: Any) -> Any:
        return camera.replace(codes=_OpenedCodes(camera.codes, patterns, shares), **parts)

    def on_camera(self, values: Tensor, nominal: Any, measured: Any) -> Tensor:
        collects = measured.codes()[1].unflatten(0, (measured.buckets, -1)).amax(1) > 0
        return values * collects.repeat_interleave(values.shape[-3] // len(collects), 0)


class _OpenedCodes(nn.Module):
    """(aperture, shutter) of some patterns, the shutter open for a share (n, H) of the time."""

    learnable = False
    shares: Tensor

    def __init__(self, codes: nn.Module, patterns: Sequence[int], shares: Tensor) -> None:
        super().__init__()
        self.codes, self.patterns = codes, list(patterns)
        self.register_buffer("shares", shares)

    def forward(self) -> tuple[Tensor, Tensor]:
        aperture, shutter = self.codes()
        return aperture[self.patterns], self.shares[:, :, None].expand(-1, -1, shutter.shape[2]).to(shutter)


def mixed_aperture(codes: Tensor, calibration: Calibration) -> tuple[Array, float]:
    """(K, h, w) what the aperture shows during every slot of the shutter, and the light by which a slot is longer.

    Raises:
        DataError: a timing of another number of slots.
    """
    registration, timing = calibration.part("registration"), calibration.part("timing")
    closed = 0.0 if registration is None else registration.closed_light
    planes = leaked(codes.detach().double(), closed).numpy()
    if timing is None:
        return planes, 1.0
    if timing.slots != len(planes):
        where, wanted = calibration.where, f"{len(planes)}, those of the codes"
        raise DataError(where, f"a timing of {timing.slots} slots", wanted, "measure the timing of these codes")
    overlap = timing.overlap()
    longest = max(1.0, float(overlap.sum(axis=0).max()))
    return np.tensordot(overlap.T / longest, planes, 1), longest


def leaking_shutter(camera: Any, calibration: Calibration) -> Array:
    """(K, H, W) the shutter with its leakage, of several buckets (R·K, H, W) with what is lost between them; closed
    over defective pixels.

    What the aperture was known to leak when the timing was measured and what a registration measured since add up to
    the same light in closed slots.
    """
    shutter, bad = camera.codes()[1].detach().double(), calibration.defects()
    if camera.buckets > 1:
        shutters = bucket_shutters(shutter, camera.slots, camera.buckets)
        if (mixing := calibration.part("buckets")) is not None:
            shutters = mixed_buckets(shutters - mixing.transfer * changing(shutters), mixing.leakage)
        planes = shutters.numpy() if bad is None else np.where(bad[:, None], 0.0, shutters.numpy())
        return planes.reshape(-1, *planes.shape[2:])
    timing, registration = calibration.part("timing"), calibration.part("registration")
    share = 0.0 if timing is None else timing.leakage
    known = calibration.settings("timing").get("aperture_leakage")
    if known is not None and registration is not None and registration.leakage is not None:
        share = max(0.0, share + (known - registration.closed_light))
    planes = leaked(shutter, share).numpy()
    return planes if bad is None else np.where(bad, 0.0, planes)


def grey_codes(aperture: Any, shutter: Any) -> Codes:
    """Single-precision codes without the rounding that leaves [0, 1]."""
    planes = [torch.as_tensor(np.asarray(plane)).clamp(0, 1).float() for plane in (aperture, shutter)]
    return Codes(planes[0], planes[1])
