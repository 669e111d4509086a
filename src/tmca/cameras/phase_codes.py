"""Codes of the spectral-depth camera as a file: height maps, shutter and filters of one exposure, and their bench.

Nothing in it depends on bands: filters and channels are kept by name, so that a camera of any bands may show them.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from tmca.attributes import attributes_of
from tmca.cameras.phase_settings import phase_settings
from tmca.cameras.spectral_depth import SpectralDepthCamera
from tmca.errors import DataError
from tmca.optics import PhaseAttributes


class PhaseCodesAttributes(PhaseAttributes):
    """What the file says: filters and channels by their names, buckets of a sensor pixel."""

    filters: str
    channels: str
    buckets: Annotated[int, Field(ge=1, le=256)] = 1


def write_phase_codes(
    camera: SpectralDepthCamera,
    path: str | Path,
    filters: str,
    channels: str,
    notes: Mapping[str, Any] | None = None,
    *,
    overwrite: bool = False,
) -> Path:
    """Write a camera's codes as NetCDF: what of its tiled ``variables`` does not depend on bands.

    Args:
        camera: whose shutter repeats.
        path: of the file.
        filters: family of its filters.
        channels: of its sensor.
        notes: further attributes.

    Raises:
        OutputError: the file exists, or cannot be written.
    """
    from tmca.data import write_dataset

    stored = camera.variables(tiled=True)
    dataset = stored.drop_dims("wavelength").reset_coords(drop=True)
    said = {
        name: stored.attrs[name] for name in ("bench", "depth", "exposure", "energy", "stroke") if name in stored.attrs
    }
    buckets = {"buckets": camera.buckets} if camera.buckets > 1 else {}
    dataset.attrs = {**(notes or {}), **said, "filters": filters, "channels": channels, **buckets}
    return write_dataset(dataset, path, overwrite=overwrite)


def read_phase_codes(path: str | Path) -> dict[str, Any]:
    """Arguments of ``SpectralDepthCamera`` that show the codes of a file of ``write_phase_codes``, masks as
    ``HeightMaps`` of their family.

    Raises:
        DataError: no such file, or a part of it is missing or does not fit the others.
    """
    from tmca.data import read_dataset

    dataset = read_dataset(path, ("heights", "shutter", "cells"))
    remedy = "write codes with `tmca design spectral-depth`"
    stated = attributes_of(PhaseCodesAttributes, dataset.attrs, path)
    heights, shutter, cells = (dataset[name].shape for name in ("heights", "shutter", "cells"))
    shown = (heights[0], *cells)
    if len(heights) != 3 or shutter not in (shown, (stated.buckets, *shown)):
        found = f"heights {heights}, shutter {shutter}, cells {cells}"
        raise DataError(path, found, "(K, rows, columns) of maps, (K, Q, Q) and (Q, Q) of a tile", remedy)
    try:
        settings = phase_settings(dataset, str(path), stated)
    except (IndexError, TypeError, ValueError) as error:
        raise DataError(path, f"masks, bench or depth that are none ({error})", "those of a camera", remedy) from error
    return {**settings, **{name: getattr(stated, name) for name in ("filters", "channels", "exposure", "buckets")}}
