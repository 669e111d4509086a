"""On disk: problems and recoveries as labelled NetCDF, samples of one's own as ``.npz``, scenarios as YAML.

Complex numbers in NetCDF have a last dimension ``part``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile

import numpy as np

from tmca.data import write_dataset
from tmca.dbd import scenario
from tmca.dbd.coordinates import AXES, Complex, Real, Units
from tmca.dbd.messages import carriers
from tmca.dbd.model import Problem, Source, Truth
from tmca.dbd.recovery import Recovery
from tmca.errors import DataError, TmcaError

if TYPE_CHECKING:
    import xarray

KIND = "dual blind deconvolution"
_NPZ = ("y", "sigma", "delay_s", "doppler_hz", "carrier_hz", "spacing")
_SCENARIOS = Path(__file__).parent / "scenarios"
_WHOLE = ("pulses", "subspace", "antennas", "seed")


def save_problem(problem: Problem, path: str | Path, *, overwrite: bool = False) -> Path:
    """Writes samples, bases and, where known, truth and units; returns the path.

    Raises:
        OutputError: the file exists or cannot be written.
    """
    variables: dict[str, Any] = {"y": (("antenna", "pulse", "frequency", "part"), _parts(problem.y))}
    for index, source in enumerate(problem.sources):
        dimensions = ("pulse", "frequency", f"column_{index}", "part")
        about = {"source": source.name, "weight": source.weight}
        variables[f"basis_{index}"] = (dimensions, _parts(source.rows), about)
        variables[f"message_{index}"] = ("pulse", source.message)
        if problem.truth is not None:
            variables |= _truth_variables(index, problem.truth[index])
    return _written(variables, {"kind": KIND}, problem, problem.sigma, path, overwrite)


def _written(
    variables: dict[str, Any], about: dict[str, Any], problem: Problem, sigma: float | None, path: str | Path,
    overwrite: bool,
) -> Path:  # fmt: skip
    """Writes a file with the coordinates of all variables, the noise where it is known, and the units."""
    import xarray

    attributes = about | ({} if sigma is None else {"sigma": sigma})
    if problem.units is not None:
        attributes |= {f"units_{name}": value for name, value in asdict(problem.units).items()}
    coordinates = {"frequency": carriers(problem.shape[2]), "part": ["real", "imaginary"], "axis": list(AXES)}
    write_dataset(xarray.Dataset(variables, coordinates, attributes), path, overwrite=overwrite)
    return Path(path)


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
        there = "a folder" if path.is_dir() else "no such file"
        raise DataError(path, there, "a NetCDF file of `tmca dbd simulate`, or an .npz with y and basis_…")
    if path.suffix == ".npz":
        return _read_plain(path)
    dataset = _opened(path)
    try:
        with _naming(path):
            return _from_dataset(dataset)
    except TmcaError:
        raise
    except (KeyError, ValueError, TypeError, IndexError) as error:
        expected = "samples y, and basis and message of every source, as `tmca dbd simulate` writes them"
        raise DataError(path, str(error).strip("\"'").splitlines()[0], expected) from error


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Errors of what a file describes name the file too."""
    try:
        yield
    except TmcaError as error:
        raise type(error)(f"{path}, {error.where}", error.found, error.expected, error.remedy) from error


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
        name, weight = str(basis.attrs["source"]), float(basis.attrs["weight"])
        sources.append(Source(name, _joined(basis.values), dataset[f"message_{index}"].values, weight))
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
    return _written(variables, attributes, recovery.problem, recovery.sigma, path, overwrite)


def _parts(values: Complex) -> Real:
    return np.stack([values.real, values.imag], axis=-1)


def _joined(values: Real) -> Complex:
    return values[..., 0] + 1j * values[..., 1]


def _read_plain(path: Path) -> Problem:
    """Reads ``y``, ``basis_NAME`` and what else :func:`load_problem` tells of."""
    try:
        with np.load(path) as opened:
            arrays = dict(opened)
    except (OSError, ValueError, EOFError, TypeError, BadZipFile) as error:
        raise DataError(path, "no .npz of plain arrays", "np.savez(path, y=…, basis_radar=…, …)") from error
    names = [name.removeprefix("basis_") for name in arrays if name.startswith("basis_")]
    if "y" not in arrays or not names:
        raise DataError(path, ", ".join(arrays) or "nothing", "y and one basis_NAME or more")
    unknown = [name for name in arrays if name not in _NPZ and name.split("_", 1)[-1] not in names]
    if unknown:
        raise DataError(
            path, ", ".join(unknown), f"{', '.join(_NPZ)}, and basis_, message_ and weight_NAME of a source"
        )
    with _naming(path):
        y = _numbers(arrays, "y")
        sources = [_npz_source(name, arrays, y) for name in names]
        sigma = _single(arrays, "sigma") if "sigma" in arrays else None
        return Problem(y, tuple(sources), sigma, units=_npz_units(arrays))


def _npz_source(name: str, arrays: dict[str, Any], y: Any) -> Source:
    rows = _numbers(arrays, f"basis_{name}")
    if y.ndim < 2 and rows.ndim < 3:
        raise DataError("y", f"{y.ndim} dimension", "(P, M) or (A, P, M), or bases of (P, M, J)")
    pulses = len(rows) if rows.ndim == 3 else y.shape[-2]
    plain = np.arange(pulses) if rows.ndim == 3 else np.zeros(pulses, np.int64)
    message = _numbers(arrays, f"message_{name}") if f"message_{name}" in arrays else plain
    weight = {"weight": _single(arrays, f"weight_{name}")} if f"weight_{name}" in arrays else {}
    return Source(name, rows, message, **weight)


def _npz_units(arrays: dict[str, Any]) -> Units | None:
    """Physical scales, all of them or none; half a wavelength between antennas unless ``spacing`` says otherwise."""
    needed = ("delay_s", "doppler_hz", "carrier_hz")
    there = [name for name in needed if name in arrays]
    if not there:
        return None
    if len(there) < len(needed):
        raise DataError("units", ", ".join(there), f"{', '.join(needed)}, or none of them")
    return Units(*(_single(arrays, name) for name in (*needed, *(["spacing"] if "spacing" in arrays else []))))


def _single(arrays: Mapping[str, Any], name: str) -> float:
    value = np.asarray(arrays[name])
    if value.size != 1 or value.dtype.kind not in "iuf":
        raise DataError(name, f"{value.dtype} of shape {value.shape}", "one number")
    return float(value.reshape(()))


def _numbers(arrays: Mapping[str, Any], name: str) -> Any:
    """A numerical array of a file."""
    value = np.asarray(arrays[name])
    if value.dtype.kind not in "iufc":
        raise DataError(name, f"{value.dtype}", "numbers")
    return value


def scenario_names() -> list[str]:
    """Scenarios that come with the package."""
    return sorted(file.stem for file in _SCENARIOS.glob("*.yaml"))


def read_scenario(source: str | Path) -> scenario.Scenario:
    """A scenario by its name, or from a YAML file of its arguments with lists of targets and paths.

    Raises:
        DataError: no such file or name, or a file that is no such description.
        SettingError: values that make no scenario.
    """
    import yaml

    named = _SCENARIOS / f"{source}.yaml"
    file = named if named.is_file() else Path(source)
    if not file.is_file():
        raise DataError(source, "no such file", f"a YAML file, or one of {', '.join(scenario_names())}")
    try:
        described = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise DataError(file, f"no YAML ({str(error).splitlines()[0]})", "a description of a scenario") from error
    return _scenario(file, described)


def _scenario(file: Path, described: Any) -> scenario.Scenario:
    if not isinstance(described, dict):
        raise DataError(file, f"{type(described).__name__}", "names and values, such as bandwidth_hz: 10e6")
    channels = {name: described.pop(name, None) or [] for name in ("targets", "paths")}
    for name, listed in channels.items():
        if not isinstance(listed, list):
            raise DataError(file, f"{name}: {listed!r}", f"a list of {name}, each on its own")
    for name, kind in (("targets", scenario.Target), ("paths", scenario.Path)):
        singular = name.removesuffix("s")
        listed = enumerate(channels[name])
        channels[name] = [_checked(file, f"{singular} {index + 1}", one, kind) for index, one in listed]
    made: scenario.Scenario = _checked(file, "the scenario", channels | described, scenario.Scenario)
    return made


def _checked(file: Path, what: str, values: Any, kind: type) -> Any:
    """An object of a dataclass from described values; numbers written as text (``10e6`` in YAML 1.1) are numbers."""
    named = {one.name: one for one in fields(kind)}
    needed = [name for name, one in named.items() if one.default is MISSING]
    if not isinstance(values, dict) or set(values) - set(named) or set(needed) - set(values):
        there = ", ".join(map(str, values)) if isinstance(values, dict) else repr(values)
        raise DataError(file, f"{what} of {there}", f"{', '.join(needed)}, and maybe others of {', '.join(named)}")
    numbers = {name: _value(name, value) for name, value in values.items()}
    for name, value in numbers.items():
        if value is None and not (values[name] is None and named[name].default is None):
            raise DataError(file, f"{name} {values[name]!r} of {what}", "a number")
    with _naming(file):
        return kind(**numbers)


def _value(name: str, value: Any) -> Any:
    """A value as the dataclasses want it: whole numbers, complex gains, text of numbers; None where it is no number."""
    if name in ("targets", "paths", "messages"):
        return value
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        if name == "gain":
            return complex(str(value).replace(" ", ""))
        number = float(value)
        return int(number) if name in _WHOLE and number == int(number) else number
    except (ValueError, OverflowError):
        return None
