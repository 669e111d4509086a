"""Seconds and memory of one frame by every decoder of ``tmca reconstruct``: ``python benchmarks/reconstruction.py``.

Every row is a process of its own, on one thread unless told otherwise; on one thread of a processor seconds are those
of its own work (CPU time), else wall time. What is learned before any frame (priors, dictionaries, exported programs)
is told apart. The first frame of a camera loads that and factors what depends on the camera alone; the next frame has
other noise. The floor is one pass of the operator forward and one of its adjoint, measured in the process of the row.
Memory is the peak while decoding, interpreter and libraries (0.4 GB) included; on an accelerator what its allocator
held. A small run: ``--size spectral=24x28x4 --only 'spectral: admm'``; every row takes the seconds of its imports.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shlex
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from timing import Clock

Row = dict[str, Any]
KINDS = ("spectral", "spectral, TSA-Net", "light field", "spectral-depth", "pixel shutter")


def one_row(kind: str, stage: str, name: str, options: argparse.Namespace) -> None:
    """Measure a row in this process; print what is found, a line of JSON as soon as it is known."""
    import torch
    from reconstruction_rows import case_of, decoder_of, prepare

    from tmca.errors import SettingError

    torch.set_num_threads(options.threads)
    clock = Clock(options.device, wall=options.threads > 1)
    case = case_of(kind, options.sizes[kind], options.folder, options.device, options.threads)
    clock.forget_peak()
    if stage == "prepare":
        try:
            told(seconds=clock.seconds(lambda: prepare(case, name)), gb=clock.peak())
        except SettingError as error:
            told(skipped=error.found)
        return
    first, second = case.snapshot(0), case.snapshot(1)
    told(floor=clock.median(case.there_and_back))
    clock.forget_peak()
    made: list[Callable[[Any], object]] = []

    def begin() -> None:
        made.append(decoder_of(case, name))
        made[0](first)

    with torch.no_grad():
        told(first=clock.seconds(begin), gb=clock.peak())
        told(next=clock.seconds(lambda: made[0](second)), gb=clock.peak())


def told(**found: Any) -> None:
    print(json.dumps(found), flush=True)


def measured(kind: str, stage: str, name: str, options: argparse.Namespace) -> Row:
    """What a process of its own finds of a row."""
    words = [sys.executable, __file__, "--row", kind, stage, name, "--folder", str(options.folder)]
    words += ["--device", options.device, "--threads", str(options.threads)]
    words += [word for own, size in options.sizes.items() for word in ("--size", f"{own}={size}")]
    around = os.environ | {"TMCA_CACHE": str(options.folder), "OMP_NUM_THREADS": str(options.threads)}
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=options.limit, env=around)
        out, fault = done.stdout, done.stderr.strip().splitlines()[-1:] if done.returncode else []
    except subprocess.TimeoutExpired as stopped:
        out, fault = (stopped.stdout or b"").decode(), [f"stopped after {options.limit:g} s"]
    found: Row = {}
    for line in out.splitlines():
        found |= json.loads(line)
    return found | ({"fault": fault[0]} if fault else {})


def all_rows(options: argparse.Namespace) -> dict[str, dict[str, dict[str, Row]]]:
    """kind → ``prepare`` and ``decode`` → name → what was found."""
    from reconstruction_rows import decoders, needed

    found: dict[str, dict[str, dict[str, Row]]] = {}
    for kind in KINDS:
        names = [name for name in decoders(kind) if options.only in f"{kind}: {name}"]
        own: dict[str, dict[str, Row]] = {"prepare": {}, "decode": {}}
        for name in names:
            before = needed(kind, name)
            if before is not None and before not in own["prepare"]:
                own["prepare"][before] = shown(kind, "prepare", before, options)
            made = own["prepare"].get(before or "", {})
            missing = {key: made[key] for key in ("skipped", "fault") if key in made}
            own["decode"][name] = missing or shown(kind, "decode", name, options)
        found |= {kind: own} if names else {}
    return found


def shown(kind: str, stage: str, name: str, options: argparse.Namespace) -> Row:
    """A row, printed as it comes, and kept: one that was measured before is not measured again."""
    file, key = options.folder / "rows.json", f"{kind} {options.sizes[kind]}: {stage} {name}"
    kept: dict[str, Row] = json.loads(file.read_text()) if file.exists() else {}
    if key not in kept:
        kept[key] = measured(kind, stage, name, options)
        file.write_text(json.dumps(kept, indent=1))
    row = kept[key]
    numbers = ", ".join(f"{key} {value if isinstance(value, str) else f'{value:.3g}'}" for key, value in row.items())
    print(f"{kind}: {stage} {name}: {numbers}", flush=True)
    return row


def page(found: dict[str, dict[str, dict[str, Row]]], options: argparse.Namespace, load: tuple[float, ...]) -> str:
    """All rows as Markdown."""
    import torch

    from tmca.evaluation.tables import repository_commit

    clock = Clock(options.device, wall=options.threads > 1).name
    command = shlex.join(["python", "benchmarks/reconstruction.py", *options.given])
    where = torch.cuda.get_device_name() if options.device.startswith("cuda") else platform.machine()
    threads = "one thread" if options.threads == 1 else f"{options.threads} threads"
    lines = ["# One frame by every decoder: seconds and memory", ""]
    lines += [f"Command: `{command}` at commit `{repository_commit()}`; torch {torch.__version__}, {where}.", ""]
    ends = f"{load[0]:.1f} when it began and {os.getloadavg()[0]:.1f} when it ended"
    lines += [f"{threads.capitalize()}, {clock}; the load of the {os.cpu_count()} cores was {ends} (its own is 1).", ""]
    lines += [_WORDS, ""]
    for kind, rows in found.items():
        lines += [f"## {kind[0].upper()}{kind[1:]}: {_said_size(kind, options.sizes[kind])}", "", *_tables(rows)]
    return "\n".join(lines)


_WORDS = """*Floor* is one pass of the camera's operator forward and one of its adjoint. The *first frame* of a camera
also loads what was learned and factors what depends on the camera alone; the *next frame*, with other noise, is what
a series costs; × floor is the next frame over the floor of the same process. *Peak* is all that the process held
while it decoded, interpreter and libraries (0.4 GB) included. Networks have random weights: they are as fast as
trained ones of their size. Every decoder is as in `tmca reconstruct`, standard deviations included where it gives
them; *prepared* ones compute before the first frame what all frames have in common. The time of pictures and files is
not in the table. Iterative decoders stop by themselves, sooner or later with
the scene: here coffee, with read noise of 0.01. The spectral camera has random codes over the whole frame, K = 8, the
light field's tiles of 16 pixels, K = 8, the spectral-depth camera the thesis' masks, K = 4; TSA-Net's has one mask
and no shutter, the pixel shutter opens every pixel once."""


def _said_size(kind: str, size: str) -> str:
    rows, columns, channels = size.split("x")
    what = {"light field": f"{channels}×{channels} views", "pixel shutter": f"{channels} slots, 16 frames"}
    return f"{rows}×{columns} pixels, {what.get(kind, f'{channels} bands')}"


def _tables(rows: dict[str, dict[str, Row]]) -> list[str]:
    lines = []
    if rows["prepare"]:
        lines += ["| made once, before any frame | seconds | peak, GB |", "| --- | --- | --- |"]
        for name, row in rows["prepare"].items():
            numbers = _fault(row) or f"{_short(row['seconds'])} | {row['gb']:.2f}"
            lines.append(f"| {name} | {numbers} |")
        lines.append("")
    floors = [row["floor"] for row in rows["decode"].values() if "floor" in row]
    if floors:
        lines += [f"Floor: {statistics.median(floors) * 1e3:.3g} ms (median over the processes).", ""]
    lines += ["| decoder | first frame, s | next frame, s | × floor | peak, GB |", "| --- | --- | --- | --- | --- |"]
    return [*lines, *(f"| {name} | {_numbers(row)} |" for name, row in rows["decode"].items()), ""]


def _numbers(row: Row) -> str:
    if "next" in row:
        ratio = row["next"] / row["floor"]
        times = f"{_short(row['first'])} | {_short(row['next'])} | {_short(ratio)}"
        return f"{times} | {row['gb']:.2f}"
    if "first" in row:
        return f"{_short(row['first'])} | {row['fault']} | | {row['gb']:.2f}"
    return f"{_fault(row)} | | |"


def _short(number: float) -> str:
    return f"{number:.3g}" if number < 100 else f"{number:.0f}"


def _fault(row: Row) -> str:
    return f"skipped: {row['skipped']}" if "skipped" in row else row.get("fault", "")


def _parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--size", action="append", default=[], help="KIND=ROWSxCOLUMNSxBANDS (or views along an axis), repeatable"
    )
    parser.add_argument("--only", default="", help="rows whose 'KIND: DECODER' contains this text")
    parser.add_argument("--device", default="cpu", help="cpu or cuda")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--limit", type=float, default=3600.0, help="seconds after which a row is stopped")
    parser.add_argument("--out", type=Path, help="a page of the results, Markdown")
    parser.add_argument("--work", type=Path, help="folder that keeps rows and what was learned; gone on with")
    parser.add_argument("--row", nargs=3, help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    from reconstruction_rows import SIZES

    options.sizes = SIZES | dict(given.split("=", 1) for given in options.size)
    if unknown := set(options.sizes) - set(SIZES):
        parser.error(f"--size: no camera {', '.join(unknown)}; there are: {'; '.join(SIZES)}")
    options.given = sys.argv[1:]
    return options


def main() -> None:
    options = _parsed()
    if options.row:
        one_row(*options.row, options)
        return
    load = os.getloadavg()
    with tempfile.TemporaryDirectory() as folder:
        options.folder = options.work or Path(folder)
        options.folder.mkdir(parents=True, exist_ok=True)
        found = all_rows(options)
    if options.out:
        from tmca.data import write_text

        write_text(page(found, options, load), options.out, overwrite=True)
    faults = [row for rows in found.values() for stage in rows.values() for row in stage.values() if "fault" in row]
    sys.exit(1 if faults or not found else 0)


if __name__ == "__main__":
    main()
