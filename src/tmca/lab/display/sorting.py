"""Where pixels with several buckets send the light of every slot: as numbers in a sensor's frames, and back."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from tmca.codes.buckets import check_once
from tmca.errors import SettingError
from tmca.lab.display.codes import Planes, by_slot
from tmca.lab.display.devices import DeviceDescription


def check_buckets(codes: Planes, device: DeviceDescription) -> None:
    """Raises SettingError for codes of other buckets than a sensor's, light that goes nowhere without a drain, and a
    slot in two buckets."""
    if device.plane != "shutter":
        return
    if codes.buckets != device.buckets:
        drained = " bucket, the light of closed slots to a drain" if codes.buckets == 1 else " buckets"
        found = f"codes of {codes.buckets}{drained}"
        remedy = f"take a camera with buckets={device.buckets}, or another device"
        raise SettingError(device.name, found, f"{device.buckets}, those of its pixels", remedy)
    shutter = codes.planes["shutter"]
    if codes.buckets == 1 or shutter.ndim == 3:
        return
    check_once(shutter, codes.source)
    lost = int((shutter.sum(0) < 1).sum())
    if lost and None not in device.places:
        found, expected = f"{lost} slots of pixels in no bucket", f"each in one: {device.name} has no drain"
        raise SettingError(codes.source, found, expected, "take a device with a drain, or other codes")


def numbers_of(shutter: NDArray[np.float32], device: DeviceDescription) -> NDArray[np.float32]:
    """(K, H, W) numbers in the frames of a sensor, see ``DeviceDescription.places``.

    Args:
        shutter: (R, K, H, W) of every bucket, or (K, H, W) of the first of two that share all light.
        device: a sensor with several buckets a pixel.
    """
    shutters = shutter if shutter.ndim == 4 else np.stack((shutter, 1 - shutter))
    return np.asarray(sum(n * shutters[b] for n, b in enumerate(device.places) if b is not None))


def shutter_of(numbers: NDArray[np.generic], device: DeviceDescription) -> NDArray[np.float32]:
    """What ``numbers_of`` was given."""
    shutters = np.stack([numbers == device.places.index(bucket) for bucket in range(device.buckets)])
    patterns = torch.from_numpy(shutters.astype(np.float32)).flatten(0, 1)
    return np.asarray(by_slot(patterns, numbers.shape[0], device.buckets).numpy())
