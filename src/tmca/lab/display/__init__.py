"""From codes to what devices show."""

from tmca.lab.display.codes import Planes, read_planes
from tmca.lab.display.devices import PRESETS, DeviceDescription, device_named
from tmca.lab.display.export import Export, export_codes
from tmca.lab.display.manifest import check_export, read_export
from tmca.lab.display.placement import Placement

__all__ = [
    "PRESETS",
    "DeviceDescription",
    "Export",
    "Placement",
    "Planes",
    "check_export",
    "device_named",
    "export_codes",
    "read_export",
    "read_planes",
]
