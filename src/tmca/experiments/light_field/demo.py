"""The light-field part of the demonstration: a rendered light field through two cameras and back."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from tmca.applications import simulate
from tmca.cameras import LightFieldCamera
from tmca.data.light_field_scenes import load_light_field
from tmca.experiments.light_field.imaging import (
    reconstruct_light_field,
)
from tmca.experiments.light_field.truth import geometry
from tmca.experiments.reconstructions import Reconstruction
from tmca.experiments.report import Section
from tmca.plots.light_field import light_field_figure
from tmca.plots.style import save_figure
from tmca.plots.views import refocus_strip, views_gif
from tmca.sensor import Sensor

SCENE, VIEWS, PERIOD = "coffee:1", 5, 16
CODES: dict[str, dict[str, Any]] = {
    "static mask (CLFP)": {"slots": 1, "shutter": "open"},
    "one-hot shutter, K = 8": {"slots": 8, "shutter": "one-hot"},
}
READ_NOISE = 1e-3
COLUMNS = (
    ("code", "code", ""),
    ("psnr", "PSNR (dB)", ".2f"),
    ("ssim", "SSIM", ".3f"),
    ("disparity_mae", "disparity MAE (px per view)", ".3f"),
    ("throughput", "light", ".1%"),
    ("seconds", "s", ".1f"),
)
_FOCUS = (-1.0, 0.0, 1.0)


def demo_light_field(
    out: Path, size: tuple[int, int], overwrite: bool, told: Callable[[float, str], None]
) -> tuple[list[dict[str, Any]], Section]:
    """Take and reconstruct colour snapshots of a rendered light field; files and pictures go to ``out``.

    Args:
        out: folder that exists.
        size: (H, W) of the views, pixels.
        overwrite: replace earlier results.
        told: share of this part that is done, and what is next.

    Returns:
        Rows of the table, one for each code, and the report's section.
    """
    from tmca.priors import find_prior

    told(0.0, "rendering a light field")
    truth = load_light_field(SCENE, views=VIEWS, size=size, colour=True)
    told(0.1, "the prior of rendered light fields")
    sensor = Sensor(read_noise=READ_NOISE)
    cameras = {code: LightFieldCamera(VIEWS, size, period=PERIOD, sensor=sensor, **how) for code, how in CODES.items()}
    first = next(iter(cameras.values()))
    prior = find_prior(first, progress=lambda share, step: told(0.1 + 0.4 * share, step))
    rows, found = [], {}
    for place, (code, camera) in enumerate(cameras.items()):
        told(0.5 + 0.2 * place, f"light field, {code}")
        snapshot = simulate(truth, camera)
        stem = f"light_field_{'static' if camera.slots == 1 else 'onehot8'}"
        snapshot.save(out / f"{stem}_snapshot.nc", overwrite=overwrite)
        result = reconstruct_light_field(snapshot, "lmmse", prior=prior, truth=truth)
        result.save(out / f"{stem}_lmmse.nc", overwrite=overwrite)
        found[code] = (snapshot, result)
        shape = geometry(result.light_field, SCENE)
        light = {"throughput": camera.throughput(), "seconds": result.seconds}
        rows.append({"code": code, **result.metrics, **shape, **light})
    told(0.9, "pictures of the light field")
    return rows, _section(truth.values, found, rows, out, overwrite)


def _section(
    truth: Any,
    found: dict[str, tuple[Any, Reconstruction]],
    rows: list[dict[str, Any]],
    out: Path,
    overwrite: bool,
) -> Section:
    static, multiplexed = (row["psnr"] for row in rows)
    snapshot, best = found["one-hot shutter, K = 8"]
    estimates = {code: result.light_field.values for code, (_, result) in found.items()}
    about = (
        "Centre views, and the box in them enlarged with the epipolar slices of its marked row and column: true and "
        "reconstructed. At the right the time-multiplexed snapshot and the errors."
    )
    figures = {
        about: light_field_figure(estimates, truth, snapshot.values[:, 0].numpy()),
        "Refocused after the exposure: far, middle, near.": refocus_strip(best.light_field.values, _FOCUS),
    }
    for figure, ending in zip(figures.values(), ("views", "refocus"), strict=True):
        save_figure(figure, out / f"light_field_{ending}.png", overwrite=overwrite)
    walk = views_gif(best.light_field.values, out / "light_field_views.gif", overwrite=overwrite)
    return Section(
        f"A light field: {SCENE.partition(':')[0]}",
        text=(
            f"{VIEWS}×{VIEWS} views of staged surfaces went through a coded mask before the sensor, in colour, at "
            f"equal exposure time and with read noise σ = {READ_NOISE:g}: one pattern (compressive light-field "
            "photography), and eight patterns, of which every pixel sees one. The views come back in closed form "
            "under a Gaussian prior of other rendered light fields; time multiplexing changed the PSNR by "
            f"{multiplexed - static:+.2f} dB.",
        ),
        table=rows,
        columns=COLUMNS,
        figures=figures,
        animations={"A walk over the reconstructed views (K = 8).": walk},
    )
