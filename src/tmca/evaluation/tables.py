"""Tables of results: rows from measured cells, JSON and CSV for programs, Markdown for people."""

from __future__ import annotations

import subprocess  # nosec B404
from collections.abc import Collection, Iterable, Mapping, Sequence
from math import isnan
from pathlib import Path
from shlex import quote
from statistics import stdev
from typing import TYPE_CHECKING, Any, TypedDict

from tmca.errors import DataError, OutputError, SettingError
from tmca.evaluation.grid import Measured

if TYPE_CHECKING:
    from tmca.evaluation.camera import Place
    from tmca.evaluation.study import Study

Row = dict[str, Any]
Column = tuple[str, str, str]
"""(key, heading, format) of a column."""


class Split(TypedDict):
    """Sources that a study learned from, measured and validated on; ``names`` are short ones of what was measured."""

    train: list[str]
    test: list[str]
    names: dict[str, str]
    validation: list[str]


def decoder_labels(kind: str, shown: Mapping[str, str] | None = None) -> dict[str, str]:
    """Name → label of the decoders of a kind of camera, those of plug-ins included.

    Args:
        kind: of the camera.
        shown: labels that differ from the decoder's own, and those of networks that are trained row by row; first.
    """
    from tmca.decoders import decoders_for

    known = {name: cls.label for name, cls in decoders_for(kind, moving=None).items()}
    return {**(shown or {}), **{name: label for name, label in known.items() if name not in (shown or {})}}


def check_new(files: Iterable[Path], overwrite: bool) -> None:
    """Refuse to start where earlier results would be replaced.

    Raises:
        OutputError: a file exists and ``overwrite`` is False.
    """
    for file in files:
        if file.exists() and not overwrite:
            raise OutputError(file, "a file of earlier results", "none", "pass --overwrite or another --out")


def check_resumed(files: Sequence[Path], overwrite: bool, entry: str, described: Mapping[str, Any]) -> bool:
    """Whether earlier results are replaced: where that is asked for, and where they are of the same description.

    Args:
        files: of the results, the JSON file first.
        overwrite: whether it is asked for.
        entry: of the JSON file that holds the description: ``"study"``.
        described: what is to be computed, in JSON's own types.

    Raises:
        OutputError: results of something else.
    """
    there = [file for file in files if file.exists()]
    if overwrite or not there:
        return overwrite
    before = _described_in(files[0], entry)
    changed = [name for name, value in described.items() if name in before and before[name] != value]
    if before and not changed:
        return True
    found = f"results of another {entry}" + (f" (other {', '.join(changed)})" if changed else "")
    remedy = "pass --overwrite to replace them, or another --out; finished cells are used again"
    raise OutputError(there[0], found, f"none, or those of this {entry}", remedy)


def _described_in(file: Path, entry: str) -> dict[str, Any]:
    """What earlier results are of; nothing where it cannot be read."""
    from tmca.attributes import NamedJson, read_json

    try:
        stored = read_json(file, NamedJson).get(entry) if file.exists() else None
    except DataError:
        return {}
    return stored if isinstance(stored, dict) else {}


def check_counts(**counts: int) -> None:
    """Raises SettingError for the first of these options that is below 1."""
    for name, value in counts.items():
        if value < 1:
            raise SettingError(f"--{name}", str(value), "at least 1")


def check_decoders(decoders: Sequence[str], known: Collection[str]) -> None:
    """Raises SettingError unless there are decoders, all of them known."""
    from tmca.decoders.own import is_file
    from tmca.decoders.registry import unknown_decoder

    unknown = [name for name in decoders if name not in known]
    if files := [name for name in unknown if is_file(name)]:
        remedy = f"pass --decoders {quote(','.join(files))} if you trust {'it' if len(files) == 1 else 'them'}"
        found = f"{', '.join(files)}, which {'is' if len(files) == 1 else 'are'} code"
        raise SettingError("decoders", found, "code that the command line, or own_study, names", remedy)
    if unknown:
        raise unknown_decoder("decoders", unknown[0], known)
    if not decoders:
        raise SettingError("decoders", "none", f"some of {', '.join(known)}")


def write_table(
    results: Row, text: str, rows: Sequence[Row], columns: Sequence[str], out: Path, overwrite: bool
) -> None:
    """Results for programs as ``OUT.json`` and ``OUT.csv``, and for people as ``OUT.md``.

    Args:
        results: all there is.
        text: Markdown.
        rows, columns: of the CSV file, full precision.
        out: the three files without their suffixes.
        overwrite: replace files.

    Raises:
        OutputError: a file exists and ``overwrite`` is False, or cannot be written.
    """
    import pandas as pd

    from tmca.data import write_json, write_text

    table = pd.DataFrame(rows, columns=list(columns))
    texts = {".csv": table.to_csv(index=False, float_format=lambda value: repr(float(value))), ".md": text}
    write_json(results, out.with_name(f"{out.name}.json"), overwrite=overwrite)
    for suffix, content in texts.items():
        write_text(content, out.with_name(f"{out.name}{suffix}"), overwrite=overwrite)


def means(rows: Iterable[Mapping[str, float]]) -> dict[str, float]:
    """Mean of every number over the rows that have it."""
    known: dict[str, list[float]] = {}
    for row in rows:
        for name, value in row.items():
            known.setdefault(name, []).append(value)
    return {name: mean(values) for name, values in known.items()}


def mean(values: Sequence[Any]) -> float:
    """Of numbers."""
    return float(sum(values) / len(values))


def grouped(cells: Iterable[Row], *names: str) -> dict[tuple[Any, ...], list[Row]]:
    """Cells that agree in some settings, in the order in which these first occur."""
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for cell in cells:
        groups.setdefault(tuple(cell[name] for name in names), []).append(cell)
    return groups


def training_rows(measured: Iterable[Measured]) -> list[Row]:
    """What every training took, and its validation figures."""
    return [
        {"code": cell["code"], "decoder": cell["decoder"], "seed": cell["seed"],
         "steps": cell["training"]["optimiser"]["steps"], "cpu_seconds": cell["seconds"], "best": cell["best"]}
        for cell in measured if "best" in cell
    ]  # fmt: skip


_LATEX = str.maketrans(
    {**{sign: f"\\{sign}" for sign in "&%$#_{}"}, "\\": r"\textbackslash{}", "~": r"\textasciitilde{}",
     "^": r"\textasciicircum{}", "°": r"$^\circ$", "×": r"$\times$", "σ": r"$\sigma$", "−": "$-$", "±": r"$\pm$"}
)  # fmt: skip
"""What LaTeX takes for something else, as it prints it."""
MEASURED: Column = ("measured", "measured", "")
"""Of a row that lacks cells: of which scenes, or of how many cells, it is the mean."""


def rows_of(
    study: Study, cells: Iterable[Measured], trainings: Sequence[Row], places: Sequence[Place] = ()
) -> list[Row]:
    """A row for every code, noise and decoder: means over scenes of the means over seeds.

    Args:
        study: what was compared.
        cells: measurements.
        trainings: of ``training_rows``.
        places: where is measured; rows that lack some of them say in ``measured`` what they have.
    """
    metric = study.evaluation.metric
    rows = []
    for (code, noise, decoder), own in grouped(cells, "code", "noise", "decoder").items():
        scenes = {scene: means(cell["metrics"] for cell in part) for (scene,), part in grouped(own, "scene").items()}
        seeds = sorted(grouped(own, "seed").items())
        rows.append({
            "method": f"{code} + {study.decoder_labels[decoder]}", "exposure": "equal",
            "code": code, "noise": noise, "decoder": decoder, "scenes": scenes, **means(scenes.values()),
            f"seed_{metric}": [mean([cell["metrics"][metric] for cell in part]) for _, part in seeds],
            **means({name: cell[name] for name in ("throughput", "seconds")} for cell in own),
            "training_cpu_minutes": _training_minutes(study, code, decoder, trainings),
            **study.evaluation.row(own), **_lacking(study, own, places),
        })  # fmt: skip
    return rows


def _lacking(study: Study, own: Sequence[Measured], places: Sequence[Place]) -> Row:
    """What the cells of a row are of all that it should have; nothing of a row that has all."""
    code, decoder = own[0]["code"], own[0]["decoder"]
    learns = decoder in study.networks or study.codes[code].learn is not None
    seeds = len(study.all_seeds if learns else study.seeds_of(decoder))
    scenes = {place.scene for place in places if place.takes(study.prior_kind(decoder))}
    there, wanted = {cell["scene"] for cell in own}, len(scenes) * seeds
    said = [f"{len(there)} of {len(scenes)} scenes"] if scenes - there else []
    said += [f"{len(own)} of {wanted} cells"] if len(own) < len(there) * seeds and places else []
    return {MEASURED[0]: ", ".join(said)} if said else {}


def plain_columns(rows: Iterable[Row]) -> list[str]:
    """Names of all that rows have that is a number or a word."""
    return list(dict.fromkeys(n for row in rows for n, value in row.items() if isinstance(value, str | int | float)))


def columns_there(columns: Iterable[Column], rows: Sequence[Row]) -> list[Column]:
    """Columns that some row has; seeds and scenes one by one where some row has several."""
    there = [column for column in columns if any(row.get(column[0]) not in (None, "") for row in rows)]
    alone = {name for name in ("seeds", "scenes") if not any(", " in str(row.get(name, "")) for row in rows)}
    return [column for column in there if column[0] not in alone]


def _training_minutes(study: Study, code: str, decoder: str, trainings: Sequence[Row]) -> float:
    """CPU minutes of learning, means over seeds: of the row's network, and of that which its codes learned with."""
    learn = study.codes[code].learn
    learners = [name for name, others in learn.networks.items() if decoder in others] if learn else []
    spent = 0.0
    for name in (decoder, *learners):
        own = [one["cpu_seconds"] for one in trainings if (one["code"], one["decoder"]) == (code, name)]
        spent += mean(own) / 60 if own else 0.0
    return spent


def markdown_table(rows: Sequence[Row], columns: Sequence[Column]) -> str:
    """Rows as a Markdown table.

    Args:
        rows: dictionaries.
        columns: (key, heading, format) of each column; a missing value, None or NaN, is left empty.
    """
    lines = ["| " + " | ".join(heading for _, heading, _ in columns) + " |", "|" + " --- |" * len(columns)]
    for row in rows:
        values = [(row.get(key), spec) for key, _, spec in columns]
        lines.append("| " + " | ".join("" if _missing(value) else format(value, spec) for value, spec in values) + " |")
    return "\n".join(lines) + "\n"


def latex_table(rows: Sequence[Row], columns: Sequence[Column]) -> str:
    """Rows as a LaTeX table for the package booktabs, numbers at the right, where there are several seeds with their
    standard deviation; arguments as of `markdown_table`."""

    def line(texts: Iterable[str]) -> str:
        return " & ".join(text.translate(_LATEX) for text in texts) + r" \\"

    def entry(row: Row, key: str, spec: str) -> str:
        value, seeds = row.get(key), row.get(f"seed_{key}", ())
        text = "" if _missing(value) else format(value, spec)
        spread = f" ± {stdev(seeds):{spec.lstrip('+')}}" if text and len(seeds) > 1 else ""
        return f"{text}{spread}".replace("-", "−") if spec else text

    values = [[entry(row, key, spec) for key, _, spec in columns] for row in rows]
    sides = "".join("r" if spec else "l" for *_, spec in columns)
    body = [rf"\begin{{tabular}}{{{sides}}}", r"\toprule", line(heading for _, heading, _ in columns), r"\midrule"]
    several = any("±" in text for row in values for text in row)
    said = ["% \\usepackage{booktabs}", *["% ± standard deviation over seeds"][:several]]
    return "\n".join([*said, *body, *map(line, values), r"\bottomrule", r"\end{tabular}", ""])


def not_meaningful(rows: Iterable[Row]) -> list[str]:
    """A line about rows of a table whose estimates are no scenes: PSNR below 0 dB; nothing without such rows."""
    low = [row for row in rows if any(one.get("psnr", 0.0) < 0 for one in (row, *row["scenes"].values()))]
    if not low:
        return []
    named = ", ".join(dict.fromkeys(row["decoder"] for row in low if "decoder" in row))
    said = f"Warning: {len(low)} row{'s'[: len(low) != 1]}{f' ({named})' if named else ''} of this table"
    return [f"{said} fell below 0 dB of PSNR: not meaningful, as of a decoder that diverged."]


def _missing(value: Any) -> bool:
    return value is None or (isinstance(value, float) and isnan(value))


def made_by(results: Mapping[str, Any]) -> str:
    """The command that made results, and the commit where one is known, for a page."""
    called = f"Command: `{results['command']}`" if results["command"] else "Called from Python"
    return f"{called} at commit `{results['commit']}`." if results["commit"] else f"{called}."


def repository_commit() -> str | None:
    """Commit of the checkout that the package runs from (``-dirty`` with uncommitted changes), None outside of one."""
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty", "--abbrev=12"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=10)  # noqa: S603 # nosec B603
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip() or None
