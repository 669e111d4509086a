"""Samples in time from files: NumPy's, MATLAB's and SigMF's. Nothing in them is executed."""

from __future__ import annotations

import json
from math import prod
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic import Field

from tmca.attributes import Attributes, attributes_of
from tmca.data.formats.arrays import npz_heads
from tmca.data.formats.limits import check_bytes
from tmca.data.formats.matlab import check_elements
from tmca.data.formats.stored import whole_file
from tmca.dbd.model import Complex
from tmca.errors import DataError

META, DATA = ".sigmf-meta", ".sigmf-data"
_MOST_META = 10**7
"""Bytes of a SigMF description."""
_TYPES = {"f64": "f8", "f32": "f4", "i32": "i4", "i16": "i2", "i8": "i1", "u32": "u4", "u16": "u2", "u8": "u1"}
_MATLAB = {"double", "single", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))}


class RecordedSamples(NamedTuple):
    """Samples and what their file says of them."""

    samples: Complex
    """``(T,)``, ``(J, T)`` or ``(P, J, T)``."""
    sample_rate_hz: float | None = None


class SigmfGlobal(Attributes):
    """The general part of a SigMF description."""

    datatype: str = Field(alias="core:datatype", max_length=20)
    sample_rate: float | None = Field(default=None, alias="core:sample_rate", gt=0)
    channels: int = Field(default=1, alias="core:num_channels", ge=1, le=64)


class SigmfCapture(Attributes):
    """The first segment of a SigMF recording."""

    sample_start: int = Field(default=0, alias="core:sample_start", ge=0)
    header_bytes: int = Field(default=0, alias="core:header_bytes", ge=0)


def read_recording(path: str | Path, variable: str | None = None) -> RecordedSamples:
    """Samples of a ``.npz``, ``.npy``, ``.mat`` or SigMF file.

    Args:
        path: of the file; either one of a SigMF pair.
        variable: which array, where there are several of numbers.

    Raises:
        DataError: no such file, a damaged one, another format, or several arrays of which none is named.
    """
    path = Path(path)
    if path.suffix in (META, DATA):
        return _sigmf(path)
    if not path.is_file():
        raise DataError(path, "a folder" if path.is_dir() else "no such file", f".npz, .npy, .mat or {META}")
    if path.suffix == ".npz":
        heads = npz_heads(path)
        name = _chosen(path, [one for one, (_, dtype) in heads.items() if dtype.kind in "iufc"], variable)
        shape, dtype = heads[name]
        check_bytes(path, name, prod(shape) * dtype.itemsize)
        with whole_file(path, ".npz of plain arrays"), np.load(path, allow_pickle=False) as loaded:
            return RecordedSamples(_samples(path, name, loaded[name]))
    if path.suffix == ".npy":
        with whole_file(path, ".npy of plain numbers"):
            return RecordedSamples(_samples(path, "array", np.load(path, allow_pickle=False, mmap_mode="r")))
    if path.suffix == ".mat":
        return RecordedSamples(_matlab(path, variable))
    raise DataError(path, f"the suffix {path.suffix!r}", f".npz, .npy, .mat or {META}")


def _matlab(path: Path, variable: str | None) -> Complex:
    """A variable of a MATLAB file of version 5 or 7.3; complex ones of the latter are pairs of real numbers."""
    import h5py
    from scipy.io import loadmat, whosmat

    with whole_file(path, "MATLAB file"):
        if h5py.is_hdf5(path):
            with h5py.File(path) as file:
                sets = {name: one for name, one in file.items() if isinstance(one, h5py.Dataset)}
                name = _chosen(path, [one for one, stored in sets.items() if stored.dtype.kind in "iufcV"], variable)
                check_bytes(path, name, sets[name].size * sets[name].dtype.itemsize)
                values = sets[name][()]
            if values.dtype.names == ("real", "imag"):
                values = values["real"] + 1j * values["imag"]
            return _samples(path, name, values.T)
        numbers = {name: shape for name, shape, kind in whosmat(path) if kind in _MATLAB}
        check_elements(path)
        name = _chosen(path, list(numbers), variable)
        check_bytes(path, name, prod(numbers[name]) * 16)
        return _samples(path, name, loadmat(path, variable_names=[name])[name])


def _chosen(path: Path, names: list[str], variable: str | None) -> str:
    if variable is not None and variable not in names:
        raise DataError(path, f"no {variable!r} of numbers", ", ".join(names) or "an array of samples")
    if variable is None and len(names) != 1:
        raise DataError(path, ", ".join(names) or "no numbers", "one array of samples", "name it: variable=…")
    return variable or names[0]


def _samples(path: Path, name: str, values: Any) -> Complex:
    """``(T,)``, ``(J, T)`` or ``(P, J, T)``: MATLAB's columns are single samples."""
    values = np.asarray(values)
    if values.dtype.kind not in "iufc":
        raise DataError(path, f"{name} of {values.dtype}", "numbers")
    if values.ndim == 2 and 1 in values.shape:
        values = values.reshape(-1)
    if values.ndim not in (1, 2, 3) or not values.size or not np.all(np.isfinite(values)):
        raise DataError(path, f"{name} of shape {values.shape}", "finite samples (T,), (J, T) or (P, J, T)")
    return values.astype(np.complex128)


def _sigmf(path: Path) -> RecordedSamples:
    """The first channel from the first segment on; whole numbers are shares of their full scale.

    See https://sigmf.org, version 1.2.
    """
    meta, data = path.with_suffix(META), path.with_suffix(DATA)
    for one in (meta, data):
        if not one.is_file():
            raise DataError(one, "no such file", f"a pair of {META} and {DATA}")
    check_bytes(meta, "description", meta.stat().st_size, _MOST_META)
    with whole_file(meta, "SigMF description"):
        described = json.loads(meta.read_text(encoding="utf-8"))
    parts = described if isinstance(described, dict) else {}
    about = attributes_of(SigmfGlobal, _mapping(parts.get("global")), meta)
    captures = parts.get("captures")
    first = attributes_of(SigmfCapture, _mapping(captures[0] if isinstance(captures, list) and captures else {}), meta)
    values = _raw(data, about.datatype, about.channels, first.header_bytes)[first.sample_start :]
    return RecordedSamples(_samples(data, "samples", values), about.sample_rate)


def _mapping(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _raw(data: Path, kind: str, channels: int, header: int) -> Any:
    """The samples of the first channel of a file of a SigMF datatype such as ``cf32_le``."""
    form, _, order = kind.partition("_")
    code = _TYPES.get(form[1:])
    if form[:1] not in ("c", "r") or code is None or order not in ("le", "be", ""):
        raise DataError(data.with_suffix(META), f"datatype {kind!r}", "such as cf32_le or ci16_le")
    parts = 2 if form[0] == "c" else 1
    check_bytes(data, "samples", data.stat().st_size)
    with whole_file(data, "SigMF data"):
        numbers = np.fromfile(data, ("<" if order == "le" else ">") + code, offset=header)
    whole = len(numbers) // (parts * channels)
    values = numbers[: whole * parts * channels].reshape(whole, channels, parts)[:, 0].astype(np.float64)
    if code[0] in "iu":
        values = values / 2.0 ** (8 * int(code[1]) - 1) - (1.0 if code[0] == "u" else 0.0)
    return values[:, 0] + 1j * values[:, 1] if parts == 2 else values[:, 0]
