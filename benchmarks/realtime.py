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

HEAD = """# Decoding live: seconds of a frame

Command: `python benchmarks/realtime.py --out docs/results/realtime.md` at commit `{commit}`; torch {torch}, {machine},
one thread, CPU time, medians. The load of the {cores} cores was {load:.1f} when it began and {after:.1f} when it
ended (its own is 1).{before}

*First* is a frame of a camera that nothing was prepared for. *Preparing* computes what depends on camera, noise and
prior alone. *Next* is another frame of that camera, prepared; *largest difference* that of its estimate from the one
that is solved anew, relative irradiance. Scene `coffee`, K = 8 unless one mask is said, σ = 0.01, the prior of the
rendered scenes, learned before. Goals are in brackets.

| row | what | figures | before |
| --- | --- | --- | --- |
"""
BEFORE = """ *Before* is the package of commit `{commit}`, which prepared nothing,
in the same run."""


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
    units = {name: " s" for name in ("first", "preparing", "next", "floor", "anew")}
    return ", ".join(
        f"{name} {value:.3g}{units.get(name, '')}" + (f" ({goals[name]:g})" if name in goals else "")
        for name, value in found.items()
    )


def line_of(name: str, tree: Path | None) -> str:
    """A row of the page."""
    from realtime_rows import ROWS

    row = ROWS[name]
    said, earlier = figures(measured(name), row.goals), ""
    if tree and row.before:
        earlier = figures(measured(name, tree), {})
    print(f"{name}: {said}" + (f"; before {earlier}" if earlier else ""), flush=True)
    return f"| {name} | {row.what} | {said} | {earlier} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="rows whose name contains this text")
    parser.add_argument("--out", type=Path, help="a page of the results, Markdown")
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
    load = os.getloadavg()[0]
    lines = [line_of(name, options.before) for name in ROWS if options.only in name]
    if options.out:
        from tmca.data import write_text

        write_text(head(options.before, load) + "\n".join(lines) + "\n", options.out, overwrite=True)


def head(tree: Path | None, load: float) -> str:
    """The page above its table; ``load`` is that of the machine when it began."""
    import torch

    from tmca.evaluation.tables import repository_commit

    git = ["git", "-C", str(tree), "rev-parse", "--short=12", "HEAD"]
    old = BEFORE.format(commit=subprocess.check_output(git, text=True).strip()) if tree else ""
    return HEAD.format(commit=repository_commit(), torch=torch.__version__, machine=platform.machine(),
                       cores=os.cpu_count(), load=load, after=os.getloadavg()[0], before=old)  # fmt: skip


if __name__ == "__main__":
    main()
