"""Zarr stores, xarray's (named axes) and others."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tmca.data.formats.arrays import LABELLED, attrs_of, from_dataset, open_labelled, plain
from tmca.data.formats.stored import Contents, whole_file
from tmca.data.formats.wavelengths import give_wavelengths


@contextmanager
def open_zarr(path: Path) -> Iterator[Contents]:
    """A Zarr store: xarray's (named axes) or a plain array or group; only codecs that run no code."""
    import zarr

    from tmca.data.formats.zarr_codecs import open_store

    with whole_file(path, LABELLED):
        node: Any = open_store(path)
        group = isinstance(node, zarr.Group)
        members = dict(node.arrays()) if group else {path.stem: node}
        labelled = group and bool(members) and all(_has_dims(array) for array in members.values())
    if labelled:
        with open_labelled(path) as dataset:
            yield from_dataset(path, "Zarr", dataset)
    else:
        arrays = {name: plain(path, name, array) for name, array in members.items()}
        yield Contents(path, "Zarr", give_wavelengths(arrays), attrs=attrs_of(path, node))


def _has_dims(array: Any) -> bool:
    """Whether a Zarr array names its axes, in the way of version 3 or of xarray on version 2."""
    named = getattr(array.metadata, "dimension_names", None)
    return not array.shape or bool(named) or "_ARRAY_DIMENSIONS" in array.attrs
