"""Captures of real prototypes as snapshot files: what a prototype is, its mask in register, its noise."""

from tmca.lab.real_captures.captures import import_capture
from tmca.lab.real_captures.prototype import PixelShutter, SingleDisperser, load_prototype, prototype_names
from tmca.lab.real_captures.registration import Registration, register_mask, registered
from tmca.lab.real_captures.shutter_place import ShutterPlace, shutter_place

__all__ = [
    "PixelShutter",
    "Registration",
    "ShutterPlace",
    "SingleDisperser",
    "import_capture",
    "load_prototype",
    "prototype_names",
    "register_mask",
    "registered",
    "shutter_place",
]
