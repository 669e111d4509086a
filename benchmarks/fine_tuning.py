"""What fine-tuning on captures gains: ``python benchmarks/fine_tuning.py --data ../shared/data --out page.md``.

A network is trained in simulation for the spectral camera as drawn. A rendered bench with hidden faults (registration,
blur, dispersion, timing, response, sensor) captures parts of the training scenes and of scenes that nothing learns
from. The network is fine-tuned on some of the former, through the camera as drawn, whose sensor alone is calibrated,
and through the calibrated camera. Three captures choose the step; scenes that nothing learns from judge. ``--work`` is
gone on with where it stopped.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path
from typing import Any

from tmca.data import write_json, write_text
from tmca.data.scene_names import read_split
from tmca.experiments.results import repository_commit
from tmca.experiments.tuning.proof import TuningProof
from tmca.plots.style import save_figure


def page(found: dict[str, Any], command: str) -> str:
    """The result as Markdown."""
    first, then = found["steps"]
    lines = ["# Fine-tuning a decoder on captures of its bench", ""]
    lines += [f"Command: `{command}` at commit `{repository_commit()}`.", ""]
    size = "×".join(map(str, found["size"]))
    lines += [f"{size} pixels, K = {found['slots']}; {first} steps in simulation, {then} of "
              f"fine-tuning at a rate of {found['rate']:g}. Mean PSNR of {len(found['held_out'])} captures that "
              f"choose the step, and of {len(found['judged'])} of scenes that nothing learns from.", ""]  # fmt: skip
    lines += ["| operator | captures learned from | step kept | held out, dB | judged, dB |"]
    lines += ["| --- | --- | --- | --- | --- |"]
    for row in found["rows"]:
        how = row["captures"] or "none, as trained in simulation"
        lines.append(f"| {row['operator']} | {how} | {row['step']} | {row['held_out']:.2f} | {row['judged']:.2f} |")
    lines += ["", "![A scene that nothing learned from, decoded by every operator before and after](fine-tuning.png)"]
    return "\n".join([*lines, ""])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, help="folder with splits/ and cubes; rendered scenes without")
    parser.add_argument("--work", type=Path, default=Path("runs/fine-tuning"))
    parser.add_argument("--out", type=Path, default=Path("runs/fine-tuning.md"), help="page; .json and .png beside it")
    parser.add_argument("--counts", default="1,4,12", help="captures that are learned from")
    parser.add_argument("--steps", default="400,200", help="in simulation, and of fine-tuning")
    parser.add_argument("--rate", type=float, default=1e-4)
    given = parser.parse_args()
    learned, judged = ["astronaut", "chelsea", "rocket", "retina", "motorcycle"], ["coffee"]
    if given.data:
        lists = given.data / "splits"
        cubes, apart = ([str(p) for p in read_split(lists / f"spectral_{part}.txt")] for part in ("train", "val"))
        learned, judged = [*cubes, *learned[:3]], [*apart, "coffee", "motorcycle"]
    counts, steps = (tuple(map(int, text.split(","))) for text in (given.counts, given.steps))
    proof = TuningProof(given.work, learned, judged, counts=counts, steps=(steps[0], steps[1]), rate=given.rate)
    found, figure = proof.run(lambda said: print(said, flush=True))
    text = page(found, shlex.join(["python", "benchmarks/fine_tuning.py", *sys.argv[1:]]))
    write_text(text, given.out, overwrite=True)
    save_figure(figure, given.out.with_suffix(".png"), overwrite=True)
    write_json(found, given.out.with_suffix(".json"), overwrite=True)
    print(text)


if __name__ == "__main__":
    main()
