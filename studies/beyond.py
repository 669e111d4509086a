"""What bands lose that lie beyond the wavelengths of a prior of any bands: ``python -m studies.beyond DATA``.

The outermost 10, 20 and 30 nm on both sides are withheld from priors of sixteen scenes, which then decode snapshots of
five others (`cave_test`) whose bands go that far. Samson, an airborne scene of 401 to 889 nm, is decoded up to 730 nm
by what comes with the package. Written: ``beyond.json`` and the page ``beyond.md``.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

import tmca
from studies.grid import repository_commit
from studies.shipped.pool import KNOTS
from studies.shipped.presets import RANK
from studies.tables import Column, pooled, table, write_results
from tmca.data import read, read_split
from tmca.decoders import Weights
from tmca.metrics import psnr
from tmca.priors import BandsBeyond, SubspacePrior, interpolation

FRAME, BLOCK, FARTHEST = (128, 160), (12, 48), 30
BANDS = 1e-9 * np.array([400, 410, 420, 430, 460, 490, 520, 550, 580, 610, 640, 670, 680, 690, 700])
CODES: dict[str, dict[str, Any]] = {
    "static": {"slots": 1, "shutter": "open"},
    "K = 8": {"slots": 8, "shutter": "random"},
}
HOW: dict[str, Any] = {"aperture": "random", "period": 32, "seed": 1, "sensor": tmca.Sensor(read_noise=0.01)}
RED = 1e-9 * np.arange(520, 731, 15)
COLUMNS = [
    Column("codes"),
    Column("decoder"),
    Column("withheld", "withheld, nm", ".0f"),
    Column("all", "all bands, dB", ".2f"),
    Column("beyond", "bands beyond, dB", ".2f"),
    Column("inside", "other bands, dB", ".2f"),
    Column("loss", "loss of bands beyond, dB", ".2f"),
]
BY, MEANS = ("codes", "decoder", "withheld"), ("all", "beyond", "inside", "loss")
"""Names of which the page has a row each, and of figures that are means over the scenes."""
HEAD = """# What bands lose beyond the learned wavelengths

A prior of any bands (`tmca prior learn --any-bands`, `universal`) knows the wavelengths of its scenes, often 400 to 700
nm. Bands up to 30 nm beyond are decoded, too, with a warning: such a band is expected to differ from the outermost
known one as much as the band that lies as far inside, but independently. This page says what that costs.

Made by `python -m studies.beyond DATA` at commit `{commit}`. 15 bands from 400 to 700 nm, tiled random codes, σ = 0.01,
the middle {rows}×{columns} pixels of the five scenes of `cave_test`, means over the scenes; patch LMMSE under priors of
the sixteen of `cave_train`, from which the outermost nanometres on *both* sides were withheld. The *bands beyond* are
those that the prior did not learn; their loss is against the prior from which nothing was withheld.

"""
FINDINGS = """
Bands beyond lose 0.7 to 1.5 dB on average, 3.0 dB at most, and the others 0.2 to 0.6 dB. ADMM-TV, which needs no prior,
is 3 to 4 dB below in bands beyond.
"""
SAMSON = """
## A scene of another kind

Samson is an airborne scene, 95×95 pixels from 401 to 889 nm: soil, trees, water. Plants get bright beyond 700 nm, which
no band inside foretells. 15 bands from 520 to 730 nm, the same codes, by the prior and the network of `universal`,
which know 400 to 700 nm. *Bands beyond* are 715 and 730 nm. What it would give to know these cannot be said: no other
scene at hand goes there. The network leaves bands beyond as the prior has them.

"""


def cut(cube: Tensor) -> Tensor:
    """The middle of a cube (L, H, W)."""
    top, left = ((there - most) // 2 for there, most in zip(cube.shape[1:], FRAME, strict=True))
    return cube[:, top : top + FRAME[0], left : left + FRAME[1]]


def cubes(data: Path, split: str) -> dict[str, Tensor]:
    """Scenes (31, H, W) by name."""
    files = map(Path, read_split(data / "splits" / f"cave_{split}.txt"))
    return {file.stem: torch.from_numpy(read(file, wavelengths=KNOTS).values.astype(np.float64)) for file in files}


def measured(data: Path) -> Iterator[dict[str, Any]]:
    """Rows of all codes, decoders and scenes."""
    train, tests = list(cubes(data, "train").values()), cubes(data, "test")
    known = dict[int, SubspacePrior]()
    for nanometres in range(0, FARTHEST + 1, 10):
        part = slice(nanometres // 10, len(KNOTS) - nanometres // 10)
        settings: dict[str, Any] = {"rank": RANK, "wavelengths": KNOTS[part].tolist()}
        known[nanometres] = SubspacePrior.learn([cube[part] for cube in train], BLOCK, **settings)
    between = interpolation(BANDS.tolist(), torch.from_numpy(KNOTS))
    for codes, settings in CODES.items():
        camera = tmca.SpectralCamera(BANDS.tolist(), FRAME, **settings, **HOW)
        for name, cube in tests.items():
            scene = torch.einsum("lk,khw->lhw", between, cut(cube)).float()
            snapshot = tmca.Snapshot(camera(scene[None], generator=3), camera)
            full = decoded(snapshot, "lmmse", prior=known[0])
            total = decoded(snapshot, "admm-tv")
            for nanometres in range(10, FARTHEST + 1, 10):
                about = {"codes": codes, "scene": name, "withheld": nanometres}
                ends = KNOTS[[nanometres // 10, -1 - nanometres // 10]]
                some = {"lmmse, all known": full, "lmmse": decoded(snapshot, "lmmse", prior=known[nanometres])}
                rows = {key: figures(values, scene, BANDS, ends) for key, values in {**some, "admm-tv": total}.items()}
                for key, row in rows.items():
                    yield {**about, "decoder": key, **row, "loss": rows["lmmse, all known"]["beyond"] - row["beyond"]}


def red(data: Path) -> Iterator[dict[str, Any]]:
    """Rows of Samson."""
    cube = read(data / "hsi/samson/Samson.mat", wavelengths=np.linspace(401e-9, 889e-9, 156))
    scene = torch.from_numpy(cube.interp(wavelength=RED).values.astype(np.float32))
    scene = (scene / scene.max()).clamp(0, 1)
    prior = Weights.find("universal").path
    assert prior is not None
    for codes, settings in CODES.items():
        camera = tmca.SpectralCamera(RED.tolist(), (scene.shape[1], scene.shape[2]), **settings, **HOW)
        snapshot = tmca.Snapshot(camera(scene[None], generator=3), camera)
        of_universal = prior.with_name("universal-prior.nc")
        some: dict[str, dict[str, Any]] = {
            "lmmse": {"prior": of_universal},
            "network": {"weights": "universal"},
            "admm-tv": {},
        }
        for decoder, how in some.items():
            yield {
                "codes": codes,
                "decoder": decoder,
                **figures(decoded(snapshot, decoder, **how), scene, RED, KNOTS[[0, -1]]),
            }


def decoded(snapshot: Any, decoder: str, **how: Any) -> Tensor:
    """(L, H, W) the estimate, which the warning need not accompany here."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", BandsBeyond)
        return tmca.reconstruct(snapshot, decoder, progress=False, **how).values[0].clamp(0, 1)


def figures(estimate: Tensor, scene: Tensor, bands: Any, ends: Any) -> dict[str, float]:
    """PSNR over all bands, over those outside of the ends, and over the others."""
    beyond = torch.from_numpy((bands < ends[0] - 1e-12) | (bands > ends[1] + 1e-12))
    parts = {"all": beyond | True, "beyond": beyond, "inside": ~beyond}
    return {name: psnr(estimate[None, chosen], scene[None, chosen]) for name, chosen in parts.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--out", type=Path, default=Path("docs/results/beyond.json"))
    how = parser.parse_args()
    torch.set_num_threads(1)
    rows, airborne = list[dict[str, Any]](), list(red(how.data))
    print(table(airborne, [*COLUMNS[:2], *COLUMNS[3:6]]), flush=True)
    for row in measured(how.data):
        rows.append(row)
        print(row, flush=True)
    text = (
        HEAD.format(commit=repository_commit(), rows=FRAME[0], columns=FRAME[1])
        + table(pooled(rows, BY, MEANS), COLUMNS)
        + FINDINGS
    )
    text += SAMSON + table(airborne, [*COLUMNS[:2], *COLUMNS[3:6]]) + "\n## Scene by scene\n\n"
    scenes = table(rows, [Column("scene"), *COLUMNS])
    write_results({"rows": rows, "samson": airborne}, text + scenes, how.out, True)


if __name__ == "__main__":
    main()
