"""Sliding Frank–Wolfe and the own dual programme against CVXPY with SCS, and large sizes: ``python benchmarks/dbd.py``.

One thread, the same instances in one run. Bounds: 13×9 (J = 3, L = Q = 3) Frank–Wolfe ≥ 50 times faster and the dual
programme with early stop ≥ 4 times; 9×5 (J = L = Q = 2) Frank–Wolfe ≥ 20 times; 65×33 under 5 s and 0.5 GB, 129×65
under 60 s and 1 GB. SCS takes a minute for each of the larger pairs.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits
from timing import Clock, peak_memory

from tmca.dbd import simulate, solve
from tmca.dbd.dual import solve_cvx

PAIRS = {"13x9": ((13, 9, 3, 3, 3), {"sfw": 50.0, "sdp": 4.0}), "9x5": ((9, 5, 2, 2, 2), {"sfw": 20.0})}
LARGE = {"65x33": ((65, 33, 3, 8, 8), 5, 5.0, 0.5), "129x65": ((129, 65, 3, 10, 10), 2, 60.0, 1.0)}


def pair(sizes: tuple[int, ...], seed: int) -> dict[str, float]:
    """Seconds of each method on one instance, all of which have to recover it."""
    problem = simulate(*sizes, seed=seed)
    seconds = {}
    for method in ("sfw", "sdp"):
        recovery = solve(problem, method, certify=False)
        seconds[method] = recovery.seconds
        assert recovery.score(tolerance=1e-4).success, (method, sizes, seed)
    scs = Clock(wall=True).seconds(lambda: solve_cvx(problem, solver="SCS", eps=1e-4))
    return seconds | {"scs": scs}


def compared(seeds: int) -> tuple[dict[str, dict[str, float]], bool]:
    """Ratios of median times to that of SCS, and whether they keep their bounds."""
    found, kept = {}, True
    for name, (sizes, bounds) in PAIRS.items():
        runs = [pair(sizes, seed) for seed in range(seeds)]
        one = {f"{method}_s": float(np.median([run[method] for run in runs])) for method in ("sfw", "sdp", "scs")}
        found[name] = one | {method: one["scs_s"] / one[f"{method}_s"] for method in ("sfw", "sdp")}
        kept &= all(found[name][method] >= bound for method, bound in bounds.items())
    return found, kept


def large(name: str) -> dict[str, float]:
    """Seconds, successes and memory of a large size; in a process of its own, for the memory."""
    sizes, draws, _, _ = LARGE[name]
    found = [solve(simulate(*sizes, seed=seed), certify=False) for seed in range(draws)]
    seconds = max(recovery.seconds for recovery in found)
    successes = sum(recovery.score().success for recovery in found)
    return {"successes": successes, "draws": draws, "max_s": seconds, "gb": peak_memory()}


def page(found: dict[str, dict[str, float]], seeds: int) -> str:
    """The ratios and the large sizes as Markdown."""
    from tmca.evaluation.tables import repository_commit

    lines = ["# Dual blind deconvolution: speed", ""]
    lines += [f"Command: `python benchmarks/dbd.py --seeds {seeds}` at commit `{repository_commit()}`.", ""]
    lines += [f"Medians of {seeds} instances, one thread, wall time, all in one run, no certificates; SCS to 1e-4.", ""]
    lines += [
        "| instances | method | seconds | SCS, s | times faster | asked |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for name, (_, bounds) in PAIRS.items():
        for method in ("sfw", "sdp"):
            one, asked = found[name], f"≥ {bounds[method]:g}" if method in bounds else "–"
            lines.append(
                f"| {name} | {method} | {one[f'{method}_s']:.3g} | {one['scs_s']:.3g} | {one[method]:.3g} | {asked} |"
            )
    lines += [
        "",
        "| size | success | longest, s | asked | memory, GB | asked |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for name, (_, _, seconds, memory) in LARGE.items():
        one = found[name]
        success = f"{one['successes']} of {one['draws']}"
        lines.append(f"| {name} | {success} | {one['max_s']:.3g} | < {seconds:g} | {one['gb']:.3g} | < {memory:g} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=2, help="instances of each pair")
    parser.add_argument("--out", type=Path, help="a page of the results, Markdown")
    parser.add_argument("--large", choices=list(LARGE), help="one large size only, as JSON")
    options = parser.parse_args()
    with threadpool_limits(1):
        if options.large:
            print(json.dumps(large(options.large)))
            return
        found, kept = compared(options.seeds)
    for name, (_, draws, seconds, memory) in LARGE.items():
        said = subprocess.run([sys.executable, __file__, "--large", name], capture_output=True, text=True, check=True)
        found[name] = json.loads(said.stdout)
        kept &= found[name]["successes"] == draws
        kept &= found[name]["max_s"] < seconds and found[name]["gb"] < memory
    print(json.dumps(found, indent=1))
    if options.out:
        from tmca.data import write_text  # not in the processes whose memory counts

        write_text(page(found, options.seeds), options.out, overwrite=True)
    sys.exit(0 if kept else 1)


if __name__ == "__main__":
    main()
