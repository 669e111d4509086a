"""The page of `tmca compare spectral`: codes and noises, what learning gains, expected against measured error."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tmca.applications.spectral import METRICS
from tmca.data import read_dataset
from tmca.data.scenes import load_scene
from tmca.evaluation.grid import Measured
from tmca.evaluation.scenes import read_once
from tmca.evaluation.study import Study
from tmca.evaluation.tables import Row, Split, grouped, markdown_table, repository_commit, rows_of, training_rows
from tmca.plots.cube import bands, composites, signatures
from tmca.plots.style import save_figure

STATIC, MULTIPLEXED, FREE = "CASSI learned", "TMCA learned K = 8", "TMCA learned K = 8, from random"
RANDOM = ("CASSI random", "TMCA random K = 8")
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


def results(study: Study, measured: Sequence[Measured], split: Split, command: Sequence[str]) -> Row:
    """What the JSON file holds: rows, trainings, expected errors."""
    cells = [cell for cell in measured if "metrics" in cell]
    labels = study.decoder_labels
    training = [
        {**{name: one[name] for name in ("code", "seed", "steps", "cpu_seconds")}, "decoder": labels[one["decoder"]],
         "validation_psnr": one["best"]["psnr"]}
        for one in training_rows(study, measured)
    ]  # fmt: skip
    groups = grouped(cells, "code", "noise", "decoder")
    rows = []
    for row in rows_of(study, measured):
        seeds = {cell["seed"] for cell in groups[row["code"], row["noise"], row["decoder"]]}
        trained = row["decoder"] in study.networks
        rows.append({**row, "decoder": labels[row["decoder"]], "trained": trained, "seeds": len(seeds)})
    return {
        "command": " ".join(command),
        "commit": repository_commit(),
        "split": {part: listed(names) for part, names in vars(study.scenes).items()},
        "budget": {
            "training": training or "none: priors in closed form",
            "decoding_seconds": sum(cell["seconds"] for cell in cells),
        },
        "rows": rows,
        "expected_error": [
            {"code": cell["code"], "noise": cell["noise"], **cell["expected"]}
            for cell in measured
            if "expected" in cell
        ],
    }


def markdown(found: Row, study: Study | None = None) -> str:
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


def _table(rows: Sequence[Row], trained: bool) -> str:
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


def _learned(rows: Sequence[Row]) -> list[str]:
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


def _expected(rows: Sequence[Row]) -> list[str]:
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


def _ranking(rows: Sequence[Row]) -> list[str]:
    """Whether the prediction puts the codes into the order that they have on the test scenes, noise by noise."""
    said = ["The order of the codes, best first, as predicted and on patches of the test scenes:", ""]
    for noise in dict.fromkeys(row["noise"] for row in rows):
        mine = [row for row in rows if row["noise"] == noise]
        orders = [[row["code"] for row in sorted(mine, key=lambda row: -row[key])] for key in ("predicted", "test")]
        agree = "the same" if orders[0] == orders[1] else f"not the same: {', '.join(orders[1])} on the test scenes"
        said.append(f"- {noise}: {', '.join(orders[0])}; {agree}.")
    return said


def listed(names: Sequence[str]) -> list[str]:
    """Scenes, as the lines of split files name them."""
    found = []
    for name in names:
        lines = Path(name).read_text(encoding="utf-8").splitlines() if name.endswith(".txt") else [name]
        found += [line.split()[-1] for line in lines if line.strip() and not line.startswith("#")]
    return found


def picture_files(study: Study, scenes: Sequence[str], out: Path) -> list[Path]:
    """The pictures of scenes: composites, spectra, bands of each."""
    return [out / f"{study.name}_{scene}_{kind}.png" for scene in scenes for kind in ("composites", "spectra", "bands")]


def pictures(study: Study, measured: Sequence[Measured], out: Path, overwrite: bool) -> list[Path]:
    """The thesis' figures 20 to 22 for every scene with estimates: composites, spectra and bands of some rows."""
    files = []
    cells = [cell for cell in measured if cell.get("estimate")]
    for (scene,), own in grouped(cells, "scene").items():
        truth = read_once(load_scene, own[0]["source"], bands=study.reading["bands"])
        found = {(c["code"], c["decoder"]): read_dataset(c["estimate"], ("estimate",))["estimate"].values for c in own}
        labels, names = study.decoder_labels, [row for row in study.shown or () if row in found]
        estimates = {f"{code}\n{labels[decoder]}": found[code, decoder] for code, decoder in names}
        wavelengths = truth["wavelength"].values.tolist()
        drawn = (
            composites(truth.values, estimates, wavelengths, study.shown_noise or ""),
            signatures(truth.values, estimates, wavelengths),
            bands(truth.values, estimates, wavelengths),
        )
        for figure, file in zip(drawn, picture_files(study, [scene], out), strict=True):
            files.append(save_figure(figure, file, overwrite=overwrite, dpi=80))
    return files
