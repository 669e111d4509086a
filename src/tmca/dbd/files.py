"""On disk: problems and recoveries as labelled NetCDF, samples of one's own as ``.npz``.

Complex numbers in NetCDF have a last dimension ``part``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from difflib import get_close_matches
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from tmca.attributes import Attributes, attributes_of
from tmca.data import read_dataset, write_dataset
from tmca.data.files import SUFFIXES
from tmca.data.formats.arrays import npz_heads
from tmca.data.formats.limits import check_bytes
from tmca.data.formats.stored import whole_file
from tmca.dbd.channel import Channel
from tmca.dbd.model import AXES, LONGEST_NAME, Complex, Problem, Source, Truth, Units
from tmca.dbd.planes import delay_doppler_planes
from tmca.dbd.recordings import DATA, META
from tmca.dbd.simulation import carriers
from tmca.dbd.waveforms import Waveform, with_waveforms
from tmca.errors import DataError, SettingError, ShapeError, TmcaError, check_shape

if TYPE_CHECKING:
    from tmca.dbd.recovery import Recovery

KIND = "dual blind deconvolution"
_POINTS = "normalised delay, Doppler and angle of the paths"
_WAVEFORM = "coefficients of the waveform in its basis"
_UNITS = ("delay_s", "doppler_hz", "carrier_hz", "spacing")
_NPZ = ("y", "sigma", *_UNITS)
_OF_SOURCES = ("basis", "message", "weight")
_CHANNEL = "a known channel with an unknown message has no solver here"
_SEPARATOR, _NEAR = re.compile(r"[\W_\d]"), 0.75
"""What ends the first word of a source's name, and how like that of another one it is where it may be misspelt."""
_RECORDINGS = (".mat", ".npy", META, DATA)
_EXPECTED = "samples y, and basis and message of every source, as `tmca dbd simulate` writes them"


def save_problem(problem: Problem, path: str | Path, *, overwrite: bool = False) -> Path:
    """Writes samples, bases and, where known, truth and units; returns the path.

    Raises:
        OutputError: the file exists or cannot be written.
    """
    variables = {"y": _parts(("antenna", "pulse", "frequency"), problem.y, "samples")}
    for index, source in enumerate(problem.sources):
        about = {"source": source.name, "weight": source.weight}
        columns = ("pulse", "frequency", f"column_{index}")
        variables[f"basis_{index}"] = _parts(columns, source.rows, "rows of the known basis", about)
        variables[f"message_{index}"] = ("pulse", source.message, _about("message that a pulse carries, from 0"))
    for index, truth in enumerate(problem.truth or ()):
        paths, coefficient = (f"path_{index}",), (f"coefficient_{index}",)
        names = {"names": "\n".join(truth.names)} if any(truth.names) else {}
        variables[f"true_points_{index}"] = ((*paths, "axis"), truth.points, _about(f"true {_POINTS}", names))
        variables[f"true_amplitudes_{index}"] = _parts(paths, truth.amplitudes, "true gains of the paths")
        variables[f"true_waveform_{index}"] = _parts(coefficient, truth.waveform, f"true {_WAVEFORM}")
    return _written(variables, {"kind": KIND, "sigma": problem.sigma}, problem, path, overwrite)


def save_recovery(recovery: Recovery, path: str | Path, *, overwrite: bool = False) -> Path:
    """Writes paths, gains, waveforms, bounds, the dual variable and the delay-Doppler planes; returns the path.

    Raises:
        OutputError: the file exists or cannot be written.
    """
    variables = {
        "q": _parts(("antenna", "pulse", "frequency"), recovery.q, "dual variable, whose polynomials show paths")
    }
    for index, (source, given) in enumerate(zip(recovery.sources, recovery.problem.sources, strict=True)):
        variables |= _of_channel(source, given.weight, index)
    for index, (name, planes) in enumerate(delay_doppler_planes(recovery).items()):
        for kind, plane in planes.items():
            dims = [f"{dim}_{kind}_{index}" for dim in map(str, plane.dims)]
            marked = _about(str(kind).replace("_", " "), _extents(plane) | {"source": name})
            variables[f"{kind}_{index}"] = (dims, plane.values.astype(np.float32), marked)
    about = {"kind": f"{KIND}: recovery", "method": recovery.method, "residual": recovery.residual}
    about |= {"exact": int(recovery.exact), "seconds": recovery.seconds, "notes": "; ".join(recovery.notes)}
    about |= {"certificate": recovery.certificate_status, "sigma": recovery.sigma}
    about |= {"unexplained": recovery.unexplained, "doubt": recovery.doubt}
    return _written(variables, about, recovery.problem, path, overwrite)


def _of_channel(channel: Channel, weight: float, index: int) -> dict[str, tuple[Any, ...]]:
    """Variables of an estimated channel."""
    about = {"source": channel.name, "weight": weight, "relative_doppler": int(channel.relative_doppler)}
    paths, coefficient = (f"path_{index}",), (f"coefficient_{index}",)
    variables = {
        f"points_{index}": ((*paths, "axis"), channel.points, _about(_POINTS, about)),
        f"amplitudes_{index}": _parts(paths, channel.amplitudes, "gains of the paths", about),
        f"waveform_{index}": _parts(coefficient, channel.waveform, _WAVEFORM, about),
        f"signal_{index}": _parts(("pulse", "frequency"), channel.signal, "signal that was sent", about),
    }
    if channel.bounds is not None:
        spread = _about(f"standard deviation of {_POINTS}", about)
        variables[f"bounds_{index}"] = ((*paths, "axis"), channel.bounds, spread)
    return variables


def _extents(plane: Any) -> dict[str, Any]:
    """Where the axes of a plane begin and end, in every unit there is."""
    extents = {}
    for name, values in plane.coords.items():
        step = float(values[1] - values[0])
        extents[str(name)] = [float(values[0]), float(values[-1]) + step]
    return extents


def _about(meaning: str, more: Mapping[str, Any] | None = None) -> dict[str, Any]:
    return {"long_name": meaning, "units": "1", **(more or {})}


def _parts(
    dimensions: Sequence[str], values: Complex, meaning: str, more: Mapping[str, Any] | None = None
) -> tuple[Any, ...]:
    return (*dimensions, "part"), np.stack([values.real, values.imag], axis=-1), _about(meaning, more)


def _written(
    variables: dict[str, Any], about: dict[str, Any], problem: Problem, path: str | Path, overwrite: bool
) -> Path:
    """Writes a file with the coordinates of all variables, and attributes where they are known, units among them."""
    import xarray

    units = {} if problem.units is None else asdict(problem.units)
    about |= {f"units_{name}": value for name, value in units.items()}
    known = {name: value for name, value in about.items() if value is not None}
    coordinates = {
        "frequency": ("frequency", carriers(problem.shape[2]), _about("number of the frequency, 0 in the middle")),
        "part": ("part", ["real", "imaginary"], {"long_name": "part of a complex number"}),
        "axis": ("axis", list(AXES), {"long_name": "coordinate of a path"}),
    }
    return write_dataset(xarray.Dataset(variables, coordinates, known), path, overwrite=overwrite)


def load_problem(path: str | Path, waveforms: Mapping[str, Waveform] | None = None) -> Problem:
    """Reads what :func:`save_problem` wrote, or a user's ``.npz`` with ``y`` and ``basis_NAME`` arrays.

    In an ``.npz``, ``basis_NAME`` is ``(M, J)`` or ``(P, M, J)``; ``message_NAME``, ``weight_NAME`` and ``sigma`` are
    optional; without ``message_NAME`` a basis of its own in every pulse carries ``block`` messages and a common one
    the same signal in all pulses. With ``delay_s``, ``doppler_hz`` and ``carrier_hz`` (and ``spacing``), as in
    :class:`Units`, results are in metres and metres a second; without ``carrier_hz`` Dopplers stay in hertz.

    Args:
        path: of the file.
        waveforms: by the names of their sources, in place of bases of the file or beside them; the samples then need
            units, and may lack bases.

    Raises:
        DataError: the file is missing, broken, or lacks something.
        ShapeError, SettingError: arrays that do not fit each other.
    """
    path = Path(path)
    if not path.is_file():
        there = "a folder" if path.is_dir() else "no such file"
        raise DataError(path, there, "a NetCDF file of `tmca dbd simulate`, or an .npz with y and basis_…")
    if path.suffix != ".npz" and path.suffix.lower() not in SUFFIXES:
        remedy = "y is made by tmca.dbd.read_recording and tmca.dbd.spectra_of_recording; write it with np.savez"
        remedy = remedy if path.suffix in _RECORDINGS else ""
        raise DataError(path, f"the suffix {path.suffix!r}", "a file of `tmca dbd simulate` (.nc) or an .npz", remedy)
    try:
        if path.suffix == ".npz":
            return _from_arrays(_npz_arrays(path, waveforms or {}), waveforms or {})
        problem = _from_dataset(path, read_dataset(path))
        _check_misspelt(waveforms or {}, [one.name for one in problem.sources])
        return with_waveforms(problem, waveforms or {})
    except TmcaError as error:
        if error.where.startswith(str(path)):
            raise
        raise type(error)(f"{path}, {error.where}", error.found[:200], error.expected, error.remedy) from error


class SourceAttributes(Attributes):
    """Attributes of a basis; see `Source`."""

    source: str = Field(min_length=1, max_length=200)
    weight: float = Field(gt=0)


class ProblemAttributes(Attributes):
    """Attributes of a file of samples; see `Problem` and `Units`."""

    kind: str = ""
    sigma: float | None = Field(default=None, ge=0)
    delay_s: float | None = Field(default=None, gt=0, alias="units_delay_s")
    doppler_hz: float | None = Field(default=None, gt=0, alias="units_doppler_hz")
    carrier_hz: float | None = Field(default=None, gt=0, alias="units_carrier_hz")
    spacing: float | None = Field(default=None, gt=0, alias="units_spacing")


def _units(given: Mapping[str, float | None]) -> Units | None:
    """Those of the samples, where there are any; DataError for some of them alone."""
    known = {name: value for name in _UNITS if (value := given.get(name)) is not None}
    missing = [name for name in _UNITS[:2] if name not in known]
    if not known or (missing and set(known) <= {"spacing"}):
        return None
    if missing:
        raise DataError("units", f"no {' and no '.join(missing)}", f"{' and '.join(_UNITS[:2])}, or no units at all")
    return Units(**known)


def _from_dataset(path: Path, dataset: Any) -> Problem:
    about = attributes_of(ProblemAttributes, dataset.attrs, path)
    if about.kind != KIND:
        raise DataError(path, f"kind {about.kind[:60]!r}", f"{KIND!r}", "simulate one with `tmca dbd simulate`")
    count = sum(str(name).startswith("basis_") for name in dataset)
    sources = tuple(_source(path, dataset, index) for index in range(count))
    known = [index for index in range(count) if f"true_points_{index}" in dataset]
    truth = tuple(_truth(path, dataset, index) for index in known) or None
    return Problem(_joined(path, dataset, "y"), sources, about.sigma, truth, _units(dict(about)))


def _source(path: Path, dataset: Any, index: int) -> Source:
    name = f"basis_{index}"
    rows, about = _joined(path, dataset, name), attributes_of(SourceAttributes, dataset[name].attrs, path)
    return Source(about.source, rows, _real(path, dataset, f"message_{index}"), about.weight)


def _truth(path: Path, dataset: Any, index: int) -> Truth:
    points = _real(path, dataset, f"true_points_{index}")
    gains, waveform = (_joined(path, dataset, f"true_{part}_{index}") for part in ("amplitudes", "waveform"))
    given = str(dataset[f"true_points_{index}"].attrs.get("names", ""))
    return Truth(points, gains, waveform, tuple(one[:LONGEST_NAME] for one in given.split("\n")) if given else ())


def _joined(path: Path, dataset: Any, name: str) -> Complex:
    """Complex numbers of their two parts."""
    values = _real(path, dataset, name)
    if values.ndim < 2 or values.shape[-1] != 2:
        raise DataError(path, f"{name} of shape {values.shape}", "real and imaginary parts last", _EXPECTED)
    joined: Complex = values[..., 0] + 1j * values[..., 1]
    return joined


def _real(path: Path, dataset: Any, name: str) -> Any:
    if name not in dataset:
        raise DataError(path, f"no {name}", _EXPECTED)
    values = dataset[name].values
    if values.dtype.kind not in "iuf":
        raise DataError(path, f"{name} of type {values.dtype}", "real numbers")
    return values


def _npz_arrays(path: Path, waveforms: Mapping[str, Waveform]) -> dict[str, Any]:
    """The arrays of a user's file, none of which may mean nothing."""
    heads = npz_heads(path)
    names = [name.removeprefix("basis_") for name in heads if name.startswith("basis_")]
    if "y" not in heads or not (names or waveforms):
        remedy = "or give --waveform NAME=chirp:bandwidth=…,duration=… for a basis" if "y" in heads else ""
        raise DataError(path, ", ".join(heads) or "nothing", "y and one basis_NAME or more", remedy)
    of_sources = {f"{kind}_{name}" for kind in _OF_SOURCES for name in names}
    unknown = [name for name in heads if name not in _NPZ and name not in of_sources]
    if unknown:
        known = f"{', '.join(_NPZ)}, and basis_, message_ and weight_NAME of a source"
        channel = any(name.startswith("channel") for name in unknown)
        raise DataError(path, ", ".join(unknown), known, _CHANNEL if channel else "leave the others out")
    check_bytes(path, "samples and bases", sum(prod(shape) * dtype.itemsize for shape, dtype in heads.values()))
    remedy = "np.savez(path, y=…, basis_radar=…, …)"
    with whole_file(path, ".npz of plain arrays", remedy), np.load(path, allow_pickle=False) as loaded:
        return {name: loaded[name] for name in heads}


def _check_misspelt(waveforms: Mapping[str, Waveform], known: Sequence[str]) -> None:
    """Raises SettingError for a waveform beside the bases whose name is nearly that of one of them.

    Names that differ after a digit or a separator alone, such as ``radar`` and ``radar 2``, are of several sources.
    """
    firsts = {_SEPARATOR.split(one)[0]: one for one in known}
    for name in waveforms:
        near = get_close_matches(_SEPARATOR.split(name)[0], list(firsts), 1, _NEAR)
        if name not in known and near and near[0] != _SEPARATOR.split(name)[0]:
            remedy = f"did you mean {firsts[near[0]]}? a source beside them needs a name less like it"
            raise SettingError("waveform", name, f"{', '.join(known)}, the sources with a basis", remedy)


def _check_transposed(y: Any, name: str, rows: Any) -> None:
    """Raises ShapeError for samples or a basis of one pulse that would fit the other way around."""
    if y.ndim < 2 or rows.ndim != 2 or len(rows) == y.shape[-1]:
        return
    if rows.shape[1] == y.shape[-1]:
        raise ShapeError(name, f"shape {rows.shape}", f"({y.shape[-1]}, J): frequencies, subspace", "transposed?")
    if len(rows) == y.shape[-2]:
        expected = f"(P, {len(rows)}), as {name} of shape {rows.shape}: pulses, frequencies"
        raise ShapeError("y", f"shape {y.shape}", expected, "transposed?")


def _single_numbers(arrays: Mapping[str, Any]) -> dict[str, float]:
    """Noise, units and weights; DataError for arrays that are no numbers, or none of these."""
    single = [name for name in arrays if name in _NPZ[1:] or name.startswith("weight_")]
    for name, value in arrays.items():
        if value.dtype.kind not in "iufc":
            raise DataError(name, f"{value.dtype}", "numbers")
        if name in single and (value.size != 1 or value.dtype.kind == "c"):
            raise DataError(name, f"{value.dtype} of shape {value.shape}", "one number")
    return {name: float(arrays[name].reshape(())) for name in single}


def _from_arrays(arrays: dict[str, Any], waveforms: Mapping[str, Waveform]) -> Problem:
    y, sources, numbers = arrays["y"], [], _single_numbers(arrays)
    for name in (one.removeprefix("basis_") for one in arrays if one.startswith("basis_")):
        rows = arrays[f"basis_{name}"]
        if y.ndim < 2 and rows.ndim < 3:
            raise DataError("y", f"{y.ndim} dimension", "(P, M) or (A, P, M), or bases of (P, M, J)")
        _check_transposed(y, f"basis_{name}", rows)
        plain = np.arange(len(rows)) if rows.ndim == 3 else np.zeros(y.shape[-2], np.int64)
        weight = {"weight": numbers[f"weight_{name}"]} if f"weight_{name}" in numbers else {}
        sources.append(Source(name, rows, arrays.get(f"message_{name}", plain), **weight))
    units = _units(numbers)
    _check_misspelt(waveforms, [one.name for one in sources])
    if not sources:  # a stand-in, which only tells the size, until the waveforms take its place
        check_shape("y", y, (..., "pulses", "frequencies"))
        stand_in = Source(next(iter(waveforms)), np.ones((*y.shape[-2:], 1)), np.zeros(y.shape[-2], np.int64))
        sources = [stand_in]
    return with_waveforms(Problem(y, tuple(sources), numbers.get("sigma"), units=units), waveforms)
