"""What version 0.1 called ``tmca.lab.devices``: see `tmca.lab.display` and `tmca.lab.acquisition`."""

from tmca.lab.acquisition import Device, Lamp, capture, check_camera, find_device, joined
from tmca.lab.display import Export, check_export, export_codes, read_export, read_planes

__all__ = [
    "Device",
    "Export",
    "Lamp",
    "capture",
    "check_camera",
    "check_export",
    "export_codes",
    "find_device",
    "joined",
    "read_export",
    "read_planes",
]
