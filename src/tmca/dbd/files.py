"""Problems and recoveries on disk: labelled NetCDF, complex numbers as a last dimension ``part``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.data import write_dataset
from tmca.dbd.arrays import Complex, Real
from tmca.dbd.plain_files import read_plain
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
    return attributes | _unit_attributes(problem)


def _unit_attributes(problem: Problem) -> dict[str, float]:
    return {} if problem.units is None else {f"units_{name}": value for name, value in vars(problem.units).items()}


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
    the same signal in all pulses. With ``delay_s``, ``doppler_hz`` and ``carrier_hz`` (and ``spacing``), as in
    :class:`Units`, results are in metres and metres a second.

    Raises:
        DataError: the file is missing, broken, or lacks something.
        ShapeError, SettingError: arrays that do not fit each other.
    """
    path = Path(path)
    if not path.is_file():
        found = "a folder" if path.is_dir() else "no such file"
        raise DataError(path, found, "a NetCDF file of `tmca dbd simulate`, or an .npz with y and basis_…")
    if path.suffix == ".npz":
        return read_plain(path)
    dataset = _opened(path)
    try:
        return _from_dataset(dataset)
    except TmcaError as error:
        raise type(error)(f"{path}, {error.where}", error.found, error.expected, error.remedy) from error
    except (KeyError, ValueError, TypeError, IndexError) as error:
        expected = "samples y, and basis and message of every source, as `tmca dbd simulate` writes them"
        raise DataError(path, str(error).strip("\"'").splitlines()[0], expected) from error


def _opened(path: Path) -> xarray.Dataset:
    import xarray

    try:
        with xarray.open_dataset(path, engine="h5netcdf") as opened:
            dataset = opened.load()
    except (OSError, ValueError, KeyError) as error:
        raise DataError(path, "no NetCDF file", "one written by `tmca dbd simulate`") from error
    kind = dataset.attrs.get("kind")
    if kind != KIND:
        raise DataError(path, f"kind {kind!r}", f"{KIND!r}", "simulate one with `tmca dbd simulate`")
    return dataset


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


def save_recovery(recovery: Recovery, path: str | Path, *, overwrite: bool = False) -> Path:
    """Writes paths, gains, waveforms, bounds and the dual variable; returns the path."""
    import xarray

    variables: dict[str, Any] = {"q": (("antenna", "pulse", "frequency", "part"), _parts(recovery.q))}
    for index, source in enumerate(recovery.sources):
        path_, coefficient = f"path_{index}", f"coefficient_{index}"
        about = {"source": source.name, "weight": recovery.problem.sources[index].weight}
        about["relative_doppler"] = int(source.relative_doppler)
        variables[f"points_{index}"] = ((path_, "axis"), source.points, about)
        variables[f"amplitudes_{index}"] = ((path_, "part"), _parts(source.amplitudes), about)
        variables[f"waveform_{index}"] = ((coefficient, "part"), _parts(source.waveform), about)
        variables[f"signal_{index}"] = (("pulse", "frequency", "part"), _parts(source.signal), about)
        if source.bounds is not None:
            variables[f"bounds_{index}"] = ((path_, "axis"), source.bounds, about)
    attributes: dict[str, Any] = {"kind": f"{KIND}: recovery"}
    attributes |= {"method": recovery.method, "residual": recovery.residual, "exact": int(recovery.exact)}
    attributes["certificate"] = "not looked for" if recovery.certificate is None else recovery.certificate.status
    attributes |= {"seconds": recovery.seconds, "notes": "; ".join(recovery.notes)}
    if recovery.sigma is not None:
        attributes["sigma"] = recovery.sigma
    attributes |= _unit_attributes(recovery.problem)
    frequencies = recovery.problem.shape[2]
    coordinates = {"frequency": np.arange(frequencies) - frequencies // 2, "part": ["real", "imaginary"]}
    coordinates["axis"] = list(AXES)
    return _written(xarray.Dataset(variables, coordinates, attributes), path, overwrite)


def _parts(values: Complex) -> Real:
    return np.stack([values.real, values.imag], axis=-1)


def _joined(values: Real) -> Complex:
    return values[..., 0] + 1j * values[..., 1]
