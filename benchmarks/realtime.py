"""What decoding live takes: ``python benchmarks/realtime.py --out docs/results/realtime.md``.

Every row is a process of its own on one thread: CPU time, medians. ``HEAD`` says what the figures are.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any

HEAD = """# Decoding live: seconds of a frame

Command: `{command}` at {commits}; torch {torch}, {machine}, one thread. The load of the {cores} cores was at
most {load:.1f} when a row began (its own is 1).

*First* is the first frame of a camera, *preparing* computes what depends on camera, noise and prior alone, *next* is
another frame of that camera, prepared; a *frame* of a decoder that prepares nothing is like any other. Of first frames
and preparing one run was timed, of others the median of three or more; CPU time, of `tmca live` wall time. *Largest
difference* is that of a prepared estimate from one that is solved anew, relative irradiance (the likelihood's is
on purpose: it leaves out what hardly matters). A row beside which other work ran is measured again: that makes it up
to half slower. Scene `coffee`, K = 8
unless one mask is said, σ = 0.01, the prior of the rendered scenes, learned before. Goals are in brackets.
{before}
| row | what | figures | before |
| --- | --- | --- | --- |
"""
BEFORE = """
*Before* is the package of commit `{commit}`, in the same run, which solved every frame anew.
"""
UNITS = {"PSNR": " dB"} | {
    name: " s"
    for name in ("first", "first, estimate alone", "preparing", "next", "frame", "floor", "anew", "cached", "learned")
}


def measured(name: str, tree: Path | None = None) -> dict[str, float]:
    """What a process of its own finds of a row; ``tree`` has the package of another commit."""
    around = os.environ | {"OMP_NUM_THREADS": "1"} | ({"PYTHONPATH": str(tree / "src")} if tree else {})
    words = [sys.executable, __file__, "--row", name, *(["--as-before"] if tree else [])]
    done = subprocess.run(words, capture_output=True, text=True, env=around)
    if done.returncode:
        sys.exit(f"{name}: {(done.stderr.strip().splitlines() or ['stopped'])[-1]}")
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def figures(found: dict[str, float], goals: dict[str, float]) -> str:
    """Numbers with their units, and goals in brackets."""
    return ", ".join(
        f"{name} {value:.4g}{UNITS.get(name, '')}" + (f" ({goals[name]:g})" if name in goals else "")
        for name, value in found.items()
    )


def missed(found: dict[str, float], goals: dict[str, float]) -> list[str]:
    """Figures that do not reach their goals."""
    from realtime_rows import LARGER_IS_BETTER

    return [
        f"{name} {found[name]:.3g}{UNITS.get(name, '')} of {goal:g}"
        for name, goal in goals.items()
        if (found[name] < goal if name in LARGER_IS_BETTER else found[name] > goal)
    ]


def row_of(name: str, row: Any, figures_of: dict[str, Any]) -> tuple[str, str]:
    """A row of the page, and why it misses goals, if it does."""
    found, earlier, goals = {**figures_of["found"]}, figures_of["before"], {**row.goals}
    for figure, goal in (row.over_before or {}).items() if earlier else ():
        ratio = f"{figure} over before"
        found[ratio], goals[ratio] = found[figure] / next(iter(earlier.values())), goal
    misses = missed(found, goals)
    reason = f"- **{name}**: {', '.join(misses)}. {row.why}".rstrip() if misses else ""
    return f"| {name} | {row.what} | {figures(found, goals)} | {figures(earlier, {})} |", reason


def measure(names: list[str], tree: Path | None, file: Path | None) -> dict[str, Any]:
    """Figures by row: those of the file that were measured at this commit, and the others, which are stored in it one
    after the other; what was stopped goes on."""
    from realtime_rows import ROWS

    from tmca.data import write_text
    from tmca.evaluation.tables import repository_commit

    known: dict[str, Any] = json.loads(file.read_text()) if file and file.exists() else {}
    commit = repository_commit()
    for name in names:
        if name in known and known[name]["commit"] == commit:
            continue
        load = os.getloadavg()[0]
        found, earlier = measured(name), measured(name, tree) if tree and ROWS[name].before else {}
        known[name] = {"found": found, "before": earlier, "commit": commit, "load": load}
        print(f"{name}: {figures(found, ROWS[name].goals)}", flush=True)
        if file:
            write_text(json.dumps(known, indent=1, ensure_ascii=False) + "\n", file, overwrite=True)
    return known


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="measure rows whose name contains this text")
    parser.add_argument("--out", type=Path, help="a page of the results, Markdown; the figures are in a JSON beside it")
    parser.add_argument("--before", type=Path, help="a checkout of another commit, measured too")
    parser.add_argument("--row", help=argparse.SUPPRESS)
    parser.add_argument("--as-before", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    import torch
    from realtime_rows import ROWS

    if options.row:
        torch.set_num_threads(1)
        row = ROWS[options.row]
        print(json.dumps((row.before if options.as_before and row.before else row.measure)()))
        return
    names = [name for name in ROWS if options.only in name]
    known = measure(names, options.before, options.out and options.out.with_suffix(".json"))
    if options.out:
        from tmca.data import write_text

        write_text(page({name: known[name] for name in ROWS if name in known}, options), options.out, overwrite=True)


def _commits(known: dict[str, Any]) -> str:
    """The commit at which most rows were measured, and the rows of others."""
    rows: dict[str, list[str]] = {}
    for name, one in known.items():
        rows.setdefault(one["commit"], []).append(name)
    most = max(rows, key=lambda commit: len(rows[commit]))
    others = [f"{', '.join(names)} at `{commit}`" for commit, names in rows.items() if commit != most]
    return "; ".join([f"commit `{most}`", *others])


def page(known: dict[str, Any], options: argparse.Namespace) -> str:
    """The table, and the goals that are not reached."""
    import torch
    from realtime_rows import ROWS

    git = ["git", "-C", str(options.before), "rev-parse", "--short=12", "HEAD"]
    before = BEFORE.format(commit=subprocess.check_output(git, text=True).strip()) if options.before else ""
    words = ["--before CHECKOUT"] if options.before else []
    command = " ".join(["python benchmarks/realtime.py", *words, f"--out {options.out}"])
    load = max(one["load"] for one in known.values())
    head = HEAD.format(command=command, commits=_commits(known), torch=torch.__version__,
                       machine=platform.machine(), cores=os.cpu_count(), load=load, before=before)  # fmt: skip
    rows = [row_of(name, ROWS[name], one) for name, one in known.items()]
    reasons = "\n".join(reason for _, reason in rows if reason)
    tail = f"\n## Goals that are not reached\n\n{reasons}\n" if reasons else ""
    return head + "\n".join(line for line, _ in rows) + "\n" + tail


if __name__ == "__main__":
    main()
