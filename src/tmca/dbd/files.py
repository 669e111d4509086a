"""Problems and recoveries on disk: labelled NetCDF, complex numbers as a last dimension ``part``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.data import write_dataset
from tmca.dbd.arrays import Complex, Real
from tmca.dbd.problem import Problem, Truth, Units
from tmca.dbd.recovery import Recovery
from tmca.dbd.source import AXES, Source
from tmca.errors import DataError, TmcaError

if TYPE_CHECKING:
    import xarray

KIND = "dual blind deconvolution"


def save_problem(problem: Problem, path: str | Path, *, overwrite: bool = False) -> Path:
    """Writes samples, bases and, where known, truth and units; returns the path.

    Raises:
        OutputError: the file exists or cannot be written.
    """
    import xarray

    variables: dict[str, Any] = {"y": (("antenna", "pulse", "frequency", "part"), _parts(problem.y))}
    for index, source in enumerate(problem.sources):
        dimensions = ("pulse", "frequency", f"column_{index}", "part")
        known = {"source": source.name, "weight": source.weight}
        variables[f"basis_{index}"] = (dimensions, _parts(np.asarray(source.rows)), known)
        variables[f"message_{index}"] = ("pulse", source.message)
        if problem.truth is not None:
            variables |= _truth_variables(index, problem.truth[index])
    attributes = _attributes(problem)
    frequencies = problem.shape[2]
    coordinates = {"frequency": np.arange(frequencies) - frequencies // 2, "part": ["real", "imaginary"]}
    coordinates["axis"] = list(AXES)
    dataset = xarray.Dataset(variables, coordinates, attributes)
    return _written(dataset, path, overwrite)


def _written(dataset: xarray.Dataset, path: str | Path, overwrite: bool) -> Path:
    write_dataset(dataset, path, overwrite=overwrite)
    return Path(path)


def _attributes(problem: Problem) -> dict[str, Any]:
    attributes: dict[str, Any] = {"kind": KIND}
    if problem.sigma is not None:
        attributes["sigma"] = problem.sigma
    if problem.units is not None:
        attributes |= {f"units_{name}": value for name, value in vars(problem.units).items()}
    return attributes


def _truth_variables(index: int, truth: Truth) -> dict[str, Any]:
    return {
        f"true_points_{index}": ((f"path_{index}", "axis"), truth.points),
        f"true_amplitudes_{index}": ((f"path_{index}", "part"), _parts(truth.amplitudes)),
        f"true_waveform_{index}": ((f"coefficient_{index}", "part"), _parts(truth.waveform)),
    }


def load_problem(path: str | Path) -> Problem:
    """Reads what :func:`save_problem` wrote, or a user's ``.npz`` with ``y`` and ``basis_NAME`` arrays.

    In an ``.npz``, ``basis_NAME`` is ``(M, J)`` or ``(P, M, J)``; ``message_NAME``, ``weight_NAME`` and ``sigma`` are
    optional; without ``message_NAME`` a basis of its own in every pulse carries ``block`` messages and a common one
    the same signal in all pulses.

    Raises:
        DataError: the file is missing, broken, or lacks something.
        ShapeError, SettingError: arrays that do not fit each other.
    """
    path = Path(path)
    if not path.is_file():
        raise DataError(path, "no such file", "a NetCDF file of `tmca dbd simulate`, or an .npz with y and basis_…")
    if path.suffix == ".npz":
        return _from_npz(path)
    import xarray

    try:
        with xarray.open_dataset(path, engine="h5netcdf") as opened:
            dataset = opened.load()
    except (OSError, ValueError, KeyError) as error:
        raise DataError(path, "no NetCDF file", "one written by `tmca dbd simulate`") from error
    if dataset.attrs.get("kind") != KIND:
        raise DataError(
            path, f"kind {dataset.attrs.get('kind')!r}", f"{KIND!r}", "simulate one with `tmca dbd simulate`"
        )
    try:
        return _from_dataset(dataset)
    except KeyError as error:
        raise DataError(path, f"no {error.args[0]}", "samples y, and basis and message of every source") from error
    except TmcaError as error:
        raise type(error)(f"{path}, {error.where}", error.found, error.expected, error.remedy) from error


def _from_dataset(dataset: xarray.Dataset) -> Problem:
    attributes = dataset.attrs
    sources, truths = [], []
    for index in range(sum(str(name).startswith("basis_") for name in dataset)):
        basis = dataset[f"basis_{index}"]
        known = (str(basis.attrs["source"]), _joined(basis.values))
        sources.append(Source(*known, dataset[f"message_{index}"].values, float(basis.attrs["weight"])))
        if f"true_points_{index}" in dataset:
            gains, waveform = (_joined(dataset[f"true_{kind}_{index}"].values) for kind in ("amplitudes", "waveform"))
            truths.append(Truth(dataset[f"true_points_{index}"].values, gains, waveform))
    sigma = float(attributes["sigma"]) if "sigma" in attributes else None
    given = {
        name: float(attributes[f"units_{name}"]) for name in Units.__annotations__ if f"units_{name}" in attributes
    }
    units = Units(**given) if given else None
    return Problem(_joined(dataset["y"].values), tuple(sources), sigma, tuple(truths) or None, units)


def _from_npz(path: Path) -> Problem:
    try:
        with np.load(path) as opened:
            arrays = dict(opened)
    except (OSError, ValueError) as error:
        raise DataError(path, "no .npz of plain arrays", "np.savez(path, y=…, basis_radar=…, …)") from error
    names = [name.removeprefix("basis_") for name in arrays if name.startswith("basis_")]
    if "y" not in arrays or not names:
        raise DataError(path, ", ".join(arrays) or "nothing", "y and one basis_NAME or more")
    y = arrays["y"]
    try:
        sources = [_npz_source(name, arrays, y) for name in names]
        return Problem(y, tuple(sources), float(arrays["sigma"]) if "sigma" in arrays else None)
    except TmcaError as error:
        raise type(error)(f"{path}, {error.where}", error.found, error.expected, error.remedy) from error


def _npz_source(name: str, arrays: dict[str, Any], y: Any) -> Source:
    rows = arrays[f"basis_{name}"]
    if y.ndim < 2 and rows.ndim < 3:
        raise DataError("y", f"{y.ndim} dimension", "(P, M) or (A, P, M), or bases of (P, M, J)")
    pulses = len(rows) if rows.ndim == 3 else y.shape[-2]
    plain = np.arange(pulses) if rows.ndim == 3 else np.zeros(pulses, np.int64)
    message = arrays.get(f"message_{name}", plain)
    weight = {"weight": float(arrays[f"weight_{name}"])} if f"weight_{name}" in arrays else {}
    return Source(name, rows, message, **weight)


def save_recovery(recovery: Recovery, path: str | Path, *, overwrite: bool = False) -> Path:
    """Writes paths, gains, waveforms, bounds and the dual variable; returns the path."""
    import xarray

    variables: dict[str, Any] = {"q": (("antenna", "pulse", "frequency", "part"), _parts(recovery.q))}
    for index, source in enumerate(recovery.sources):
        path_, coefficient = f"path_{index}", f"coefficient_{index}"
        variables[f"points_{index}"] = ((path_, "axis"), source.points, {"source": source.name})
        variables[f"amplitudes_{index}"] = ((path_, "part"), _parts(source.amplitudes))
        variables[f"waveform_{index}"] = ((coefficient, "part"), _parts(source.waveform))
        variables[f"signal_{index}"] = (("pulse", "frequency", "part"), _parts(source.signal))
        if source.bounds is not None:
            variables[f"bounds_{index}"] = ((path_, "axis"), source.bounds)
    attributes: dict[str, Any] = {"kind": f"{KIND}: recovery"}
    attributes |= {"method": recovery.method, "residual": recovery.residual, "exact": int(recovery.exact)}
    attributes["certificate"] = "not looked for" if recovery.certificate is None else recovery.certificate.status
    attributes |= {"seconds": recovery.seconds, "notes": "; ".join(recovery.notes)}
    if recovery.sigma is not None:
        attributes["sigma"] = recovery.sigma
    coordinates = {"part": ["real", "imaginary"], "axis": list(AXES)}
    return _written(xarray.Dataset(variables, coordinates, attributes), path, overwrite)


def _parts(values: Complex) -> Real:
    return np.stack([values.real, values.imag], axis=-1)


def _joined(values: Real) -> Complex:
    return values[..., 0] + 1j * values[..., 1]
