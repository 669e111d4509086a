"""What priors lose on scenes that they have not learned from: ``python -m studies.transfer DATA``.

Priors of three scenes and of sixteen decode snapshots of five others (`cave_test`), once more after each of these was
learned, too, and after it alone was learned. Written: ``transfer.json`` and the page ``transfer.md``.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch

import tmca
from studies.bench import middle_of, select_bands
from studies.grid import repository_commit
from studies.tables import Column, pooled, table, write_results
from tmca.data import read_split
from tmca.metrics import psnr
from tmca.priors import learn_prior

BANDS, FRAME = 12, (128, 160)
CAMERA: dict[str, Any] = {"slots": 8, "shutter": "random", "sensor": tmca.Sensor(read_noise=0.01), "seed": 1}
THREE = ("chart_and_stuffed_toy", "feathers", "paints")
COLUMNS = [
    Column("scenes", "scenes learned from"),
    Column("left_out", "scene left out, dB", ".2f"),
    Column("known", "learned, too, dB", ".2f"),
    Column("alone", "it alone learned, dB", ".2f"),
    Column("gap", "gap, dB", ".2f"),
]
BY, MEANS = ("scenes",), [column.key for column in COLUMNS[1:]]
"""Names of which the page has a row each, and of figures that are means over the scenes left out."""
HEAD = """# What priors lose on new scenes

A prior knows the scenes that it learned from better than others. How much better is the *transfer gap*: the PSNR of a
scene when the prior learned it, too, less the PSNR when it did not. Among more scenes each one weighs less, so that the
gap gets smaller for two reasons. A prior that learned nothing but the scene itself shows what is left to gain.

Made by `python -m studies.transfer DATA` at commit `{commit}`. Spectral camera of {bands} bands, K = 8 random codes,
σ = 0.01, decoded by the patch LMMSE under one Gaussian; the middle {rows}×{columns} pixels of the five scenes of
`cave_test`. The three scenes are those that earlier tables learned from ({three}); the sixteen
are all of `cave_train`.

"""


def cube(file: Path) -> Any:
    scene: Any = tmca.read(file)
    return select_bands(scene, BANDS)


def measured(data: Path) -> Iterator[dict[str, Any]]:
    """Rows of both numbers of scenes, scene by scene."""
    train, test = (read_split(data / "splits" / f"cave_{name}.txt") for name in ("train", "test"))
    known = {file.stem: cube(file) for file in map(Path, train)}
    groups = [[known[name] for name in names] for names in (THREE, known)]
    camera = tmca.SpectralCamera(groups[0][0]["wavelength"].values.tolist(), FRAME, **CAMERA)
    priors = [learn_prior(scenes, camera) for scenes in groups]
    for file in map(Path, test):
        new = cube(file)
        truth = middle_of(new, FRAME, str(file))
        snapshot = tmca.simulate(truth, camera, seed=3, progress=False)
        alone = decibels(snapshot, learn_prior([new], camera), truth)
        for scenes, prior in zip(groups, priors, strict=True):
            row = {"left_out": decibels(snapshot, prior, truth)}
            row["known"] = decibels(snapshot, learn_prior([*scenes, new], camera), truth)
            gap = row["known"] - row["left_out"]
            yield {"scenes": len(scenes), "scene": file.stem, **row, "alone": alone, "gap": gap}


def decibels(snapshot: tmca.Snapshot[Any], prior: Any, truth: Any) -> float:
    """PSNR of the LMMSE."""
    estimate = tmca.reconstruct(snapshot, "lmmse", prior=prior).values.clamp(0, 1)
    return float(psnr(estimate, torch.from_numpy(truth.values.copy())[None]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--out", type=Path, default=Path("docs/results/transfer.json"))
    how = parser.parse_args()
    torch.set_num_threads(1)
    rows = list[dict[str, Any]]()
    for row in measured(how.data):
        rows.append(row)
        print(row, flush=True)
    rows.sort(key=lambda row: row["scenes"])
    text = HEAD.format(commit=repository_commit(), bands=BANDS, rows=FRAME[0], columns=FRAME[1], three=", ".join(THREE))
    text += table(pooled(rows, BY, MEANS), COLUMNS) + "\n## Scene by scene\n\n"
    write_results({"rows": rows}, text + table(rows, [COLUMNS[0], Column("scene"), *COLUMNS[1:]]), how.out, True)


if __name__ == "__main__":
    main()
