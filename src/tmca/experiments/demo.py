"""The demonstration: rendered scenes through a static and a time-multiplexed camera and back, with a report."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.applications import simulate
from tmca.cameras import Snapshot, SpectralCamera
from tmca.decoders import find_weights
from tmca.errors import OutputError, TmcaError
from tmca.experiments.camera_figures import codes_figure, snapshot_figure
from tmca.experiments.light_field.demo import demo_light_field
from tmca.experiments.reconstructions import Reconstruction
from tmca.experiments.report import Section, write_report
from tmca.experiments.results import METRICS, mean_over_scenes
from tmca.experiments.spectral.imaging import reconstruct_snapshot
from tmca.experiments.spectral_depth.demo import demo_spectral_depth
from tmca.plots.cube import reconstruction_figure
from tmca.plots.style import save_figure
from tmca.sensor import Sensor

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

SCENES = ("motorcycle", "coffee")
CODES: dict[str, dict[str, Any]] = {
    "static (CASSI)": {"slots": 1, "aperture": "random", "shutter": "open"},
    "time-multiplexed, K = 8": {"slots": 8, "aperture": "random", "shutter": "random"},
    "one-hot shutter, K = 4": {"slots": 4, "aperture": "random", "shutter": "one-hot"},
    "static, learned": {"slots": 1, "weights": "default"},
    "K = 8, learned": {"slots": 8, "weights": "default"},
}
"""Random codes are decoded by the patch LMMSE, learned ones by the network that learned with them."""
READ_NOISE = 1e-3
BANDS, PERIOD = 12, 32
COLUMNS = (
    ("code", "code", ""),
    ("scene", "scene", ""),
    *METRICS,
    ("throughput", "light", ".1%"),
    ("seconds", "s", ".1f"),
)

Progress = Callable[[float, str], None]


def run_demo(
    out: Path, *, size: tuple[int, int] = (192, 256), overwrite: bool = False, progress: Progress | None = None
) -> dict[str, Any]:
    """Take and reconstruct snapshots of two rendered scenes that the prior was not learned from.

    Args:
        out: folder for snapshots, reconstructions, pictures and ``report.html``.
        size: (H, W) of the scenes, pixels; views of the light field and the scene with depth are two thirds of it.
        overwrite: replace earlier results in ``out``.
        progress: told (share done, what is next).

    Returns:
        ``rows`` of the table, ``light_field`` and ``spectral_depth`` rows, ``report`` file and ``seconds`` in all.

    Raises:
        OutputError: ``out`` holds results and ``overwrite`` is False.
    """
    from tmca.data import atomic_path, make_folder

    if (out / "report.html").exists() and not overwrite:
        raise OutputError(
            out / "report.html", "the report of an earlier demo", "none", "pass --overwrite or another --out"
        )
    start, told = time.perf_counter(), progress or (lambda share, next_: None)
    make_folder(out.parent)
    if out.exists():
        found = _demo(out, size, overwrite, told)
    else:
        with atomic_path(out) as folder:  # whole or not at all: an interrupted demo leaves nothing behind
            try:
                found = _demo(make_folder(folder), size, overwrite, told)
            except TmcaError as error:  # the folder that the user knows
                place = error.where.replace(str(folder), str(out))
                raise type(error)(place, error.found, error.expected, error.remedy) from error
    return {**found, "report": str(out / "report.html"), "seconds": time.perf_counter() - start}


def _demo(out: Path, size: tuple[int, int], overwrite: bool, told: Progress) -> dict[str, list[dict[str, Any]]]:
    """Everything that the demo writes, into a folder that exists; returns the rows of its tables."""
    from tmca.data import rendered_scene, select_bands
    from tmca.priors import find_prior

    told(0.0, "rendering scenes")
    scenes = {name: select_bands(rendered_scene(name, size=size)["radiance"], BANDS) for name in SCENES}
    for name, scene in scenes.items():
        scene.attrs["name"] = name
    told(0.1, "learning the prior of rendered scenes")
    prior = find_prior(SpectralCamera(bands=next(iter(scenes.values()))["wavelength"].values.tolist(), size=size))
    rows, sections = [], []
    for index, (name, scene) in enumerate(scenes.items()):
        results = {}
        for place, (code, settings) in enumerate(CODES.items()):
            told(0.2 + 0.4 * (index + place / len(CODES)) / len(scenes), f"{name}, {code}")
            results[code] = _through(scene, settings, prior, out / f"{name}_{_stem(code)}", overwrite)
            rows.append(_row(name, code, *results[code]))
        sections.append(_section(name, scene, results, out, overwrite))
    views = (max(32, 2 * size[0] // 3), max(32, 2 * size[1] // 3))
    light_field, section = demo_light_field(out, views, overwrite, lambda share, step: told(0.6 + 0.15 * share, step))
    sections.append(section)
    depth, section = demo_spectral_depth(out, views, overwrite, lambda share, step: told(0.75 + 0.2 * share, step))
    told(0.95, "writing the report")
    pages = [_summary(rows), *sections, section]
    write_report(out / "report.html", "tmca demo: snapshot cameras", pages, overwrite=overwrite)
    told(1.0, "done")
    return {"rows": rows, "light_field": light_field, "spectral_depth": depth}


def _through(
    scene: xr.DataArray, settings: dict[str, Any], prior: Any, stem: Path, overwrite: bool
) -> tuple[Snapshot[SpectralCamera], Reconstruction]:
    size, sensor = (scene.sizes["y"], scene.sizes["x"]), Sensor(read_noise=READ_NOISE)
    weights = find_weights(settings["weights"], settings["slots"]) if "weights" in settings else None
    if weights is None:
        bands = scene["wavelength"].values.tolist()
        camera = SpectralCamera(bands=bands, size=size, sensor=sensor, period=PERIOD, **settings)
    else:
        camera = weights.camera_for(size, sensor=sensor)
    method = "lmmse" if weights is None else "network"
    snapshot = simulate(scene, camera)
    snapshot.save(stem.with_name(f"{stem.name}_snapshot.nc"), overwrite=overwrite)
    result = reconstruct_snapshot(
        snapshot, method, prior=prior, weights=weights, uncertainty=weights is None, truth=scene
    )
    result.save(stem.with_name(f"{stem.name}_{method}.nc"), overwrite=overwrite)
    return snapshot, result


def _row(scene: str, code: str, snapshot: Snapshot[SpectralCamera], result: Reconstruction) -> dict[str, Any]:
    throughput = snapshot.camera.throughput()
    return {"code": code, "scene": scene, **result.metrics, "throughput": throughput, "seconds": result.seconds}


def _section(
    name: str,
    scene: xr.DataArray,
    results: dict[str, tuple[Snapshot[SpectralCamera], Reconstruction]],
    out: Path,
    overwrite: bool,
) -> Section:
    multiplexed = results["time-multiplexed, K = 8"][0]
    deviations = {code: r.deviation.values for code, (_, r) in results.items() if r.deviation is not None}
    figures: dict[str, Figure] = {
        "Truth and reconstructions (650, 550, 480 nm as red, green, blue), error, predicted error, spectra.": (
            reconstruction_figure(
                {code: result.cube.values for code, (_, result) in results.items()},
                scene["wavelength"].values.tolist(),
                scene.values,
                deviations,
            )
        ),
        "The time-multiplexed snapshot.": snapshot_figure(multiplexed.values[0, 0].numpy(), multiplexed.camera, name),
        "Aperture T, shutter S, and the code T̂ that they make together (a corner).": codes_figure(multiplexed.camera),
    }
    for figure, ending in zip(figures.values(), ("reconstruction", "snapshot", "codes"), strict=True):
        save_figure(figure, out / f"{name}_{ending}.png", overwrite=overwrite)
    return Section(f"Scene: {name}", figures=figures)


def _summary(rows: Sequence[dict[str, Any]]) -> Section:
    means: list[dict[str, Any]] = []
    for code in CODES:
        mine = {row["scene"]: _numbers(row) for row in rows if row["code"] == code}
        means.append({"code": code, "scene": "mean", **mean_over_scenes(mine)})
    static, random, _, learned_static, learned = (mean["psnr"] for mean in means)
    return Section(
        "Spectral snapshots",
        text=(
            f"Two rendered scenes of {BANDS} bands (400–700 nm) were each recorded in one snapshot by a static coded "
            "aperture and by apertures that change within the exposure while every pixel has its own shutter, at equal "
            f"exposure time and with read noise σ = {READ_NOISE:g}. Snapshots through random codes were reconstructed "
            "in closed form, without training, under a Gaussian prior of small blocks learned from other rendered "
            "scenes; learned codes came with the network that learned with them on those scenes.",
            f"With random codes, time multiplexing changed the mean PSNR by {random - static:+.2f} dB; with learned "
            f"codes by {learned - learned_static:+.2f} dB. Learning changed it by {learned_static - static:+.2f} dB "
            f"for the static code and by {learned - random:+.2f} dB for the time-multiplexed one.",
        ),
        table=[*means, *rows],
        columns=COLUMNS,
    )


def _numbers(row: dict[str, Any]) -> dict[str, float]:
    return {key: value for key, value in row.items() if isinstance(value, float)}


def _stem(code: str) -> str:
    return dict(zip(CODES, ("static", "tmca8", "onehot4", "learned_static", "learned_tmca8"), strict=True))[code]
