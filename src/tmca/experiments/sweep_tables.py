"""Sweeps as tables and pictures."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any

from tmca.experiments.results import DEPTH_METRICS, METRICS, markdown_table

UNITS = {
    "noise": "read noise σ, snapshot units",
    "read_noise": "read noise σ, snapshot units",
    "full_well": "full well, electrons",
    "read_noise_electrons": "read noise, electrons",
    "slots": "slots K",
    "contrast": "contrast of the texture, 1 = as the scene is",
    "contrast_ratio": "open over closed light of the aperture",
    "leakage": "light through a closed shutter, share",
    "switching": "time between patterns, share of a slot",
    "dead_time": "dead time, share of a slot",
    "delay": "delay of the shutter, slots",
    "jitter": "jitter of the shutter, slots rms",
    "rolling": "delay of the last row, slots",
    "misregistration": "misregistration along both axes, pixels",
    "magnification": "magnification of the aperture's image",
    "rotation": "rotation of the aperture's image, degrees",
    "dispersion_error": "error of the dispersion, share",
    "shear_error": "error of the shear, share",
    "blur": "blur between aperture and sensor, pixels rms",
    "height_error": "error of the heights, share",
    "wavefront_error": "aberration, metres rms of path",
    "hot_pixels": "hot pixels, share",
    "dead_pixels": "dead pixels, share",
    "motion": "motion along both axes, pixels",
}


def _columns(rows: Sequence[dict[str, Any]], axes: Sequence[str]) -> list[tuple[str, str, str]]:
    """Varied settings, the metrics that the rows have, light."""
    metrics = [column for column in (*DEPTH_METRICS, *METRICS) if column[0] in rows[0]]
    return [*((name, name, "") for name in axes), *metrics, ("throughput", "light", ".1%")]


def csv_text(rows: Sequence[dict[str, Any]], axes: Sequence[str]) -> str:
    text = io.StringIO()
    names = [name for name, _, _ in _columns(rows, axes)]
    writer = csv.DictWriter(text, names, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def markdown(found: dict[str, Any], axes: Sequence[str], decoders: Mapping[str, str]) -> str:
    """The results for people; ``decoders`` names them."""
    fixed = {name: value for name, value in found["fixed"].items() if name != "decoder"}
    settings = "".join(f", {name} = {value}" for name, value in fixed.items())
    decoder = found["fixed"].get("decoder")
    learned = ", ".join(found["train"]) or "the rendered training scenes"
    units = "; ".join(f"{name}: {UNITS[name]}" for name in axes if name in UNITS)
    lines = [f"# {found['camera']}: sweep over " + " and ".join(axes), ""]
    lines += [f"Command: `{found['command']}` at commit `{found['commit']}`.", ""]
    said = f"decoder {decoders[decoder]}" if decoder else "decoders side by side"
    said = f"{said[0].upper()}{said[1:]}{settings}; prior and networks learned from {learned}."
    lines += [f"{said} Means over {', '.join(found['scenes'])}.{f' {units}.' if units else ''}", ""]
    return "\n".join([*lines, markdown_table(found["rows"], _columns(found["rows"], axes))])
