"""What a search of phase masks leaves in its folder: numbers, codes, pictures, and the page that explains them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.applications.camera_figures import psf_figure
from tmca.applications.report import Section, write_report
from tmca.cameras.phase_codes import write_phase_codes
from tmca.data import make_folder, write_json
from tmca.design import MaskAdvice, MaskCandidate, MaskEffort, MaskTask
from tmca.design.mask_search import mask_advice
from tmca.design.spectral_depth import bhattacharyya, confusion, drawn_error, kullback_leibler
from tmca.evaluation.tables import repository_commit
from tmca.lab.notes import CODES_DATE, now
from tmca.plots.curves import distances_figure, fisher_figure
from tmca.plots.style import save_figure
from tmca.priors import GaussianPrior

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SURE = 20.0
"""Nats from which distances are drawn alike: a chance of confusion below 1e-9."""
COLUMNS = (
    ("slots", "K", "d"),
    ("judged", "error on example scenes (bins)", ".3f"),
    ("random_judged", "of random masks", ".3f"),
    ("confusion", "depth confusion (bins)", ".3g"),
    ("random_confusion", "of random masks", ".3g"),
    ("saved", "below the static mask's", ".0%"),
    ("error", "drawn error (bins)", ".3f"),
    ("random_error", "of random masks", ".3f"),
    ("throughput", "light", ".0%"),
    ("start", "found from", ""),
    ("seconds", "CPU seconds", ".0f"),
)
_JUDGED = (
    "The error on example scenes is that of the patch likelihood on their middles at drawn depths, with edges and "
    "slopes: it says which descent is taken and orders designs. "
)
_CAVEAT = (
    "The confusion, on which masks are searched, is a bound on the mean error, in "
    "depth bins, of the most likely plane for one window; the drawn error is that error for windows drawn from the "
    "prior. Both believe the Gaussian prior and exact point spread functions, so that they are far too optimistic, "
    "most of all for static masks, and know no edges of depth: they are for the order of designs, not for the error to "
    "expect."
)


def design_files(slots: Sequence[int]) -> list[str]:
    """Names of the files that a design writes."""
    each = [name for k in slots for name in (f"codes_k{k}.nc", f"masks_k{k}.png", f"psf_k{k}.png")]
    return ["design.json", "design.html", "codes.nc", "fisher.png", "distances.png", *each]


def described(
    advice: MaskAdvice,
    task: MaskTask,
    effort: MaskEffort,
    prior: GaussianPrior,
    given: Mapping[str, Any],
    command: Sequence[str],
) -> dict[str, Any]:
    """What ``design.json`` holds; ``given`` is added as it is."""
    noise, best = advice.static.camera.noise, advice.best
    caveat = _CAVEAT if advice.static.errors is None else _JUDGED + _CAVEAT
    rows = [_row(advice, candidate) for candidate in advice.candidates]
    return {
        "command": " ".join(command), "commit": repository_commit(), "advice": mask_advice(advice),
        "multiplex": advice.multiplex, "slots": best.slots, "saved": advice.saved(best), **given,
        "noise": {"read": noise.read, "shot": noise.shot}, "bench": asdict(task.bench),
        "depth": best.camera.planes.metres.tolist(), "wavelengths": list(best.camera.wavelengths),
        "filters": task.camera["filters"], "channels": task.camera["channels"], "period": best.camera.period,
        "shutter": task.shutter, "mask": task.family, "stroke": None if task.stroke is None else asdict(task.stroke),
        "learn": list(task.learn), "window": task.window, "seed": task.seed, "effort": asdict(effort),
        "scenes": list(prior.sources), "caveat": caveat, "designs": rows,
    }  # fmt: skip


def _row(advice: MaskAdvice, candidate: MaskCandidate) -> dict[str, Any]:
    """A design for tables and files."""
    error, random_error = candidate.errors or (None, None)
    return {
        "judged": error, "random_judged": random_error, "slots": candidate.slots, "confusion": candidate.confusion,
        "random_confusion": float(confusion(candidate.random_covariance)),
        "error": drawn_error(candidate.covariance), "random_error": drawn_error(candidate.random_covariance),
        "throughput": candidate.camera.throughput(), "start": candidate.start, "seconds": candidate.seconds,
        "fisher": candidate.information.tolist(), "random_fisher": candidate.random_information.tolist(),
        "saved": advice.saved(candidate), "codes": f"codes_k{candidate.slots}.nc",
    }  # fmt: skip


def write_design(advice: MaskAdvice, record: dict[str, Any], out: Path, overwrite: bool) -> None:
    """Write a folder; everything is drawn before anything is written."""
    figures = {"fisher.png": _fisher(advice.candidates), "distances.png": _distances(advice.candidates)}
    for design in advice.candidates:
        figures |= {
            f"masks_k{design.slots}.png": design.camera.plot(),
            f"psf_k{design.slots}.png": psf_figure(design.camera),
        }
    make_folder(out)
    filters, channels, dated = str(record["filters"]), str(record["channels"]), {CODES_DATE: now()}
    for name, figure in figures.items():
        save_figure(figure, out / name, overwrite=overwrite)
    for design, row in zip(advice.candidates, record["designs"], strict=True):
        notes = {"advice": record["advice"], "confusion": row["confusion"], "sensor": record["sensor"]} | dated
        for name in (row["codes"], *(["codes.nc"] if design is advice.best else [])):
            write_phase_codes(design.camera, out / name, filters, channels, notes, overwrite=overwrite)
    write_json(record, out / "design.json", overwrite=overwrite)
    title = "Phase masks for a spectral-depth camera"
    write_report(out / "design.html", title, _sections(advice, record, figures), overwrite=overwrite)


def _named(candidate: MaskCandidate) -> str:
    return f"K = {candidate.slots}" if candidate.slots > 1 else "static"


def _fisher(candidates: Sequence[MaskCandidate]) -> Figure:
    both = {_named(design): (design.random_information.numpy(), design.information.numpy()) for design in candidates}
    return fisher_figure(both, candidates[0].camera.planes.metres.numpy())


def _distances(candidates: Sequence[MaskCandidate]) -> Figure:
    """Kullback–Leibler and Bhattacharyya distances of all pairs of planes: random and designed masks of every K."""
    covariances = {
        f"{_named(design)}, {name}": covariance
        for design in candidates
        for name, covariance in (("random", design.random_covariance), ("designed", design.covariance))
    }
    kinds = (("Kullback–Leibler", kullback_leibler, 10 * _SURE), ("Bhattacharyya", bhattacharyya, _SURE))
    distances = {
        kind: (top, {name: distance(covariance).numpy() for name, covariance in covariances.items()})
        for kind, distance, top in kinds
    }
    return distances_figure(distances, candidates[0].camera.planes.metres.numpy())


def _sections(advice: MaskAdvice, record: Mapping[str, Any], figures: Mapping[str, Figure]) -> list[Section]:
    effort, noise = record["effort"], record["noise"]
    about = [
        record["advice"],
        f"Read noise {noise['read']:.3g}, shot variance {noise['shot']:.3g} per unit (1 = one band of a white scene); "
        f"windows of {record['window']} pixels, {len(record['wavelengths'])} bands, {len(record['depth'])} planes.",
        f"Equal effort: {effort['starts']} starts of {effort['steps']} steps for every K, at equal exposure time; more "
        f"slots also start from the best static mask shown in all of them. Shutter with several slots: "
        f"{record['shutter']}; open with one.",
        record["caveat"],
        "Take masks along: tmca simulate spectral-depth SCENE --codes codes.nc.",
    ]
    each = [design.slots for design in advice.candidates]
    return [
        Section("Advice", about, record["designs"], COLUMNS),
        Section("Over depth", figures={
            "Fisher information about inverse depth": figures["fisher.png"],
            "How far the snapshots of two planes are apart: square roots, alike from where they are never confused":
            figures["distances.png"]}),
        Section("Masks", figures={f"Masks, shutter and filters, K = {k}": figures[f"masks_k{k}.png"] for k in each}),
        Section("Point spread functions", figures={f"Over depth, K = {k}": figures[f"psf_k{k}.png"] for k in each}),
    ]  # fmt: skip
