"""Which variable of a file is the cube, and which of its axes is the spectral one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from tmca.data.formats.known import find_known
from tmca.data.formats.stored import Contents, Stored
from tmca.data.formats.wavelengths import NAMES, from_file
from tmca.errors import DataError


def spectral_axis(stored: Stored, count: int | None = None) -> int | None:
    """The axis of a three-axis array that runs over wavelength.

    In this order: the axis the file labels so; the one as long as the wavelengths (``count`` of them, or
    those in the file); the one as long as a known set; the odd one out of two equal axes; the shortest by
    half or more; the pages of a file that has them.

    Returns:
        0, 1 or 2, or None where nothing tells.
    """
    labelled = [i for i, name in enumerate(stored.dims) if name.lower() in NAMES]
    if len(labelled) == 1:
        return labelled[0]
    count = count or (None if stored.wavelengths is None else len(stored.wavelengths))
    if count is not None and count in stored.shape:
        return _choose([i for i, n in enumerate(stored.shape) if n == count], stored)
    known = [i for i, n in enumerate(stored.shape) if find_known(stored.name, n)]
    return _choose(known, stored) if known else _odd_one_out(stored)


def _choose(axes: Sequence[int], stored: Stored) -> int:
    """The only candidate, or the format's usual axis among several equal ones."""
    usual = stored.usual_axis % 3
    return usual if usual in axes else axes[0]


def _odd_one_out(stored: Stored) -> int | None:
    shape = stored.shape
    odd = [i for i in range(3) if shape.count(shape[i]) == 1]
    if len(odd) == 1:
        return odd[0]
    shortest = min(range(3), key=lambda i: shape[i])
    others = [n for i, n in enumerate(shape) if i != shortest]
    if 2 * shape[shortest] <= min(others):
        return shortest
    return 0 if stored.pages else None


MAIN = ("estimate", "radiance")
"""Names under which tmca's own files keep their cube, beside others such as its deviation."""


def find_cube(contents: Contents, variable: str | None, count: int | None) -> Stored:
    """The variable to read as a cube: the one asked for, or the only one that can be it.

    Args:
        contents: the open file.
        variable: its name, or None.
        count: how many wavelengths the caller gave, or None.

    Raises:
        DataError: none or several could be the cube, or the one asked for has not three axes.
    """
    if variable is not None:
        return _three_axes(contents, contents.get(variable))
    cubes = [s for s in contents.arrays.values() if s.numeric and len(s.shape) == 3 and s.size]
    if not cubes:
        raise _no_cube(contents)
    named = [s for s in cubes if s.name in MAIN]
    for narrowed in (named, _sized(cubes, count), [s for s in cubes if _is_known(s)], cubes):
        if len(narrowed) == 1:
            return narrowed[0]
    raise DataError(
        contents.path,
        f"{len(cubes)} arrays of three axes ({', '.join(s.name for s in cubes)})",
        "one",
        "choose it with variable= (--variable)",
    )


def _sized(cubes: Sequence[Stored], count: int | None) -> list[Stored]:
    """Those with an axis as long as the given wavelengths, or as their own."""
    lengths = [count or (len(s.wavelengths) if s.wavelengths is not None else None) for s in cubes]
    return [s for s, n in zip(cubes, lengths, strict=True) if n is not None and n in s.shape]


def _is_known(stored: Stored) -> bool:
    return any(find_known(stored.name, n) for n in stored.shape)


def _no_cube(contents: Contents) -> DataError:
    numeric = [s for s in contents.arrays.values() if s.numeric]
    others = ", ".join(f"{s.name} of type {s.dtype}" for s in list(contents.arrays.values())[:6])
    names = ", ".join(f"{s.name} {s.shape}" for s in numeric[:6]) or others or "nothing numeric"
    return DataError(
        contents.path,
        f"no array of three axes ({names})",
        "a spectral cube",
        "read masks and captures with tmca.data.read_array",
    )


def _three_axes(contents: Contents, stored: Stored) -> Stored:
    if len(stored.shape) != 3 or not stored.size:
        raise DataError(
            contents.path,
            f"variable {stored.name!r} of shape {stored.shape}",
            "a spectral cube of three axes",
            "read masks and captures with tmca.data.read_array",
        )
    return stored


def give_wavelengths(arrays: dict[str, Stored]) -> dict[str, Stored]:
    """Give each cube the vector of wavelengths kept beside it in the file, where its length fits an axis."""
    for vector in [s for s in arrays.values() if s.name.rsplit("/", 1)[-1].lower() in NAMES]:
        if not vector.numeric or not vector.size or vector.size != max(vector.shape, default=0):
            continue
        metres = from_file(vector.whole(), vector.attrs.get("units"))
        for name, stored in arrays.items():
            if metres is not None and len(stored.shape) == 3 and len(metres) in stored.shape:
                arrays[name] = replace(stored, wavelengths=metres)
    return arrays
