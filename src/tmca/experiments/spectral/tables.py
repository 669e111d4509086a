"""The spectral table as JSON rows and as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tmca.experiments.cells import Measured
from tmca.experiments.results import METRICS, markdown_table, mean_over_scenes, repository_commit
from tmca.experiments.spectral.rows import CODES, DECODER_NAMES, FREE, LEARNED, MULTIPLEXED, NETWORKS, STATIC

RANDOM = tuple(CODES)[:2]
"""Random codes of the static and of the time-multiplexed camera."""

_LEARNING = (
    "Networks learned from patches of the same scenes and, less often, of the rendered training scenes, one "
    "for all three noises, in the CPU minutes of the last column (one core), half precision (bfloat16) "
    "where the processor computes it. "
    f"{MULTIPLEXED} starts at the codes and the decoder of {STATIC}, whose minutes come on top; "
    f"{FREE}, at random codes. Rows of learned codes without a network reconstruct from the codes that were "
    "learned with the unrolled network, in its minutes. The U-Net from Φᵀy is not told the codes; it learned "
    "from windows of them, and full-frame random codes of the scenes' sizes are other draws. Means over seeds."
)


def results(
    measured: Sequence[Measured], train: Path, test: Path, command: Sequence[str], validation: Path | None = None
) -> dict[str, Any]:
    """Rows of the table from measured cells: means over scenes of the means over seeds."""
    cells = [cell for cell in measured if "metrics" in cell]
    training = [_training(cell) for cell in measured if "best" in cell]
    groups: dict[tuple[str, ...], list[Measured]] = {}
    for cell in cells:
        groups.setdefault((cell["code"], cell["noise"], cell["decoder"]), []).append(cell)
    held_out = listed(validation) if validation else []
    seconds = sum(cell["seconds"] for cell in cells)
    return {
        "command": " ".join(command),
        "commit": repository_commit(),
        "split": {"train": listed(train), "test": listed(test), "validation": held_out},
        "budget": {"training": training or "none: priors in closed form", "decoding_seconds": seconds},
        "rows": [_row(own, training) for own in groups.values()],
        "expected_error": [
            {"code": cell["code"], "noise": cell["noise"], **cell["expected"]}
            for cell in measured
            if "expected" in cell
        ],
    }


def _row(cells: Sequence[Measured], training: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """One code, noise and decoder, from its scenes and seeds."""
    cell, runs = cells[0], _runs(cells)
    decoder, trained = DECODER_NAMES[cell["decoder"]], cell["decoder"] in NETWORKS
    scenes = {scene: mean_over_scenes({str(i): m for i, m in enumerate(own)}) for scene, own in runs.items()}
    return {
        "method": f"{cell['code']} + {decoder}", "code": cell["code"], "decoder": decoder, "trained": trained,
        "exposure": "equal", "noise": cell["noise"],
        "seconds": sum(one["seconds"] for one in cells) / len(cells),
        "throughput": sum(one["throughput"] for one in cells) / len(cells),
        "seeds": max(len(own) for own in runs.values()),
        "scenes": scenes, **mean_over_scenes(scenes),
        "seed_psnr": [sum(m["psnr"] for m in seed) / len(seed) for seed in zip(*runs.values(), strict=False)],
        "training_cpu_minutes": _spent(cell["code"], decoder, trained, training),
    }  # fmt: skip


def _runs(cells: Sequence[Measured]) -> dict[str, list[dict[str, float]]]:
    """Metrics of every scene, seed by seed."""
    found: dict[str, list[dict[str, float]]] = {}
    for cell in cells:
        found.setdefault(cell["scene"], []).append(cell["metrics"])
    return found


def _spent(code: str, decoder: str, trained: bool, training: Sequence[dict[str, Any]]) -> float:
    """CPU minutes of learning, mean over seeds; learned codes of other decoders are those of the unrolled network."""
    learner = decoder if trained else DECODER_NAMES["unrolled"]
    spent = [one["cpu_seconds"] for one in training if (one["code"], one["decoder"]) == (code, learner)]
    return sum(spent) / len(spent) / 60 if spent and (trained or code in LEARNED) else 0.0


def _training(cell: Measured) -> dict[str, Any]:
    return {
        "code": cell["code"],
        "decoder": DECODER_NAMES[cell["decoder"]],
        "seed": cell["seed"],
        "steps": cell["training"]["optimiser"]["steps"],
        "cpu_seconds": cell["seconds"],
        "validation_psnr": cell["best"]["psnr"],
    }


def markdown(found: dict[str, Any]) -> str:
    """The results for people."""
    rows = found["rows"]
    trained = any(row["trained"] for row in rows)
    lines = [
        "# Spectral camera: static and time-multiplexed codes" + ("" if trained else " without training"),
        "",
        f"Command: `{found['command']}` at commit `{found['commit']}`.",
        "",
        f"Prior learned from {', '.join(found['split']['train'])}.",
        f"Measured on {', '.join(found['split']['test'])}, "
        "full images. Equal exposure time in all rows. Means over scenes, then PSNR scene by scene.",
        "",
        *([_LEARNING, ""] if trained else []),
    ]
    for noise in dict.fromkeys(row["noise"] for row in rows):
        lines += [f"## {noise}", "", _table([row for row in rows if row["noise"] == noise], trained)]
    lines += _learned(rows) if any(row["code"] == STATIC for row in rows) else []
    return "\n".join(lines + (_expected(found["expected_error"]) if found["expected_error"] else []))


def _table(rows: Sequence[dict[str, Any]], trained: bool) -> str:
    """Rows of one noise."""
    columns = [("code", "code", ""), ("decoder", "decoder", ""), *METRICS]
    columns += [(f"psnr {scene}", f"PSNR {scene}", ".2f") for scene in rows[0]["scenes"]]
    columns += [("throughput", "light", ".1%"), ("seconds", "seconds a scene", ".0f")]
    if trained:
        columns += [("seeds", "PSNR seed by seed", ""), ("training_cpu_minutes", "training (min)", ".1f")]
    shown = [
        {**row, **{f"psnr {scene}": values["psnr"] for scene, values in row["scenes"].items()},
         "seeds": ", ".join(format(psnr, ".2f") for psnr in row["seed_psnr"])}
        for row in rows
    ]  # fmt: skip
    return markdown_table(shown, columns)


def _learned(rows: Sequence[dict[str, Any]]) -> list[str]:
    """What learning codes gains with the same decoder, and time multiplexing over the static camera it starts from."""
    known = {(row["noise"], row["decoder"], row["code"]): row for row in rows}
    said = []
    for code, base in ((STATIC, RANDOM[0]), (FREE, RANDOM[1]), (MULTIPLEXED, STATIC)):
        for (noise, decoder, name), row in known.items():
            other = known.get((noise, decoder, base))
            if name == code and other is not None:
                gains = {
                    scene: row["scenes"][scene]["psnr"] - other["scenes"][scene]["psnr"] for scene in row["scenes"]
                }
                pairs = list(zip(row["seed_psnr"], other["seed_psnr"], strict=False))
                said.append({
                    "code": code, "base": base, "decoder": decoder, "noise": noise, "gain": row["psnr"] - other["psnr"],
                    "seeds": ", ".join(f"{one - before:+.2f}" for one, before in pairs),
                    "scenes": ", ".join(f"{scene} {gain:+.2f}" for scene, gain in gains.items()),
                })  # fmt: skip
    columns = [("code", "codes", ""), ("base", "over", ""), ("decoder", "decoder", ""), ("noise", "noise", "")]
    columns += [("gain", "gain (dB)", "+.2f"), ("seeds", "seed by seed", ""), ("scenes", "scene by scene", "")]
    return ["## What learning codes gains", "", "With the same decoder.", "", markdown_table(said, columns)]


def _expected(rows: Sequence[dict[str, Any]]) -> list[str]:
    columns = [("code", "code", ""), ("noise", "noise", ""), ("predicted", "predicted (dB)", ".2f")]
    columns += [("train", "on patches of training scenes", ".2f"), ("test", "on patches of test scenes", ".2f")]
    return [
        "## Expected error against measured error",
        "",
        "PSNR of single blocks under the Gaussian prior: predicted before anything is captured, and measured on",
        "thousands of patches. Overlapping blocks, blended, do better than single ones.",
        "",
        markdown_table(rows, columns),
        "",
        *_ranking(rows),
    ]


def _ranking(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Whether the prediction puts the codes into the order that they have on the test scenes, noise by noise."""
    said = ["The order of the codes, best first, as predicted and on patches of the test scenes:", ""]
    for noise in dict.fromkeys(row["noise"] for row in rows):
        mine = [row for row in rows if row["noise"] == noise]
        orders = [[row["code"] for row in sorted(mine, key=lambda row: -row[key])] for key in ("predicted", "test")]
        agree = "the same" if orders[0] == orders[1] else f"not the same: {', '.join(orders[1])} on the test scenes"
        said.append(f"- {noise}: {', '.join(orders[0])}; {agree}.")
    return said


def listed(split: Path) -> list[str]:
    """Paths that a split names."""
    return [line.split()[-1] for line in split.read_text().splitlines() if line.strip() and not line.startswith("#")]
