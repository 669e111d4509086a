"""Benches: their drivers, captures of exports, and snapshots of them."""

from tmca.lab.acquisition.drivers import Device, Lamp, Named, Recorded, find_device
from tmca.lab.acquisition.session import capture, check_camera, joined
from tmca.lab.cameras.base import Light

__all__ = ["Device", "Lamp", "Light", "Named", "Recorded", "capture", "check_camera", "find_device", "joined"]
