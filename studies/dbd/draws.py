"""How often recoveries succeed over sizes, separations and noise: draws in parallel, resumable."""

from __future__ import annotations

import itertools
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, NotRequired, TypedDict, cast

import numpy as np

from studies.grid import Settings, Timed, run_cells, source
from tmca.data import held_folder
from tmca.dbd import (
    BASES,
    GRAMS,
    MESSAGES,
    METHODS,
    Problem,
    Recovery,
    Score,
    beyond_freedom,
    simulate,
    solve,
    true_bounds,
)
from tmca.errors import SettingError, check_choice

Value = int | float | str | bool
SIZES = ("M", "P", "J", "L", "Q")
_WHOLE = ("M", "P", "J", "antennas", "late_samples")
_NUMBERS = ("separation", "snr_db", "antennas", "lag", "late_samples", "accuracy", "weakest")
VARIABLES = (*SIZES, "separation", "snr_db", "antennas", "symbol_ratio", "lag", "late_samples", "accuracy", "weakest")
TOLD = ("known", "unknown", "zero")
"""What a solver is told of the noise's standard deviation."""
CHOICES: dict[str, tuple[Value, ...]] = {
    "messages": MESSAGES, "basis": BASES, "method": METHODS, "gram": GRAMS, "weights": ("plain", "balanced"),
    "early": (True, False), "sigma": TOLD,
}  # fmt: skip
_TIGHT, _NEAR = 2e-5, 1e-3
"""By how much the dual's value may miss the truth's norm where the truth counts as its optimum, at accuracy 1e-6, or
as near it."""


@dataclass(frozen=True)
class Draw:
    """One problem and how it is solved; what is None is left to `tmca.dbd.simulate` and `solve`.

    Args:
        M: frequencies.
        P: pulses.
        J: coefficients of a signal.
        L, Q: targets and paths; ``2+3`` for those of two sources.
        messages, basis, separation, snr_db, antennas, symbol_ratio, lag, late_samples: of `tmca.dbd.simulate`.
        method, gram, early, accuracy: of `tmca.dbd.solve`.
        weights: ``"plain"`` or ``"balanced"``.
        weakest: amplitude of the weakest path over the strongest.
        sigma: what the solver is told of the noise, one of ``TOLD``.
        certify: look for a certificate as well.
        tolerance: largest torus error of a success.
        seed: of the problem.
        name: that progress shows.
        source: digest of the source of the numbers.
    """

    M: int = 13
    P: int = 9
    J: int = 3
    L: int | str = 3
    Q: int | str = 3
    messages: str = "shared"
    basis: str = "vandermonde"
    method: str = "sfw"
    separation: float | None = None
    snr_db: float | None = None
    antennas: int | None = None
    symbol_ratio: float | None = None
    lag: float | None = None
    late_samples: int | None = None
    accuracy: float | None = None
    weakest: float | None = None
    gram: str | None = None
    weights: str = "plain"
    early: bool | None = None
    sigma: str = "known"
    certify: bool = False
    tolerance: float | None = None
    seed: int = 0
    name: str = ""
    source: str = ""

    def problem(self) -> Problem:
        """The problem that is drawn."""
        named = ("separation", "snr_db", "symbol_ratio", "lag", "antennas", "late_samples")
        given: dict[str, Any] = {name: getattr(self, name) for name in named if getattr(self, name) is not None}
        if self.weakest is not None:
            given["amplitudes"] = (self.weakest, 1.0)
        return simulate(
            M=self.M, P=self.P, J=self.J, targets=_counts(self.L), paths=_counts(self.Q), messages=self.messages,
            basis=self.basis, seed=self.seed, **given,
        )  # fmt: skip

    def solved(self, problem: Problem) -> Recovery:
        """The recovery, from what the solver is told."""
        given: dict[str, Any] = {name: getattr(self, name) for name in ("gram", "early", "accuracy")}
        given = {name: value for name, value in given.items() if value is not None}
        if self.weights != "plain":
            given["weights"] = self.weights
        if self.sigma != "known":
            problem = replace(problem, sigma=None if self.sigma == "unknown" else 0.0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what is beyond the degrees of freedom is drawn in the figure
            return solve(problem, self.method, certify=self.certify, **given)


DEFAULTS: dict[str, Value] = {one.name: one.default for one in fields(Draw)[:8]}  # type: ignore[misc]
"""Settings of a draw that always have a value."""


class Measured(TypedDict):
    """One draw: squared errors and bounds with noise, the value of the dual where it is solved without."""

    seconds: float
    exact: bool
    certified: bool | None
    silent: bool
    success: bool
    right_number: bool
    error: float | None
    correlation: float
    squared_error: NotRequired[float]
    squared_bound: NotRequired[float]
    value: NotRequired[float]
    optimum: NotRequired[float]


@dataclass(frozen=True, kw_only=True)
class Row:
    """All draws of one combination; None where a number is not measured.

    Args:
        settings: varied and fixed ones.
        draws: how many.
        success, right_number, exact, silent, certified: shares of the draws.
        optimum, near: shares of those whose truth is the dual's optimum, or near it.
        values: of the dual.
        rmse_over_bound, rmse_of_successes: over the Cramér–Rao bound, of all with the right numbers, and of successes.
        median_s, p90_s, max_s: processor seconds.
    """

    settings: Mapping[str, Value]
    draws: int
    success: float
    right_number: float
    exact: float
    silent: float | None = None
    certified: float | None = None
    optimum: float | None = None
    near: float | None = None
    values: tuple[float, ...] | None = None
    rmse_over_bound: float | None = None
    rmse_of_successes: float | None = None
    median_s: float
    p90_s: float
    max_s: float

    def plain(self) -> dict[str, Any]:
        """Settings and numbers side by side, as files hold them."""
        numbers = {name: value for name, value in vars(self).items() if name != "settings" and value is not None}
        return {**self.settings, **numbers}


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

    axes: Mapping[str, Sequence[Value]]
    fixed: Mapping[str, Value]
    draws: int = 20
    certify: bool = False
    tolerance: float | None = None

    def __post_init__(self) -> None:
        for name in (*self.axes, *self.fixed):
            check_choice("vary", name, (*VARIABLES, *CHOICES))
            for value in self.axes[name] if name in self.axes else [self.fixed[name]]:
                _check_value(name, value)
        if self.draws < 1:
            raise SettingError("draws", f"{self.draws}", "1 or more")
        if self.tolerance is not None and not self.tolerance > 0:
            raise SettingError("tolerance", f"{self.tolerance}", "a positive number")

    def cells(self) -> list[Draw]:
        """Every draw of every combination."""
        how: dict[str, Any] = {"certify": self.certify, "tolerance": self.tolerance}
        how["source"] = source("dbd/draws.py")
        made = [Draw(**{**self._settings(values), **how}) for values in self._combinations()]
        return [replace(one, name=self._name(one, seed), seed=seed) for one in made for seed in range(self.draws)]

    def _combinations(self) -> list[tuple[Value, ...]]:
        return list(itertools.product(*self.axes.values()))

    def _settings(self, values: Sequence[Value]) -> dict[str, Value]:
        varied = dict(zip(self.axes, values, strict=True))
        return varied | {name: value for name, value in self.fixed.items() if name not in varied}

    def _name(self, draw: Draw, seed: int) -> str:
        """What progress calls a draw."""
        sizes = f"{draw.M} x {draw.P}, J = {draw.J}, L = {draw.L}, Q = {draw.Q}"
        varied = "".join(f", {name} = {getattr(draw, name)}" for name in self.axes if name not in SIZES)
        return f"{sizes}{varied} · draw {seed + 1}"

    def rows(self, measured: Sequence[Measured]) -> list[Row]:
        """A row for every combination, of all draws in their order."""
        parts = [measured[start : start + self.draws] for start in range(0, len(measured), self.draws)]
        return [
            _row(self._settings(values), part, self.certify)
            for values, part in zip(self._combinations(), parts, strict=True)
        ]


def _check_value(name: str, value: Value) -> None:
    """Says before the work what no draw can be made of."""
    if name in CHOICES:
        check_choice(name, value, CHOICES[name])
    if name in _WHOLE and not isinstance(value, int):
        raise SettingError(name, f"{value!r}", "a whole number")
    if name in ("L", "Q"):
        _counts(value)
    if name in _NUMBERS and not isinstance(value, int | float):
        raise SettingError(name, f"{value!r}", "a number")


def _counts(value: Value) -> Any:
    """A number of paths, or one for each of several sources as ``2+3``."""
    parts = value.split("+") if isinstance(value, str) else [value]
    try:
        counts = [int(part) for part in parts]
    except ValueError:
        counts = []
    if not counts or (not isinstance(value, str) and value != counts[0]):
        raise SettingError("L or Q", f"{value!r}", "a whole number, or several such as 2+3")
    return counts if len(counts) > 1 else counts[0]


def run_study(study: Study, work: str | Path, *, jobs: int = 1, progress: Timed | None = None) -> list[Row]:
    """A row per combination: rates, errors and times; finished draws in ``work`` are not computed again."""
    return run_studies([study], work, jobs=jobs, progress=progress)[0]


def run_studies(
    studies: Sequence[Study], work: str | Path, *, jobs: int = 1, progress: Timed | None = None
) -> list[list[Row]]:
    """The rows of several studies, computed as one piece of work."""
    draws = [study.cells() for study in studies]
    for study, each in zip(studies, draws, strict=True):
        for draw in each[:: study.draws]:
            draw.problem()  # says before the work what cannot be drawn
    cells = [asdict(draw) for each in draws for draw in each]
    with held_folder(work):
        measured = iter(run_cells(cells, one_draw, work, jobs=jobs, progress=progress))
    return [
        study.rows([cast(Measured, next(measured)) for _ in each]) for study, each in zip(studies, draws, strict=True)
    ]


def one_draw(settings: Settings) -> dict[str, Any]:
    """Simulates and solves one problem, with one thread."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        return dict(_measured(Draw(**settings)))


def _measured(draw: Draw) -> Measured:
    problem = draw.problem()
    began = time.process_time()
    recovery = draw.solved(problem)
    seconds, score = time.process_time() - began, recovery.score(problem, draw.tolerance)
    measured: Measured = {
        "seconds": seconds, "exact": recovery.exact, "certified": recovery.certified,
        "silent": not any(map(len, recovery)), "success": score.success,
        "right_number": all(one.right_number for one in score.sources),
        "error": score.max_error if np.isfinite(score.max_error) else None,
        "correlation": min(one.waveform_correlation for one in score.sources),
    }  # fmt: skip
    if problem.sigma and measured["right_number"]:
        measured["squared_error"], measured["squared_bound"] = _against_bounds(score, problem)
    if draw.method != "sfw" and not recovery.problem.sigma:
        measured["value"], measured["optimum"] = _value_of_dual(recovery)
    return measured


def beyond(settings: Mapping[str, Value]) -> bool:
    """Whether the lifted problem of a draw has more unknowns than samples."""
    given: dict[str, Any] = dict(settings)
    problem = Draw(**given).problem()
    assert problem.truth is not None
    return beyond_freedom(problem, [len(one.points) for one in problem.truth]) is not None


def _against_bounds(score: Score, problem: Problem) -> tuple[float, float]:
    """Squared errors and squared Cramér–Rao bounds, summed over all coordinates, at the true parameters."""
    references = [one.reference for one in score.sources]
    errors = np.concatenate([error for one in score.sources for error in one.errors.values()])
    bounds = np.concatenate([bound.reshape(-1) for bound in true_bounds(problem, references)])
    return float(np.sum(errors**2)), float(np.sum(bounds**2))


def _value_of_dual(recovery: Recovery) -> tuple[float, float]:
    """The dual's value, and its share of the truth's sum of weighted atomic norms: one where the truth is optimal."""
    problem = recovery.problem
    assert problem.truth is not None
    pairs = zip(problem.sources, problem.truth, strict=True)
    norms = [one.weight * np.sum(np.abs(true.amplitudes)) * np.linalg.norm(true.waveform) for one, true in pairs]
    value = float(np.real(np.vdot(recovery.q, problem.y)))
    return value, value / float(sum(norms))


def _row(settings: Mapping[str, Value], draws: Sequence[Measured], certify: bool) -> Row:
    seconds = [draw["seconds"] for draw in draws]
    silent, optima = [draw["silent"] for draw in draws], [draw["optimum"] for draw in draws if "optimum" in draw]
    with_bounds = [draw for draw in draws if "squared_error" in draw]
    return Row(
        settings=settings, draws=len(draws), success=_share([draw["success"] for draw in draws]),
        right_number=_share([draw["right_number"] for draw in draws]),
        exact=_share([draw["exact"] for draw in draws]),
        silent=_share(silent) if any(silent) else None,
        certified=_share([draw["certified"] is True for draw in draws]) if certify else None,
        optimum=_share([one > 1 - _TIGHT for one in optima]) if optima else None,
        near=_share([one > 1 - _NEAR for one in optima]) if optima else None,
        values=tuple(draw["value"] for draw in draws) if optima else None,
        rmse_over_bound=_over_bound(with_bounds),
        rmse_of_successes=_over_bound([draw for draw in with_bounds if draw["success"]]),
        median_s=float(np.median(seconds)), p90_s=float(np.quantile(seconds, 0.9)), max_s=max(seconds),
    )  # fmt: skip


def _share(draws: Sequence[bool]) -> float:
    return float(np.mean(draws))


def _over_bound(draws: Sequence[Measured]) -> float | None:
    """Root mean square of all errors over that of all bounds."""
    if not draws:
        return None
    ratio = sum(draw["squared_error"] for draw in draws) / sum(draw["squared_bound"] for draw in draws)
    return float(np.sqrt(ratio))


def plain_value(text: str) -> Value:
    """A number, a fraction such as 1/2, true or false where the text is one."""
    if text in ("true", "false"):
        return text == "true"
    for kind in (int, float, lambda one: float(Fraction(one))):
        try:
            number: int | float = kind(text)
        except (ValueError, ZeroDivisionError):
            continue
        return number
    return text
