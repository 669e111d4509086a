"""The study of codes as Markdown and pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.experiments.figures import add_bar, grid, plain_axes, save_figure
from tmca.experiments.results import markdown_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLUMNS = (
    ("noise", "noise", ""),
    ("kind", "codes", ""),
    ("slots", "K", "d"),
    ("random_psnr", "random (dB)", ".2f"),
    ("psnr", "designed (dB)", ".2f"),
    ("gain", "over static (dB)", "+.2f"),
    ("held_out", "over static, scenes left out (dB)", "+.2f"),
    ("spread", "±", ".2f"),
    ("throughput", "light", ".1%"),
    ("seconds", "CPU s", ".0f"),
)


def files_of(out: Path) -> list[Path]:
    """Pictures of a study."""
    return [out / "codes_read_noise.png", out / "codes_full_well.png"]


def study_markdown(found: dict[str, Any]) -> str:
    """The study for people."""
    split = found["split"]
    effort = ", ".join(f"{name} {value}" for name, value in found["effort"].items())
    lines = [
        "# Codes that win: static against time-multiplexed, random against designed", "",
        f"Command: `{found['command']}` at commit `{found['commit']}`.", "",
        f"Designed for {', '.join(split['train'])}; tile of {found['period'][0]}×{found['period'][1]} pixels; the same "
        f"effort for all ({effort}). PSNR is the expected one of the best linear estimate, block by block; on "
        "scenes left out each training scene is estimated under the prior of the others. Free codes start from random, "
        "static and one-hot ones and are never below any of them in what they are optimised for.", "",
        "## At equal exposure time", "", markdown_table(_rows(found, 1), _COLUMNS),
        "## Per slot", "",
        "Every slot has the whole exposure time; the static code is given the time of all K slots as well.", "",
    ]  # fmt: skip
    for times in sorted({row["exposures"] for row in found["grid"]} - {1}):
        lines += [markdown_table(_rows(found, times), _COLUMNS)]
    if found["test"]:
        lines += ["## On test scenes", "", "Whole images by the patch LMMSE, means over scenes and seeds.", ""]
        lines += [markdown_table(test_rows(found["test"]), _TEST_COLUMNS)]
    if found["ranking"]:
        lines += ["## The order of codes", "", "Spearman's rank correlation of the expected PSNR with the mean PSNR on "
                  "the middle of the test scenes, and the codes themselves.", ""]  # fmt: skip
        lines += [
            markdown_table(found["rank_correlation"], _RANK_COLUMNS),
            markdown_table(_ranked(found), _CODE_COLUMNS),
        ]
    return "\n".join(lines)


_TEST_COLUMNS = (
    ("noise", "noise", ""),
    ("codes", "codes", ""),
    ("psnr", "PSNR (dB)", ".2f"),
    ("gain", "over static designed (dB)", "+.2f"),
    ("expected", "expected gain (dB)", "+.2f"),
    ("scenes", "scene by scene", ""),
    ("throughput", "light", ".1%"),
)


_RANK_COLUMNS = (
    ("noise", "noise", ""),
    ("decoder", "decoder", ""),
    ("codes", "codes", "d"),
    ("rank_correlation", "rank correlation", ".2f"),
)
_CODE_COLUMNS = (
    ("noise", "noise", ""),
    ("codes", "codes", ""),
    ("throughput", "light", ".1%"),
    ("expected", "expected (dB)", ".2f"),
    ("lmmse", "LMMSE (dB)", ".2f"),
    ("unrolled", "unrolled (dB)", ".2f"),
)


def _ranked(found: dict[str, Any]) -> list[dict[str, Any]]:
    """Ranked codes with means over the test scenes, best expected first."""
    means = [
        {**row, **{d: float(np.mean(list(row[d].values()))) for d in ("lmmse", "unrolled") if d in row}}
        for row in found["ranking"]
    ]
    return sorted(means, key=lambda row: (row["noise"], -row["expected"]))


def test_rows(cells: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Means over scenes and seeds of every kind of codes, with the gain over the designed static ones."""
    rows = []
    for noise in dict.fromkeys(cell["noise"] for cell in cells):
        own = [cell for cell in cells if cell["noise"] == noise]
        for codes in own[0]["metrics"]:
            values = [cell["metrics"][codes] for cell in own]
            base = [cell["metrics"]["static, designed"] for cell in own]
            psnr, static = (float(np.mean([v["psnr"] for v in part])) for part in (values, base))
            ahead = [v["expected_psnr"] - b["expected_psnr"] for v, b in zip(values, base, strict=True)]
            scenes = {c["scene"]: [o["metrics"][codes]["psnr"] for o in own if o["scene"] == c["scene"]] for c in own}
            said = ", ".join(f"{name} {np.mean(psnrs):.2f}" for name, psnrs in scenes.items())
            light = float(np.mean([v["throughput"] for v in values]))
            row = {"noise": noise, "codes": codes, "psnr": psnr, "gain": psnr - static, "scenes": said}
            rows.append({**row, "expected": float(np.mean(ahead)), "throughput": light})
    return rows


def _rows(found: dict[str, Any], exposures: int) -> list[dict[str, Any]]:
    rows = []
    for row in found["grid"]:
        if row["exposures"] == exposures:
            gains = list(row["held_out_gains"].values())
            rows.append({**row, "held_out": float(np.mean(gains)), "spread": float(np.std(gains, ddof=1))})
    return rows


def study_figures(found: dict[str, Any], out: Path, *, overwrite: bool = False) -> list[Path]:
    """Maps of the gain over (K, read noise) and (K, full well)."""
    noises = list(dict.fromkeys(row["noise"] for row in found["grid"]))
    parts = [[n for n in noises if n.startswith("σ")], [n for n in noises if not n.startswith("σ")]]
    labels = ("read noise, snapshot units", "full well, read noise")
    return [
        save_figure(gain_maps(_rows(found, 1), part, label), file, overwrite=overwrite)
        for part, label, file in zip(parts, labels, files_of(out), strict=True)
    ]


def gain_maps(rows: Sequence[dict[str, Any]], noises: Sequence[str], label: str) -> Figure:
    """Gain over the static design of one-hot and free codes: expected, and on scenes left out."""
    slots = sorted({row["slots"] for row in rows if row["slots"] > 1})
    noises = [noise for noise in noises if any(row["noise"] == noise for row in rows)]
    figure, axes = grid(2, 2, width=4.6, aspect=0.75)
    top = max((abs(row[key]) for row in rows for key in ("gain", "held_out")), default=1.0) or 1.0
    for line, (key, meaning) in zip(axes, (("gain", "expected"), ("held_out", "scenes left out")), strict=True):
        for axis, kind in zip(line, ("one-hot", "free"), strict=True):
            known = {(row["noise"], row["slots"]): row[key] for row in rows if row["kind"] == kind}
            values = np.array([[known.get((noise, k), np.nan) for k in slots] for noise in noises])
            shown = axis.imshow(values, cmap="RdBu", vmin=-top, vmax=top, aspect="auto")
            for (y, x), value in np.ndenumerate(values):
                axis.text(x, y, f"{value:+.1f}", ha="center", va="center", fontsize=8)
            axis.set_xticks(range(len(slots)), [str(k) for k in slots])
            axis.set_yticks(range(len(noises)), [noise.removeprefix("σ = ") for noise in noises])
            plain_axes(axis, f"{kind}, {meaning}", "slots K", label)
            add_bar(axis, shown, "gain over static (dB)")
    return figure
