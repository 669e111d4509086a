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
one thread, CPU time, medians. The load of the {cores} cores was {before:.1f} when it began and {after:.1f} when it
ended (its own is 1).

*First* is a frame of a camera that nothing was prepared for. *Preparing* computes what depends on camera, noise and
prior alone. *Next* is another frame of that camera, prepared; *largest difference* that of its estimate from the one
that is solved anew, relative irradiance. Scene `coffee`, K = 8 unless one mask is said, σ = 0.01, the prior of the
rendered scenes, learned before. Goals are in brackets.

| row | what | figures |
| --- | --- | --- |
"""


def measured(name: str) -> dict[str, float]:
    """What a process of its own finds of a row."""
    around = os.environ | {"OMP_NUM_THREADS": "1"}
    done = subprocess.run([sys.executable, __file__, "--row", name], capture_output=True, text=True, env=around)
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="rows whose name contains this text")
    parser.add_argument("--out", type=Path, help="a page of the results, Markdown")
    parser.add_argument("--row", help=argparse.SUPPRESS)
    options = parser.parse_args()
    import torch
    from realtime_rows import ROWS

    if options.row:
        torch.set_num_threads(1)
        print(json.dumps(ROWS[options.row][2]()))
        return
    before, lines = os.getloadavg()[0], []
    for name in (name for name in ROWS if options.only in name):
        what, goals, _ = ROWS[name]
        said = figures(measured(name), goals)
        print(f"{name}: {said}", flush=True)
        lines.append(f"| {name} | {what} | {said} |")
    if options.out:
        from tmca.data import write_text
        from tmca.evaluation.tables import repository_commit

        head = HEAD.format(commit=repository_commit(), torch=torch.__version__, machine=platform.machine(),
                           cores=os.cpu_count(), before=before, after=os.getloadavg()[0])  # fmt: skip
        write_text(head + "\n".join(lines) + "\n", options.out, overwrite=True)


if __name__ == "__main__":
    main()
