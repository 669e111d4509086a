"""The table of the spectral camera: codes × noises × decoders over test scenes, in cells that are computed once."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from tmca.errors import OutputError, SettingError
from tmca.experiments.cells import Measured, Settings, run_cells, source_digest
from tmca.experiments.results import METRICS, markdown_table, mean_over_scenes, repository_commit

CODES: dict[str, dict[str, Any]] = {
    "CASSI random": {"slots": 1, "aperture": "random", "shutter": "open"},
    "TMCA random K = 8": {"slots": 8, "aperture": "random", "shutter": "random"},
    "TMCA one-hot K = 4": {"slots": 4, "aperture": "random", "shutter": "one-hot"},
}
NOISES: dict[str, dict[str, Any]] = {
    "noise-free": {},
    "σ = 0.01": {"read_noise": 0.01},
    "10 000 e⁻ full well, 3 e⁻ read noise": {"full_well": 10_000, "read_noise_electrons": 3},
}
DECODER_NAMES = {"lmmse": "LMMSE", "mixture": "mixture", "admm-tv": "ADMM-TV", "admm-tv-joint": "ADMM-TV joint"}

Told = Callable[[int, int, str, float], None]


def compare_spectral(
    train: Path,
    test: Path,
    out: Path,
    work: Path,
    *,
    bands: int = 12,
    decoders: Sequence[str] = ("lmmse", "mixture", "admm-tv"),
    seed: int = 0,
    patches: int = 24_000,
    jobs: int = 1,
    overwrite: bool = False,
    progress: Told | None = None,
    command: Sequence[str] = (),
) -> dict[str, Any]:
    """Measure every code, noise and decoder on the scenes of ``test`` with priors learned from those of ``train``.

    Args:
        train: split file of the prior's scenes.
        test: split file of the measured scenes.
        out: folder of ``spectral.md`` and ``spectral.json``.
        work: folder of priors and finished cells; a stopped run goes on there.
        bands: number of bands from 400 to 700 nm.
        decoders: names of ``DECODER_NAMES``.
        seed: of codes and noise.
        patches: on which the expected error is checked, for each code and noise.
        jobs: processes side by side.
        overwrite: replace the two result files.
        progress: told (done, all, name, seconds left) after each cell.
        command: how the run was called, kept in the results.

    Raises:
        SettingError: unknown decoder.
        OutputError: the results exist.
        DataError: a scene of a split is missing or altered.
    """
    from tmca.data import make_folder, read_split, write_json, write_text

    unknown = [name for name in decoders if name not in DECODER_NAMES]
    if unknown:
        raise SettingError("--decoders", ", ".join(unknown), f"some of {', '.join(DECODER_NAMES)}")
    files = [out / "spectral.json", out / "spectral.md"]
    for file in files:
        if file.exists() and not overwrite:
            raise OutputError(file, "a file of earlier results", "none", "pass --overwrite or another --out")
    examples, scenes = read_split(train), read_split(test)
    make_folder(out)
    make_folder(work)
    priors = _learn(examples, work, bands, decoders)
    cells = _cells(scenes, priors, bands, decoders, seed)
    if "lmmse" in priors:
        cells += _expectations(examples, scenes, priors["lmmse"], bands, seed, patches)
    measured = run_cells(cells, measure, work, jobs=jobs, progress=_timed(progress))
    results = _results(measured, train, test, command)
    write_json(results, files[0], overwrite=overwrite)
    write_text(_markdown(results), files[1], overwrite=overwrite)
    return results


def measure(cell: Settings) -> Measured:
    """One cell: take the snapshot, reconstruct it, measure; or compare the expected error with patches."""
    if "decoder" not in cell:
        return _expected(cell)
    from tmca.cameras import SpectralCamera
    from tmca.experiments.scenes import load_scene
    from tmca.experiments.spectral import reconstruct_snapshot, take_snapshot
    from tmca.sensor import Sensor

    scene = load_scene(cell["path"], bands=cell["bands"])
    camera = SpectralCamera(
        bands=scene["wavelength"].values.tolist(),
        size=(scene.sizes["y"], scene.sizes["x"]),
        sensor=Sensor(**NOISES[cell["noise"]]),
        seed=cell["seed"],
        **CODES[cell["code"]],
    )
    snapshot = take_snapshot(scene, camera, seed=cell["seed"])
    result = reconstruct_snapshot(snapshot, cell["decoder"], prior=cell["prior"], truth=scene)
    return {"metrics": result.metrics, "seconds": result.seconds, "throughput": camera.throughput()}


def _expected(cell: Settings) -> Measured:
    """Predicted PSNR of a code beside the PSNR on patches of the training and of the test scenes."""
    import torch

    from tmca.cameras import SpectralCamera
    from tmca.experiments.expected import predicted_and_measured
    from tmca.experiments.scenes import load_scene
    from tmca.priors import GaussianPrior
    from tmca.sensor import Sensor

    prior = GaussianPrior.load(cell["prior"])
    camera = SpectralCamera(
        bands=prior.wavelengths or cell["bands"],
        size=(256, 256),
        sensor=Sensor(**NOISES[cell["noise"]]),
        seed=cell["seed"],
        **CODES[cell["code"]],
    )
    found = {}
    for split in ("train", "test"):
        cubes = [torch.from_numpy(load_scene(path, bands=cell["bands"]).values) for path in cell[split]]
        found["predicted"], found[split] = predicted_and_measured(
            prior, camera, cubes, count=cell["patches"], seed=cell["seed"]
        )
    return {"expected": found}


def _learn(scenes: Sequence[Path], work: Path, bands: int, decoders: Sequence[str]) -> dict[str, Path]:
    """Files of the priors that the decoders need, learned where they are not yet kept."""
    from tmca.data import checksum_of
    from tmca.experiments.cells import cell_key
    from tmca.experiments.scenes import load_scene
    from tmca.priors import learn_prior

    kept = {}
    for decoder in set(decoders) & {"lmmse", "mixture"}:
        identity: dict[str, Any] = {"decoder": decoder, "bands": bands, "source": source_digest()}
        identity["scenes"] = [checksum_of(s) for s in scenes]
        file = work / f"prior-{decoder}-{cell_key(identity)}.nc"
        if not file.exists():
            cubes = [load_scene(scene, bands=bands) for scene in scenes]
            learn_prior(cubes, spread=bands - 1, mixture=decoder == "mixture").save(file)
        kept[decoder] = file
    return kept


def _cells(
    scenes: Sequence[Path], priors: dict[str, Path], bands: int, decoders: Sequence[str], seed: int
) -> list[Settings]:
    from tmca.data import checksum_of

    return [
        {
            "name": f"{scene.stem} · {code} · {noise} · {DECODER_NAMES[decoder]}",
            "scene": scene.stem,
            "source": source_digest(),
            "path": str(scene),
            "checksum": checksum_of(scene),
            "prior": str(priors[decoder]) if decoder in priors else None,
            "code": code,
            "noise": noise,
            "decoder": decoder,
            "bands": bands,
            "seed": seed,
        }
        for decoder in decoders
        for noise in NOISES
        for code in CODES
        for scene in scenes
    ]


def _expectations(
    train: Sequence[Path], test: Sequence[Path], prior: Path, bands: int, seed: int, patches: int
) -> list[Settings]:
    return [
        {
            "name": f"expected error · {code} · {noise}",
            "source": source_digest(),
            "train": [str(path) for path in train],
            "test": [str(path) for path in test],
            "prior": str(prior),
            "code": code,
            "noise": noise,
            "bands": bands,
            "seed": seed,
            "patches": patches,
        }
        for noise in NOISES
        for code in CODES
    ]


def _results(measured: Sequence[Measured], train: Path, test: Path, command: Sequence[str]) -> dict[str, Any]:
    rows: dict[tuple[str, ...], dict[str, Any]] = {}
    for cell in (cell for cell in measured if "decoder" in cell):
        key = (cell["code"], cell["noise"], cell["decoder"])
        row = rows.setdefault(
            key,
            {
                "method": f"{cell['code']} + {DECODER_NAMES[cell['decoder']]}",
                "code": cell["code"],
                "decoder": DECODER_NAMES[cell["decoder"]],
                "exposure": "equal",
                "noise": cell["noise"],
                "throughput": cell["throughput"],
                "scenes": {},
                "seconds": 0.0,
            },
        )
        row["scenes"][cell["scene"]] = cell["metrics"]
        row["seconds"] += cell["seconds"]
    for row in rows.values():
        row |= mean_over_scenes(row["scenes"])
    return {
        "command": " ".join(command),
        "commit": repository_commit(),
        "split": {"train": _listed(train), "test": _listed(test)},
        "budget": {
            "training": "none: priors in closed form",
            "decoding_seconds": sum(r["seconds"] for r in rows.values()),
        },
        "rows": list(rows.values()),
        "expected_error": [
            {"code": cell["code"], "noise": cell["noise"], **cell["expected"]}
            for cell in measured
            if "expected" in cell
        ],
    }


def _markdown(results: dict[str, Any]) -> str:
    scenes = list(results["rows"][0]["scenes"])
    lines = [
        "# Spectral camera: static and time-multiplexed codes without training",
        "",
        f"Command: `{results['command']}` at commit `{results['commit']}`.",
        "",
        f"Prior learned from {', '.join(results['split']['train'])}.",
        f"Measured on {', '.join(results['split']['test'])}, "
        "full images. Equal exposure time in all rows. Means over scenes, then PSNR scene by scene.",
        "",
    ]
    columns = [("code", "code", ""), ("decoder", "decoder", ""), *METRICS]
    columns += [(f"psnr {scene}", f"PSNR {scene}", ".2f") for scene in scenes]
    columns += [("throughput", "light", ".1%"), ("seconds", "seconds", ".0f")]
    for noise in dict.fromkeys(row["noise"] for row in results["rows"]):
        rows = [
            {**row, **{f"psnr {scene}": values["psnr"] for scene, values in row["scenes"].items()}}
            for row in results["rows"]
            if row["noise"] == noise
        ]
        lines += [f"## {noise}", "", markdown_table(rows, columns)]
    if results["expected_error"]:
        columns = [("code", "code", ""), ("noise", "noise", ""), ("predicted", "predicted (dB)", ".2f")]
        columns += [("train", "on patches of training scenes", ".2f"), ("test", "on patches of test scenes", ".2f")]
        lines += [
            "## Expected error against measured error",
            "",
            "PSNR of single blocks under the Gaussian prior: predicted before anything is captured, and measured on",
            "thousands of patches. Overlapping blocks, blended, do better than single ones.",
            "",
            markdown_table(results["expected_error"], columns),
        ]
    return "\n".join(lines)


def _listed(split: Path) -> list[str]:
    return [line.split()[-1] for line in split.read_text().splitlines() if line.strip() and not line.startswith("#")]


def _timed(told: Told | None) -> Callable[[int, int, str], None] | None:
    """Turn (done, all, name) into (done, all, name, seconds left)."""
    if told is None:
        return None
    start, first = time.monotonic(), [0]

    def report(done: int, total: int, name: str) -> None:
        first[0] = first[0] or done - 1 or 0
        fresh = done - first[0]
        told(done, total, name, (time.monotonic() - start) / max(fresh, 1) * (total - done))

    return report
