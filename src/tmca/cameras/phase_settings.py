"""Masks and shutter of a spectral-depth camera as they stand in a file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tmca.codes.files import tensors
from tmca.optics import PhaseAttributes, check_stated, restored_maps

if TYPE_CHECKING:
    import xarray as xr

FAMILIES = {
    "coefficients": (("slot", "mode"), {"units": "m", "long_name": "rms of Zernike modes over the aperture"}),
    "noll": (("mode",), {"units": "1", "long_name": "Noll index of the mode"}),
    "radii": (("slot", "radius"), {"units": "m", "long_name": "heights at even radii, from the middle to the rim"}),
}
"""Variables of masks that are not free-form."""


def phase_settings(dataset: xr.Dataset, where: str, stated: PhaseAttributes) -> dict[str, Any]:
    """Arguments of a camera that show masks (as ``HeightMaps`` of their family) and shutter of a file at any bands."""
    family = [name for name in FAMILIES if name in dataset]
    parts = tensors(dataset, where, "heights", "shutter", "cells", *family)
    check_stated(stated, parts["heights"].shape, dataset.sizes.get("wavelength", 1), where)
    return {
        **({} if stated.stroke is None else {"stroke": stated.stroke}),
        "bench": stated.bench,
        "depth": (stated.depth.near, stated.depth.far),
        "planes": stated.depth.count,
        "slots": len(parts["heights"]),
        "mask": restored_maps(parts["heights"], parts, stated.stroke),
        "shutter": parts["shutter"],
        "cells": parts["cells"].long(),
        "period": len(parts["cells"]),
        "energy": stated.energy,
    }
