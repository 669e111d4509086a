"""Phase transitions: how often recoveries succeed over sizes, separations and noise, in parallel and resumable."""

from __future__ import annotations

import itertools
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from tmca.dbd.model import Problem, beyond_freedom
from tmca.dbd.noise import true_bounds
from tmca.dbd.recovery import Recovery, Score
from tmca.dbd.simulation import BASES, MESSAGES, simulate
from tmca.dbd.solving import GRAMS, METHODS, solve
from tmca.errors import SettingError
from tmca.experiments.cells import Measured, Settings, Timed, run_cells, timed
from tmca.experiments.source import source_digest

SIZES = ("M", "P", "J", "L", "Q")
VARIABLES = (*SIZES, "separation", "snr_db", "antennas", "symbol_ratio", "lag", "late_samples", "accuracy", "weakest")
TOLD = ("known", "unknown", "zero")
"""What a solver is told of the noise's standard deviation."""
CHOICES: dict[str, tuple[Any, ...]] = {
    "messages": MESSAGES, "basis": BASES, "method": METHODS, "gram": GRAMS, "weights": ("plain", "balanced"),
    "early": (True, False), "sigma": TOLD,
}  # fmt: skip
DEFAULTS: Settings = {"M": 13, "P": 9, "J": 3, "L": 3, "Q": 3, "messages": "shared", "basis": "vandermonde"}
DEFAULTS |= {"method": "sfw"}
_TIGHT = 2e-5
"""By how much the dual's value may miss the truth's norm where the truth counts as its optimum, at accuracy 1e-6."""
_NEAR = 1e-3


@dataclass(frozen=True)
class Study:
    """What is varied and how often.

    Args:
        axes: name → values of each varied setting.
        fixed: of the others.
        draws: problems in every cell.
        certify: look for certificates as well.
        tolerance: largest torus error of a success; without it 1e-6, and with noise half of the
            finest resolution cell.
    """

    axes: Mapping[str, Sequence[Any]]
    fixed: Mapping[str, Any]
    draws: int = 20
    certify: bool = False
    tolerance: float | None = None

    def __post_init__(self) -> None:
        for name in (*self.axes, *self.fixed):
            if name not in (*VARIABLES, *CHOICES):
                known = ", ".join((*VARIABLES, *CHOICES))
                raise SettingError("vary", f"{name!r}", f"one of {known}", "")
            for value in self.axes.get(name, (self.fixed.get(name),)):
                _check_value(name, value)
        if self.draws < 1:
            raise SettingError("draws", f"{self.draws}", "1 or more")
        if self.tolerance is not None and not self.tolerance > 0:
            raise SettingError("tolerance", f"{self.tolerance}", "a positive number")

    def cells(self) -> list[Settings]:
        """Every draw of every combination."""
        combinations = itertools.product(*self.axes.values())
        made = [DEFAULTS | dict(self.fixed) | dict(zip(self.axes, values, strict=True)) for values in combinations]
        extra = {"certify": self.certify, "tolerance": self.tolerance, "source": source_digest(__name__)}
        return [
            one | extra | {"name": self._name(one, seed), "seed": seed} for one in made for seed in range(self.draws)
        ]

    def _name(self, cell: Settings, seed: int) -> str:
        """What progress calls a draw."""
        sizes = f"{cell['M']} x {cell['P']}, J = {cell['J']}, L = {cell['L']}, Q = {cell['Q']}"
        varied = "".join(f", {name} = {cell[name]}" for name in self.axes if name not in SIZES)
        return f"{sizes}{varied} · draw {seed + 1}"


def _check_value(name: str, value: Any) -> None:
    """Says before the work what no draw can be made of."""
    whole = ("M", "P", "J", "antennas", "late_samples")
    if name in CHOICES and value not in CHOICES[name]:
        raise SettingError(name, f"{value!r}", f"one of {', '.join(map(str, CHOICES[name]))}")
    if name in whole and not isinstance(value, int):
        raise SettingError(name, f"{value!r}", "a whole number")
    if name in ("L", "Q"):
        _number(value)
    if name in VARIABLES and name not in (*SIZES, "symbol_ratio") and not isinstance(value, int | float):
        raise SettingError(name, f"{value!r}", "a number")


def run_study(study: Study, work: str | Path, *, jobs: int = 1, progress: Timed | None = None) -> list[Measured]:
    """A row per combination: rates, errors and times; finished draws in ``work`` are not computed again."""
    return run_studies([study], work, jobs=jobs, progress=progress)[0]


def run_studies(
    studies: Sequence[Study], work: str | Path, *, jobs: int = 1, progress: Timed | None = None
) -> list[list[Measured]]:
    """The rows of several studies, computed as one piece of work."""
    cells = [study.cells() for study in studies]
    for study, ours in zip(studies, cells, strict=True):
        for cell in ours[:: study.draws]:
            _simulated(cell)  # says before the work what cannot be drawn
    found = iter(run_cells([cell for ours in cells for cell in ours], one_draw, work, jobs=jobs,
                           progress=timed(progress)))  # fmt: skip
    return [_rows(study, ours, [next(found) for _ in ours]) for study, ours in zip(studies, cells, strict=True)]


def _rows(study: Study, cells: Sequence[Settings], found: Sequence[Measured]) -> list[Measured]:
    starts = range(0, len(cells), study.draws)
    return [_row(study, cells[start], found[start : start + study.draws]) for start in starts]


def one_draw(cell: Settings) -> Measured:
    """Simulates and solves one problem, with one thread."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        return _measured(cell)


def _measured(cell: Settings) -> Measured:
    problem = _simulated(cell)
    began = time.process_time()
    recovery = _solved(problem, cell)
    measured: Measured = {"seconds": time.process_time() - began, "exact": recovery.exact}
    measured |= {"certified": recovery.certified, "silent": not recovery.found}
    score = recovery.score(problem, cell["tolerance"])
    measured |= {"success": score.success, "right_number": all(one.right_number for one in score.sources)}
    measured |= {"error": score.max_error if np.isfinite(score.max_error) else None}
    measured["correlation"] = min(one.waveform_correlation for one in score.sources)
    if problem.sigma and measured["right_number"]:
        measured |= _against_bounds(score, problem)
    if cell["method"] != "sfw" and not recovery.problem.sigma:
        measured |= _value_of_dual(recovery)
    return measured


def _solved(problem: Problem, cell: Settings) -> Recovery:
    named = ("gram", "weights", "early", "accuracy")
    options = {name: cell[name] for name in named if cell.get(name, "plain") != "plain"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what is beyond the degrees of freedom is drawn in the figure
        return solve(_told(problem, cell), cell["method"], certify=cell["certify"], **options)


def beyond(cell: Settings) -> bool:
    """Whether the lifted problem of a cell has more unknowns than samples."""
    problem = _simulated({"seed": 0, **DEFAULTS, **cell})
    assert problem.truth is not None
    return beyond_freedom(problem, [len(one.points) for one in problem.truth]) is not None


def _told(problem: Problem, cell: Settings) -> Problem:
    """The problem with what the solver is told of its noise."""
    told = cell.get("sigma", "known")
    return problem if told == "known" else replace(problem, sigma=None if told == "unknown" else 0.0)


def _simulated(cell: Settings) -> Problem:
    sizes: dict[str, Any] = {"M": int(cell["M"]), "P": int(cell["P"]), "J": int(cell["J"])}
    more: dict[str, Any] = {
        name: cell[name] for name in ("separation", "snr_db", "symbol_ratio", "lag") if name in cell
    }
    more |= {name: int(cell[name]) for name in ("antennas", "late_samples") if name in cell}
    if "weakest" in cell:
        more["amplitudes"] = (float(cell["weakest"]), 1.0)
    counts = {"targets": _number(cell["L"]), "paths": _number(cell["Q"])}
    return simulate(**sizes, **counts, messages=cell["messages"], basis=cell["basis"], seed=cell["seed"], **more)


def _number(value: Any) -> Any:
    """A number of paths, or one for each of several sources as ``2+3``."""
    parts = value.split("+") if isinstance(value, str) else [value]
    try:
        counts = [int(part) for part in parts]
    except ValueError:
        counts = []
    if not counts or (not isinstance(value, str) and value != counts[0]):
        raise SettingError("L or Q", f"{value!r}", "a whole number, or several such as 2+3")
    return counts if len(counts) > 1 else counts[0]


def _against_bounds(score: Score, problem: Problem) -> Measured:
    """Squared errors and squared Cramér–Rao bounds, summed over all coordinates, at the true parameters."""
    references = [one.reference for one in score.sources]
    errors = np.concatenate([error for one in score.sources for error in one.errors.values()])
    bounds = np.concatenate([bound.reshape(-1) for bound in true_bounds(problem, references)])
    return {"squared_error": float(np.sum(errors**2)), "squared_bound": float(np.sum(bounds**2))}


def _value_of_dual(recovery: Recovery) -> Measured:
    """The dual's value, and its share of the truth's sum of weighted atomic norms: one where the truth is optimal."""
    problem = recovery.problem
    assert problem.truth is not None
    pairs = zip(problem.sources, problem.truth, strict=True)
    norms = [one.weight * np.sum(np.abs(true.amplitudes)) * np.linalg.norm(true.waveform) for one, true in pairs]
    value = float(np.real(np.vdot(recovery.q, problem.y)))
    return {"value": value, "optimum": value / float(sum(norms))}


def _row(study: Study, cell: Settings, found: Sequence[Measured]) -> Measured:
    seconds = [one["seconds"] for one in found]
    row = {name: cell[name] for name in (*study.axes, *study.fixed)}
    row |= {"draws": len(found), "success": float(np.mean([one["success"] for one in found]))}
    row |= {"right_number": float(np.mean([one["right_number"] for one in found]))}
    row |= {"exact": float(np.mean([one["exact"] for one in found]))}
    if any(one["silent"] for one in found):
        row["silent"] = float(np.mean([one["silent"] for one in found]))
    if study.certify:
        row["certified"] = float(np.mean([one["certified"] is True for one in found]))
    if any("optimum" in one for one in found):
        row["optimum"] = float(np.mean([one["optimum"] > 1 - _TIGHT for one in found]))
        row["near"] = float(np.mean([one["optimum"] > 1 - _NEAR for one in found]))
        row["values"] = [one["value"] for one in found]
    counted = [one for one in found if "squared_error" in one]
    row |= _over_bound("rmse_over_bound", counted)
    row |= _over_bound("rmse_of_successes", [one for one in counted if one["success"]])
    row |= {"median_s": float(np.median(seconds)), "p90_s": float(np.quantile(seconds, 0.9)), "max_s": max(seconds)}
    return row


def _over_bound(name: str, found: Sequence[Measured]) -> Measured:
    """Root mean square of all errors over that of all bounds."""
    if not found:
        return {}
    ratio = sum(one["squared_error"] for one in found) / sum(one["squared_bound"] for one in found)
    return {name: float(np.sqrt(ratio))}


def plain_value(text: str) -> Any:
    """A number, a fraction such as 1/2, true or false where the text is one."""
    if text in ("true", "false"):
        return text == "true"
    for kind in (int, float, lambda one: float(Fraction(one))):
        try:
            return kind(text)
        except (ValueError, ZeroDivisionError):
            continue
    return text
