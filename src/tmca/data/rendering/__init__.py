"""Rendered scenes and light fields: real photographs, measured spectra, nothing to download."""

from __future__ import annotations

from tmca.data.rendering.light_field import rendered_light_field, split_rendered_light_fields
from tmca.data.rendering.photographs import is_rendered, rendered_names, split_rendered
from tmca.data.rendering.pictures import spectral_from_rgb
from tmca.data.rendering.scene import rendered_scene

__all__ = [
    "is_rendered",
    "rendered_light_field",
    "rendered_names",
    "rendered_scene",
    "spectral_from_rgb",
    "split_rendered",
    "split_rendered_light_fields",
]
