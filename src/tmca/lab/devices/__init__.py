"""From codes to what devices show, and from what a bench captures to a snapshot."""

from tmca.lab.devices.descriptions import PRESETS, DeviceDescription, device_named
from tmca.lab.devices.export import Export, export_codes
from tmca.lab.devices.joining import check_camera, joined
from tmca.lab.devices.placement import Placement
from tmca.lab.devices.protocol import Device, find_device
from tmca.lab.devices.reading import check_export, read_export
from tmca.lab.devices.session import capture
from tmca.lab.devices.sources import Planes, read_planes

__all__ = [
    "PRESETS",
    "Device",
    "DeviceDescription",
    "Export",
    "Placement",
    "Planes",
    "capture",
    "check_camera",
    "check_export",
    "device_named",
    "export_codes",
    "find_device",
    "joined",
    "read_export",
    "read_planes",
]
