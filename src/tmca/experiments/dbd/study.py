"""Phase transitions: how often recoveries succeed over sizes, separations and noise, in parallel and resumable."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tmca.errors import SettingError
from tmca.experiments.cells import Measured, Settings, Timed, run_cells, timed
from tmca.experiments.source import source_digest

SIZES = ("M", "P", "J", "L", "Q")
VARIABLES = (*SIZES, "separation", "snr_db", "antennas", "symbol_ratio", "lag", "late_samples")
CHOICES = ("messages", "basis", "method", "gram", "weights", "early")
DEFAULTS: Settings = {"M": 13, "P": 9, "J": 3, "L": 3, "Q": 3, "messages": "shared", "basis": "vandermonde"}
DEFAULTS |= {"method": "sfw"}
_TIGHT = 1e-3
"""By how much the dual's value may miss the truth's norm where the truth counts as its optimum."""


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
            if name not in VARIABLES + CHOICES:
                known = ", ".join(VARIABLES + CHOICES)
                raise SettingError("vary", f"{name!r}", f"one of {known}", "")
        if self.draws < 1:
            raise SettingError("draws", f"{self.draws}", "1 or more")

    def cells(self) -> list[Settings]:
        """Every draw of every combination."""
        combinations = itertools.product(*self.axes.values())
        made = [DEFAULTS | dict(self.fixed) | dict(zip(self.axes, values, strict=True)) for values in combinations]
        extra = {"certify": self.certify, "tolerance": self.tolerance, "source": source_digest(__name__)}
        return [one | extra | {"seed": seed} for one in made for seed in range(self.draws)]


def run_study(study: Study, work: str | Path, *, jobs: int = 1, progress: Timed | None = None) -> list[Measured]:
    """A row per combination: rates, errors and times; finished draws in ``work`` are not computed again."""
    cells = study.cells()
    for cell in cells[:: study.draws]:
        _simulated(cell)  # says before the work what cannot be drawn
    found = run_cells(cells, one_draw, work, jobs=jobs, progress=timed(progress))
    return [
        _row(study, cells[start], found[start : start + study.draws]) for start in range(0, len(cells), study.draws)
    ]


def one_draw(cell: Settings) -> Measured:
    """Simulates and solves one problem, with one thread."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        return _measured(cell)


def _measured(cell: Settings) -> Measured:
    import time
    import warnings

    from tmca.dbd import solve

    problem = _simulated(cell)
    options = {name: cell[name] for name in ("gram", "weights", "early") if cell.get(name, "plain") != "plain"}
    began = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what is beyond the degrees of freedom is drawn in the figure
        recovery = solve(problem, cell["method"], certify=cell["certify"], **options)
    seconds = time.process_time() - began
    tolerance = cell["tolerance"] or (1e-6 if not problem.sigma else 0.5 / max(cell["M"], cell["P"]))
    score = recovery.score(tolerance=tolerance)
    measured: Measured = {"success": score.success, "exact": recovery.exact, "seconds": seconds}
    measured |= {"right_number": all(one.right_number for one in score.sources), "certified": recovery.certified}
    measured |= {"error": score.max_error if np.isfinite(score.max_error) else None}
    if problem.sigma and measured["right_number"]:
        measured |= _against_bounds(score, problem)
    if cell["method"] != "sfw" and not problem.sigma:
        measured["optimum"] = _share_of_optimum(recovery)
    measured["correlation"] = min(one.waveform_correlation for one in score.sources)
    return measured


def _simulated(cell: Settings) -> Any:
    from tmca.dbd import simulate

    sizes: dict[str, Any] = {"M": int(cell["M"]), "P": int(cell["P"]), "J": int(cell["J"])}
    more: dict[str, Any] = {
        name: cell[name] for name in ("separation", "snr_db", "symbol_ratio", "lag") if name in cell
    }
    more |= {name: int(cell[name]) for name in ("antennas", "late_samples") if name in cell}
    counts = {"targets": _number(cell["L"]), "paths": _number(cell["Q"])}
    return simulate(**sizes, **counts, messages=cell["messages"], basis=cell["basis"], seed=cell["seed"], **more)


def _number(value: Any) -> Any:
    """A number of paths, or one for each of several sources as ``2+3``."""
    return [int(one) for one in value.split("+")] if isinstance(value, str) else int(value)


def _against_bounds(score: Any, problem: Any) -> Measured:
    """Squared errors and squared Cramér–Rao bounds, summed over all coordinates, at the true parameters."""
    from tmca.dbd.estimates.true_bounds import true_bounds

    references = [one.reference for one in score.sources]
    errors = np.concatenate([error for one in score.sources for error in one.errors.values()])
    bounds = np.concatenate([bound.reshape(-1) for bound in true_bounds(problem, references)])
    return {"squared_error": float(np.sum(errors**2)), "squared_bound": float(np.sum(bounds**2))}


def _share_of_optimum(recovery: Any) -> float:
    """The dual's value over the truth's sum of weighted atomic norms: one where the truth is the optimum."""
    problem = recovery.problem
    pairs = zip(problem.sources, problem.truth, strict=True)
    norms = [one.weight * np.sum(np.abs(true.amplitudes)) * np.linalg.norm(true.waveform) for one, true in pairs]
    return float(np.real(np.vdot(recovery.q, problem.y)) / sum(norms))


def _row(study: Study, cell: Settings, found: Sequence[Measured]) -> Measured:
    seconds = [one["seconds"] for one in found]
    row = {name: cell[name] for name in (*study.axes, *study.fixed)}
    row |= {"draws": len(found), "success": float(np.mean([one["success"] for one in found]))}
    row |= {"right_number": float(np.mean([one["right_number"] for one in found]))}
    row |= {"exact": float(np.mean([one["exact"] for one in found]))}
    if study.certify:
        row["certified"] = float(np.mean([one["certified"] is True for one in found]))
    if any("optimum" in one for one in found):
        row["optimum"] = float(np.mean([one["optimum"] > 1 - _TIGHT for one in found]))
    bounded = [one for one in found if one["success"] and "squared_error" in one]
    if bounded:
        ratio = sum(one["squared_error"] for one in bounded) / sum(one["squared_bound"] for one in bounded)
        row["rmse_over_bound"] = float(np.sqrt(ratio))
    row |= {"median_s": float(np.median(seconds)), "p90_s": float(np.quantile(seconds, 0.9)), "max_s": max(seconds)}
    return row


def plain_value(text: str) -> Any:
    """A number where the text is one."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text
