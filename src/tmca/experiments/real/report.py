"""The results page of real captures: docs/results/real.md, its JSON and its pictures."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tmca.data import make_folder
from tmca.decoders import Weights
from tmca.errors import SettingError
from tmca.experiments.figures import save_figure
from tmca.experiments.real.decoding import REAL_DECODERS, check_real_decoders
from tmca.experiments.real.figures import geometry_figure, movie_figure, scene_figure
from tmca.experiments.real.study import (
    SCENES,
    Scene,
    Told,
    captures_folder,
    single_disperser,
    study_geometry,
    study_movies,
    study_scene,
)
from tmca.experiments.results import check_new, markdown_table, repository_commit, write_table

_SCENE_COLUMNS = (
    ("scene", "scene", ""), ("decoder", "decoder", ""), ("reprojection", "re-projection", ".2%"),
    ("withheld", "withheld pixels", ".2%"), ("neighbours", "mean of neighbours", ".2%"),
    ("seconds", "CPU seconds", ".0f"),
)  # fmt: skip
_PAIR_COLUMNS = (
    ("scene", "scene", ""), ("one", "one", ""), ("other", "other", ""), ("psnr", "PSNR (dB)", ".1f"),
    ("sam", "SAM (°)", ".1f"),
)  # fmt: skip
_MOVIE_COLUMNS = (
    ("capture", "code", ""), ("decoder", "decoder", ""), ("reprojection", "re-projection", ".2%"),
    ("withheld", "withheld", ".2%"), ("neighbours", "mean of neighbours", ".2%"),
    ("withheld_moving", "withheld, moving", ".2%"), ("neighbours_moving", "neighbours, moving", ".2%"),
    ("seconds", "CPU seconds", ".0f"), ("agreement_psnr", "agreement (dB)", ".1f"),
)  # fmt: skip


def report_files(out: Path) -> list[Path]:
    """JSON, page and pictures of a report."""
    pictures = [*SCENES, "geometry", "wine"]
    return [
        out.with_suffix(".json"),
        out.with_suffix(".md"),
        *(out.with_name(f"{out.name}_{name}.png") for name in pictures),
    ]


def write_report(
    data: Path,
    out: Path,
    decoders: Sequence[str],
    weights: str | Path | None,
    keep: Path,
    command: Sequence[str],
    *,
    overwrite: bool = False,
    told: Told = lambda text: None,
) -> list[Path]:
    """Decode, judge and draw every real capture of a data folder.

    Args:
        data: folder with ``tsa/`` and ``pixel_shutter_wine/``, or the one above.
        out: the page, without suffix.
        decoders: of ``REAL_DECODERS``.
        weights: of the network: a run or its file.
        keep: folder of estimates, used again by the next call.
        command: that is shown on the page.
        overwrite: replace results that exist.
        told: what is done next.

    Raises:
        DataError, SettingError, OutputError: captures that are missing, decoders that cannot run, results that exist.
    """
    folder, files = captures_folder(data), report_files(out)
    if not decoders:
        raise SettingError("--decoders", "none", f"some of {', '.join(REAL_DECODERS)}")
    check_real_decoders(decoders, weights)
    check_new(files, overwrite)
    make_folder(keep)
    trained = None if weights is None else Weights.load(weights)
    told("geometry")
    geometry, blocks = study_geometry(folder)
    scenes = [study_scene(folder, name, decoders, trained, keep, told) for name in SCENES]
    rows, frames, captures = study_movies(folder, told)
    results = {
        "command": shlex.join(command), "commit": repository_commit(), "geometry": geometry,
        "network": _network(trained), "rows": [row for scene in scenes for row in scene.rows],
        "pairs": [pair for scene in scenes for pair in scene.pairs], "movies": rows,
    }  # fmt: skip
    _pictures(scenes, geometry, blocks, frames, captures, out, overwrite)
    write_table(results, page(results, out.name), files[:2], overwrite)
    return files


def _network(weights: Weights | None) -> dict[str, Any] | None:
    """How the network learned."""
    if weights is None:
        return None
    card = weights.card
    return {"kind": weights.network.kind, "start": weights.network.start, "scenes": card.get("scenes"),
            "best": card.get("best"), "steps": card.get("training", {}).get("optimiser", {}).get("steps")}  # fmt: skip


def _pictures(
    scenes: Sequence[Scene], geometry: Any, blocks: Any, frames: Any, captures: Any, out: Path, overwrite: bool
) -> None:
    prototype = single_disperser()
    for scene in scenes:
        camera = scene.snapshot.camera
        drawing = scene_figure(
            scene.snapshot.values[0, 0].numpy(), scene.estimates, camera.wavelengths,
            prototype.points.get(scene.name, {}), scene.mask_spectra, prototype.turned,
        )  # fmt: skip
        save_figure(drawing, out.with_name(f"{out.name}_{scene.name}.png"), overwrite=overwrite)
    size = scenes[0].snapshot.camera.size[0]
    save_figure(geometry_figure(geometry, blocks, size), out.with_name(f"{out.name}_geometry.png"), overwrite=overwrite)
    save_figure(movie_figure(frames, captures), out.with_name(f"{out.name}_wine.png"), overwrite=overwrite)


def page(results: dict[str, Any], name: str) -> str:
    """The page of some results; pictures are named after it."""
    prototype = single_disperser()
    pictures = "\n".join(f"![{prototype.scenes[one]}]({name}_{one}.png)\n" for one in SCENES)
    return f"""# Real captures

`{results["command"]}` at commit {results["commit"]}. [What is measured and how](../real-captures.md).

## Single disperser: three scenes of TSA-Net

{_geometry_text(results["geometry"])}
![Light by displacement, and the mask's place]({name}_geometry.png)

{_scenes_text(results)}
{pictures}
## Per-pixel shutter: wine that is poured

256 slots, each pixel open in one of them; 16 frames of 16 slots each.

{markdown_table(results["movies"], _MOVIE_COLUMNS)}
![Frames behind the designed and the random code]({name}_wine.png)
"""


def _scenes_text(results: dict[str, Any]) -> str:
    """Tables of decoders and of their agreement."""
    return f"""\
Errors are shares of the snapshot's norm. *Re-projection* is that of the whole estimate; *withheld pixels* is over 5 %
of the sensor pixels of the 200 brightest rows, which the decoder was not shown; *mean of neighbours* is what the four
pixels around them say without any decoder. CPU seconds are those of one whole capture of 660 × 714 pixels on one
thread.

{markdown_table(results["rows"], _SCENE_COLUMNS)}
How far two decoders agree (PSNR over the brightest value, spectral angle where the scene is lit):

{markdown_table(results["pairs"], _PAIR_COLUMNS)}
{_network_text(results["network"])}"""


def _geometry_text(found: dict[str, Any]) -> str:
    shares = ", ".join(f"{way} {share:.2f}" for way, share in found["explained"].items())
    scale, shift = found["registration"]["scale"][0], found["registration"]["shift"][0]
    order = "; ".join(
        f"{scene} {both['red far']['withheld']:.2%} against {both['blue far']['withheld']:.2%}"
        for scene, both in found["order"].items()
    )
    return f"""- **The mask lies as its file says.** Its displaced copies explain of the captures' fine structure:
  {shares}.
- **Its image is {scale - 1:.2%} larger along y and {shift:.2f} pixels lower than its file**, with a deviation of
  {found["deviation"]:.2f} pixels from block to block. In register and blurred the copies explain
  {found["explained_registered"]:.2f}.
- **Light falls on displacements from 0 to 54 columns** (the grey range below) and hardly beyond: 28 bands of 2 pixels.
- **Red lies at larger x.** The prism spreads short waves wider. With the bands' widths in the response, ADMM-TV
  foretells withheld pixels with an error of ({"red far against blue far"}): {order}.
"""


def _network_text(found: dict[str, Any] | None) -> str:
    if found is None:
        return ""
    best = found["best"] or {}
    said = f"{best['psnr']:.2f} dB on the validation scene" if "psnr" in best else "no validation"
    return (
        f"The network: {found['kind']} from {found['start']}, {found['steps']} steps on crops of this mask in register,"
        f" {len(found['scenes'] or [])} training scenes; {said}.\n"
    )
