"""``tmca dbd``: radar targets and radio paths from one overlaid signal."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter

from tmca.cli.options.numbers import MaybeWhole, On, Whole, numbers
from tmca.cli.options.output import Json, Markdown, Overwrite, check_figure, check_targets, say
from tmca.cli.progress import cell_done
from tmca.errors import SettingError
from tmca.progress import progress_bar

if TYPE_CHECKING:
    from tmca.dbd import Problem, Recovery

app = App(name="dbd", help="Dual blind deconvolution: radar targets and radio paths from one overlaid signal.")


@app.command
def simulate(
    *,
    out: Path = Path("overlaid.nc"),
    scenario: str | None = None,
    frequencies: Annotated[Whole, Parameter(name=("--frequencies", "-M"))] = 13,
    pulses: Annotated[Whole, Parameter(name=("--pulses", "-P"))] = 9,
    subspace: Annotated[Whole, Parameter(name=("--subspace", "-J"))] = 3,
    targets: str = "3",
    paths: str = "3",
    messages: str = "shared",
    basis: str = "vandermonde",
    seed: MaybeWhole = None,
    snr: float | None = None,
    antennas: Whole = 1,
    symbol_ratio: str = "1",
    lag: float = 0.0,
    late_samples: Whole = 0,
    separation: str | None = None,
    known_waveforms: bool = False,
    known: str | None = None,
    model_only: bool = False,
    waveform: list[str] | None = None,
    overwrite: Overwrite = False,
) -> None:
    """Write overlaid samples of a radar and a communications transmitter, with the bases and the truth.

    Either of the normalised model, by the numbers below, or of a physical scene with --scenario.

    Args:
        out: NetCDF file to write.
        scenario: YAML file of a physical scene, or the name of one that comes with the package: road.
        frequencies: M.
        pulses: P.
        subspace: J, dimension of the subspace of each signal.
        targets: of the radar; 2+3 for two radars; 0 for none.
        paths: of the communications channel; likewise.
        messages: shared, block or dense.
        basis: vandermonde, gaussian, dft or sign.
        seed: of everything random, 0 without; in place of a scenario's too.
        snr: decibels; no noise without; in place of a scenario's too.
        antennas: of the receiver.
        symbol_ratio: duration of a message in pulse intervals, such as 3 or 1/2.
        lag: of the communications clock, in units of a normalised delay, known to the receiver.
        late_samples: lag beyond the cyclic prefix, in samples.
        separation: of two points in at least one coordinate: one number, or DELAY,DOPPLER[,ANGLE].
        known_waveforms: every signal is known up to a factor.
        known: whose signal is known up to a factor: radar, communications or both; the other's stays unknown.
            A known channel with an unknown message has no solver here.
        model_only: of a scenario: samples of the model instead of a simulation in the time domain.
        waveform: of a scenario with --model-only: what a source sends, as in `tmca dbd solve`; may be repeated.
    """
    from tmca.data import check_target
    from tmca.dbd.files import save_problem

    _check_scenario_alone(dict(locals()))
    check_target(out, overwrite)
    if scenario is not None:
        problem = _physical(scenario, model_only, seed, snr, waveform or ())
    else:
        from tmca.dbd import simulate as simulated

        counts = _counts(targets, "--targets"), _counts(paths, "--paths")
        problem = simulated(
            frequencies, pulses, subspace, *counts, messages, seed or 0, snr,
            basis=basis, antennas=antennas, symbol_ratio=_ratio(symbol_ratio), lag=lag, late_samples=late_samples,
            separation=None if separation is None else numbers(separation, "--separation"),
            known_waveforms=known_waveforms, known=known,
        )  # fmt: skip
    save_problem(problem, out, overwrite=overwrite)
    _tell(problem, out)


@app.command
def solve(
    file: Path,
    /,
    *,
    out: Path | None = None,
    method: str = "sfw",
    gram: str = "separate",
    solver: str = "CLARABEL",
    accuracy: float = 1e-5,
    weights: str | None = None,
    sigma: float | None = None,
    unknown_noise: bool = False,
    certify: On = True,
    figure: Path | None = None,
    axes: str = "auto",
    csv: Path | None = None,
    waveform: list[str] | None = None,
    overwrite: Overwrite = False,
    json: Json = False,
    markdown: Markdown = False,
) -> None:
    """Find the targets, the paths and both signals in FILE.

    FILE is what `tmca dbd simulate` wrote, or an .npz of your own: y (pulses x frequencies), basis_radar and
    basis_communications (frequencies x subspace, or pulses x frequencies x subspace for messages of their own in every
    pulse), and sigma where the noise is known.

    Args:
        file: samples and bases.
        out: NetCDF file of the recovery; the name of FILE with .recovery.nc without it.
        method: sfw, sdp or cvxpy.
        gram: separate or shared (thesis equation 81), for sdp and cvxpy.
        solver: of cvxpy: CLARABEL for small sizes, SCS.
        accuracy: relative residual at which sdp ends.
        weights: of the sources: balanced, or a number for each.
        sigma: standard deviation of the noise, in place of the file's.
        unknown_noise: estimate the noise, whatever the file says.
        certify: look for a dual certificate of a noiseless recovery.
        figure: picture of the delay-Doppler planes (PNG, SVG, or PDF of the width of a column of a paper); the name
            of the recovery with .png without it.
        axes: of the picture: range (m and m/s), time (µs and kHz), normalised, or auto, the first that the file allows.
        waveform: basis of a source from a waveform in time, instead of the file's; may be repeated.
            NAME=KIND:SETTING=VALUE,… such as radar=chirp:bandwidth=8e6,duration=1e-6 or
            communications=ofdm:subcarriers=13,unknowns=3 or radar=samples:file=pulse.sigmf-meta;
            or a YAML file of such. FILE has to have delay_s and doppler_hz.
        csv: table of targets and paths with standard deviations, comma-separated.
    """
    from tmca.dbd import solve as solved
    from tmca.dbd.planes import check_axes
    from tmca.dbd.tables import recovery_lines, recovery_values

    problem, taken = _problem(file, waveform or ())
    out = out or file.with_suffix(".recovery.nc")
    figure = figure or out.with_suffix(".png")
    check_figure(figure, overwrite, file)
    check_targets([out, *([csv] if csv else [])], overwrite, file)
    check_axes(axes, problem.units)
    problem = _with_noise(problem, sigma, unknown_noise)
    shares: Any = weights if weights in (None, "balanced") else numbers(str(weights), "--weights")
    with progress_bar(f"solve {file.name}") as progress:
        recovery = solved(
            problem, method, certify=certify, gram=gram, weights=shares, solver=solver, accuracy=accuracy,
            progress=progress,
        )  # fmt: skip
    written = _write(recovery, out, figure, axes, csv, overwrite)
    lines = (*taken, *recovery_lines(recovery, markdown, str(out)), written)
    say(recovery_values(recovery), json, *lines, markdown=markdown)


def _problem(file: Path, waveforms: Sequence[str]) -> tuple[Problem, list[str]]:
    """Samples and bases of a file, waveforms in place of its bases, and what samples of these were taken as."""
    from tmca.dbd import load_problem, read_waveforms

    given = {name: one for text in waveforms for name, one in read_waveforms(text).items()}
    return load_problem(file, given), _taken(given)


def _with_noise(problem: Problem, sigma: float | None, unknown: bool) -> Problem:
    """The problem with this noise, or an unknown one, in place of the file's, where either is asked for."""
    from dataclasses import replace

    if sigma is not None and unknown:
        raise SettingError("--sigma", "--unknown-noise as well", "one of them")
    return problem if sigma is None and not unknown else replace(problem, sigma=sigma)


def _write(recovery: Recovery, out: Path, figure: Path, axes: str, csv: Path | None, overwrite: bool) -> str:
    """Write a recovery, its picture and its table, and say where."""
    from tmca.data import write_text
    from tmca.dbd.files import save_recovery
    from tmca.dbd.paths import path_csv
    from tmca.dbd.planes import planes
    from tmca.plots import save_figure
    from tmca.plots.dbd import Plane, planes_figure

    save_recovery(recovery, out, overwrite=overwrite)
    line = f"{recovery.unexplained:.2%} of the samples' energy is unexplained"
    if recovery.doubt:
        line = f"in doubt: {recovery.doubt} ({line})"
    drawn = planes_figure([Plane(**plane) for plane in planes(recovery, axes)], line, figure.suffix.lower() == ".pdf")
    save_figure(drawn, figure, overwrite=overwrite)
    if csv:
        write_text(path_csv(recovery), csv, overwrite=overwrite)
    return f"wrote {', '.join(str(one) for one in (out, csv) if one)} and {figure}"


@app.command
def study(
    *,
    vary: list[str],
    set_: Annotated[list[str] | None, Parameter(name="--set")] = None,
    out: Path = Path("dbd-study"),
    work: Path = Path("runs/dbd-study"),
    draws: Whole = 20,
    jobs: Whole = 1,
    certify: bool = False,
    tolerance: float | None = None,
    overwrite: Overwrite = False,
    json: Json = False,
    markdown: Markdown = False,
) -> None:
    """Phase transitions: how often recoveries succeed, `--vary L=1,2,3,4 --vary J=1,2,3`.

    Writes OUT.md, OUT.json, OUT.csv and OUT.png. Finished draws are kept in --work: a study that was stopped goes on.

    Args:
        vary: NAME=VALUE,VALUE,… given several times; NAME: M, P, J, L, Q, separation, snr_db, antennas, symbol_ratio,
            lag, late_samples, accuracy, weakest, messages, basis, method, gram, weights (plain, balanced), early,
            sigma (known, unknown, zero: what the solver is told); L and Q take 2+3 for two.
        set_: NAME=VALUE of the same names for all draws.
        out: results, without a suffix.
        work: folder of finished draws.
        draws: problems for every combination.
        jobs: processes side by side.
        certify: look for dual certificates as well.
        tolerance: largest error of a success; without noise 1e-6, with noise half of the finest resolution cell.
    """
    from tmca.cli.studies import study_module
    from tmca.cli.sweep import named_values

    draw, tables = study_module("dbd.draws"), study_module("dbd.tables")
    tables.check_results(out, overwrite)
    named, settled = named_values(vary, "--vary"), named_values(set_ or (), "--set")
    axes = {name: [draw.plain_value(one) for one in values] for name, values in named.items()}
    fixed = {name: draw.plain_value(values[0]) for name, values in settled.items()}
    asked = draw.Study(axes, fixed, draws, certify, tolerance)
    rows = draw.run_study(asked, work, jobs=jobs, progress=cell_done)
    tables.save_results(asked, rows, out, ["tmca", *sys.argv[1:]], overwrite=overwrite)
    say([row.plain() for row in rows], json, tables.study_table(asked, rows), markdown=markdown)


@app.command
def report(
    *,
    out: Path = Path("dbd"),
    work: Path = Path("runs/dbd-report"),
    draws: MaybeWhole = None,
    jobs: Whole = 1,
    overwrite: Overwrite = False,
) -> None:
    """The results page of this package: fixed instances, limits, noise, extensions, phase transitions, cost.

    Writes OUT.md, OUT.json and pictures. Finished draws are kept in --work: a report that was stopped goes on.

    Args:
        out: results, without a suffix.
        work: folder of finished draws.
        draws: fewer problems than the page has, for a quick look.
        jobs: processes side by side.
    """
    from tmca.cli.studies import study_module

    page, command = study_module("dbd.report"), ["tmca", *sys.argv[1:]]
    check_targets(page.page_files(out), overwrite)
    page.write_report(out, work, command, jobs=jobs, progress=cell_done, overwrite=overwrite, draws=draws)
    print(f"wrote {out}.md")


def _check_scenario_alone(given: dict[str, Any]) -> None:
    """Options of the normalised model do nothing to a scenario, and the other way round."""
    if given["scenario"] is None:
        if given["model_only"]:
            raise SettingError("--model-only", "no --scenario", "one", "the numbers below make samples of the model")
        if given["waveform"]:
            raise SettingError("--waveform", "no --scenario", "one, whose units say how long a waveform is")
        return
    defaults = {name: one.default for name, one in inspect.signature(simulate).parameters.items()}
    both = ("scenario", "out", "seed", "snr", "model_only", "waveform", "overwrite")
    changed = [name for name, value in defaults.items() if name not in both and given[name] != value]
    if changed:
        options = ", ".join("--" + name.replace("_", "-") for name in changed)
        raise SettingError("--scenario", f"{options} as well", "--seed and --snr only", "change the scenario's file")


def _physical(name: str, model_only: bool, seed: int | None, snr: float | None, waveforms: Sequence[str]) -> Problem:
    from dataclasses import replace

    from tmca.dbd import read_scenario, read_waveforms

    given: dict[str, Any] = {"seed": seed, "snr_db": snr}
    scenario = replace(read_scenario(name), **{key: value for key, value in given.items() if value is not None})
    if waveforms and not model_only:
        raise SettingError("--waveform", "no --model-only", "it", "in the time domain a scenario sends its own codes")
    scene = scenario.draw()
    for one in map(read_waveforms, waveforms):
        scene = scene.with_waveforms(one)
        for line in _taken(one):
            print(line)
    if model_only:
        return scene.problem()
    print(f"what turns within an interval and the model leaves out: {scene.model_error:.2%} of the samples")
    return scene.receive()


def _taken(waveforms: Mapping[str, Any]) -> list[str]:
    """A line for every waveform of samples: what their shape was taken as."""
    from tmca.dbd import SampledWaveform

    samples = {name: one for name, one in waveforms.items() if isinstance(one, SampledWaveform)}
    return [f"{name}: {one.taken_as()}" for name, one in samples.items()]


def _tell(problem: Problem, out: Path) -> None:
    from tmca.dbd.paths import range_walk

    antennas, pulses, frequencies = problem.shape
    sizes = f"{pulses} pulses x {frequencies} frequencies" + (f" x {antennas} antennas" if antennas > 1 else "")
    assert problem.truth is not None
    pairs = zip(problem.sources, problem.truth, strict=True)
    parts = ", ".join(f"{source.name} with {len(truth.points)} paths" for source, truth in pairs)
    print(f"wrote {out}: {sizes}; {parts}")
    if problem.units is not None:
        walks = [range_walk(one.points, problem.units, pulses).max(initial=0.0) for one in problem.truth]
        if max(walks) * frequencies > 0.1:
            said = f"during the pulses delays change by up to {max(walks) * frequencies:.2g} of a resolution cell"
            print(f"{said}: model and simulation leave this range walk out")


def _counts(text: str, option: str) -> list[int]:
    try:
        return [int(one) for one in text.split("+")]
    except ValueError as error:
        raise SettingError(option, repr(text), "a whole number, or several such as 2+3") from error


def _ratio(text: str) -> Any:
    from fractions import Fraction

    try:
        return Fraction(text)
    except (ValueError, ZeroDivisionError) as error:
        raise SettingError("--symbol-ratio", repr(text), "a number such as 3 or 1/2") from error
