"""What the rows of the light-field table say beside each other: margins, decoder over decoder, the thesis' table 1."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import product
from math import isnan

import numpy as np

from tmca.evaluation.study import Study, read_study
from tmca.evaluation.tables import Row, markdown_table

FROM_FILES, DICTIONARY = "from files", "dictionary"
NETWORKS = ("sub-network", "consistent")
TABLE_1 = {
    "CLFP dictionary": (30.06, 0.82, "CLFP static random", (DICTIONARY,)),
    "CLFP deep": (32.43, 0.91, "CLFP static random", NETWORKS),
    "CLFP E2E": (33.21, 0.91, "CLFP E2E", NETWORKS),
    "TMCA random codes": (34.03, 0.93, "TMCA random K = 8", NETWORKS),
    "TMCA learned codes": (34.89, 0.94, "TMCA E2E K = 8", NETWORKS),
}
"""Row of the thesis: PSNR (dB), SSIM, and the codes and decoders that stand for it here."""


@cache
def shipped() -> Study:
    """The shipped study, whose names the page knows."""
    return read_study("light-field")


def labels() -> dict[str, str]:
    return shipped().decoder_labels


def is_static(code: str) -> bool:
    """Whether a row's codes do not change within the exposure."""
    return code.startswith("CLFP")


def margins(found: Row) -> list[Row]:
    """Time-multiplexed against static codes, noise by noise and decoder by decoder, on scenes from files and on
    rendered ones: the optimised ones of each, and the best ones of each in hindsight."""
    said = []
    for (decoder, noise), (part, scenes) in product(_groups(found["rows"]), parts(found).items()):
        rows = [r for r in found["rows"] if (r["decoder"], r["noise"]) == (decoder, noise)]
        static, own = ([r for r in rows if is_static(r["code"]) == kind] for kind in (True, False))
        if not (static and own and scenes):
            continue
        base, best = (max(group, key=lambda row: _level(row, scenes)) for group in (static, own))
        row = {"decoder": labels()[decoder], "noise": noise, "part": part, "static": base["code"]}
        row |= {"best": best["code"], "gain": _level(best, scenes) - _level(base, scenes)}
        row |= {"designed": _designed(rows, scenes)}
        row |= {"each": ", ".join(f"{n} {_level(best, [n]) - _level(base, [n]):+.2f}" for n in scenes)}
        for name in ("disparity_mae", "disparity_badpix", "agreement_mae"):
            row |= {name: _least(own, scenes, name), f"static_{name}": _least(static, scenes, name)}
        said.append(row)
    return said


def parts(found: Row) -> dict[str, list[str]]:
    """Scenes from files and rendered ones."""
    real, names = found["split"]["real"], found["split"]["test"]
    return {FROM_FILES: list(real), "rendered": [name for name in names if name not in real]}


def _level(row: Row, scenes: Sequence[str], name: str = "psnr") -> float:
    """Mean of a metric over the scenes that have it."""
    known = [row["scenes"][scene][name] for scene in scenes if name in row["scenes"].get(scene, ())]
    return float(np.mean(known)) if known else float("nan")


def _least(rows: Sequence[Row], scenes: Sequence[str], name: str) -> float | None:
    levels = [level for level in (_level(row, scenes, name) for row in rows) if not isnan(level)]
    return min(levels, default=None)


def _designed(rows: Sequence[Row], scenes: Sequence[str]) -> float | None:
    """Optimised time-multiplexed over optimised static codes, of the noise at hand where there are any."""
    known = {row["code"]: _level(row, scenes) for row in rows}
    for ending in (" for this noise", ""):
        static, own = (f"{name}{ending}" for name in ("CLFP optimised", "TMCA optimised K = 8"))
        if static in known and own in known:
            return known[own] - known[static]
    return None


def steps_between(found: Row) -> list[Row]:
    """PSNR of decoders one over the other, code by code, on scenes from files, on rendered ones and on the crop."""
    said = []
    for rows, better, worse in (
        ("rows", "consistent", "lmmse"), ("rows", "consistent", "sub-network"), ("rows", "mixture", "lmmse"),
        ("crop_rows", "lmmse", "dictionary"), ("crop_rows", "mixture", "dictionary"),
        ("crop_rows", "consistent", "dictionary"),
    ):  # fmt: skip
        for (part, scenes), noise in product(
            parts(found).items(), dict.fromkeys(row["noise"] for row in found["rows"])
        ):
            known = {(r["decoder"], r["code"]): _level(r, scenes) for r in found[rows] if r["noise"] == noise}
            gains = [known[better, code] - known[worse, code] for name, code in known
                     if name == better and (worse, code) in known]  # fmt: skip
            gains = [gain for gain in gains if not isnan(gain)]
            if gains:
                where = "crop" if rows == "crop_rows" else part
                said.append({"better": labels()[better], "worse": labels()[worse], "noise": noise,
                             "where": where, "least": min(gains), "most": max(gains),
                             "mean": float(np.mean(gains))})  # fmt: skip
    return said


def _groups(rows: Sequence[Row]) -> list[tuple[str, str]]:
    return list(dict.fromkeys((row["decoder"], row["noise"]) for row in rows))


def thesis_table(found: Row, scenes: Sequence[str]) -> list[str]:
    """The thesis' table 1 beside the same rows here, without noise.

    Args:
        found: the results.
        scenes: that count: those from files.
    """
    noise = next(iter(shipped().noises))
    crop, whole = (_levels(found[rows], noise, scenes) for rows in ("crop_rows", "rows"))
    said = []
    for name, (psnr, ssim, code, decoders) in TABLE_1.items():
        row: Row = {"row": name, "psnr": psnr, "ssim": ssim}
        row |= {decoder: (crop if decoder == DICTIONARY else whole).get((code, decoder)) for decoder in decoders}
        said.append(row)
    columns = [("row", "thesis, table 1", ""), ("psnr", "PSNR there (dB)", ".2f"), ("ssim", "SSIM there", ".2f")]
    shown = {DICTIONARY: "dictionary on the crop", **{name: labels()[name] for name in NETWORKS}}
    columns += [(name, f"here: {words}, dB / SSIM", "") for name, words in shown.items()]
    about = "Noise-free, scenes from files. The thesis trained for 500 epochs on 110 light fields that are not at hand "
    about += "here; differences between rows are what can be compared, and not between the crop and whole frames."
    return ["## The thesis' table 1", "", about, "", markdown_table(said, columns)]


def _levels(rows: Sequence[Row], noise: str, scenes: Sequence[str]) -> dict[tuple[str, str], str]:
    """PSNR and SSIM by code and decoder, means over scenes."""
    found = {}
    for row in rows:
        known = [row["scenes"][scene] for scene in scenes if scene in row["scenes"]]
        if row["noise"] == noise and known:
            psnr, ssim = (float(np.mean([own[name] for own in known])) for name in ("psnr", "ssim"))
            found[row["code"], row["decoder"]] = f"{psnr:.2f} / {ssim:.3f}"
    return found
