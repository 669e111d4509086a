"""Parts of the light-field page: the thesis' table 1 beside its own rows, decoders left out, pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tmca.experiments.light_field.comparison_figures import picture_files, slug
from tmca.experiments.light_field.rows import DECODER_NAMES, NETWORKS, NOISES, SHOWN, SHOWN_DECODERS, SHOWN_NOISE
from tmca.experiments.results import markdown_table

_DICTIONARY = "dictionary"
TABLE_1 = {
    "CLFP dictionary": (30.06, 0.82, "CLFP static random", (_DICTIONARY,)),
    "CLFP deep": (32.43, 0.91, "CLFP static random", tuple(NETWORKS)),
    "CLFP E2E": (33.21, 0.91, "CLFP E2E", tuple(NETWORKS)),
    "TMCA random codes": (34.03, 0.93, "TMCA random K = 8", tuple(NETWORKS)),
    "TMCA learned codes": (34.89, 0.94, "TMCA E2E K = 8", tuple(NETWORKS)),
}
"""Row of the thesis: PSNR (dB), SSIM, and the codes and decoders that stand for it here."""
_CAPTIONS = (
    "Views and epipolar pictures, with errors",
    "PSNR of every view",
    "Disparity that one estimator sees in the reconstructed views",
)


def thesis_table(found: dict[str, Any], scenes: Sequence[str]) -> list[str]:
    """The thesis' table 1 beside the same rows here, without noise.

    Args:
        found: the results.
        scenes: that count: those from files.
    """
    noise = next(iter(NOISES))
    crop, whole = (_levels(found[rows], noise, scenes) for rows in ("crop_rows", "rows"))
    said = []
    for name, (psnr, ssim, code, decoders) in TABLE_1.items():
        row: dict[str, Any] = {"row": name, "psnr": psnr, "ssim": ssim}
        row |= {decoder: (crop if decoder == _DICTIONARY else whole).get((code, decoder)) for decoder in decoders}
        said.append(row)
    columns = [("row", "thesis, table 1", ""), ("psnr", "PSNR there (dB)", ".2f"), ("ssim", "SSIM there", ".2f")]
    shown = {_DICTIONARY: "dictionary on the crop", **{name: DECODER_NAMES[name] for name in NETWORKS}}
    columns += [(name, f"here: {words}, dB / SSIM", "") for name, words in shown.items()]
    about = "Noise-free, scenes from files. The thesis trained for 500 epochs on 110 light fields that are not at hand "
    about += "here; differences between rows are what can be compared, and not between the crop and whole frames."
    return ["## The thesis' table 1", "", about, "", markdown_table(said, columns)]


def _levels(rows: Sequence[dict[str, Any]], noise: str, scenes: Sequence[str]) -> dict[tuple[str, str], str]:
    """PSNR and SSIM by code and decoder, means over scenes."""
    found = {}
    for row in rows:
        known = [row["scenes"][scene] for scene in scenes if scene in row["scenes"]]
        if row["noise"] == noise and known:
            psnr, ssim = (float(np.mean([own[name] for own in known])) for name in ("psnr", "ssim"))
            found[row["code"], row["decoder"]] = f"{psnr:.2f} / {ssim:.3f}"
    return found


def left_out(found: dict[str, Any]) -> list[str]:
    """A line that names decoders without rows."""
    measured = {row["decoder"] for row in (*found["rows"], *found["crop_rows"])}
    missing = [f"{words} (`{name}`)" for name, words in SHOWN_DECODERS.items() if name not in measured]
    return [f"Left out of this run (`--decoders`): {', '.join(missing)}.", ""] if missing else []


def pictures(found: dict[str, Any]) -> list[str]:
    """The pictures that lie beside the page, scene by scene."""
    kept = {(row["code"], row["decoder"]) for row in found["rows"] if row["noise"] == SHOWN_NOISE}
    if kept.isdisjoint(SHOWN):
        return []
    lines = ["## Pictures", "", f"Some rows, {SHOWN_NOISE}, first seed.", ""]
    for scene in found["split"]["test"]:
        files = picture_files([slug(scene)], Path())
        for caption, file in zip(_CAPTIONS, files, strict=True):
            lines += [f"{caption} ({scene}):", "", f"![{caption}, {scene}]({file.name})", ""]
    return lines
