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
from tmca.design.mask_advised import mask_advice
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
_READ = (("masks", "masks", ""), ("buckets", "readings of a pixel", "d"))
"""Columns of what is searched for one bucket and for two, instead of K."""
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


def design_files(slots: Sequence[int], buckets: int = 1) -> list[str]:
    """Names of the files that a design writes, for pixels of one bucket or two."""
    several = [k for k in slots if k > 1 and buckets == 2]
    stems = [_stem(k, 1) for k in slots] + [_stem(k, 2) for k in several] + ["burst"] * bool(several)
    each = [name for stem in stems for name in (_codes(stem), f"masks_{stem}.png", f"psf_{stem}.png")]
    return ["design.json", "design.html", "codes.nc", "fisher.png", "distances.png", *each]


def columns_of(record: Mapping[str, Any]) -> tuple[tuple[str, str, str], ...]:
    """Columns of the table of designs."""
    return (*_READ, *COLUMNS[1:]) if record["sensor"]["buckets"] == 2 else COLUMNS


def _stem(slots: int, buckets: int) -> str:
    """Of the names of files."""
    return f"k{slots}" + ("_two_buckets" if buckets == 2 else "")


def _stem_of(advice: MaskAdvice, candidate: MaskCandidate) -> str:
    return "burst" if candidate is advice.burst else _stem(candidate.slots, candidate.buckets)


def _codes(stem: str) -> str:
    """Name of the file of codes."""
    return "burst.nc" if stem == "burst" else f"codes_{stem}.nc"


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
    rows = [_row(advice, candidate) for candidate in advice.finals]
    return {
        "command": " ".join(command), "commit": repository_commit(), "advice": mask_advice(advice),
        "multiplex": advice.multiplex, "slots": best.slots, "buckets": best.buckets, "saved": advice.saved(best),
        **given, "noise": {"read": noise.read, "shot": noise.shot}, "bench": asdict(task.bench),
        "depth": best.camera.planes.metres.tolist(), "wavelengths": list(best.camera.wavelengths),
        "filters": task.camera["filters"], "channels": task.camera["channels"], "period": best.camera.period,
        "shutter": task.shutter, "mask": task.family, "stroke": None if task.stroke is None else asdict(task.stroke),
        "learn": list(task.learn), "window": task.window, "seed": task.seed, "effort": asdict(effort),
        "device": str(task.device),
        "scenes": list(prior.sources), "caveat": caveat, "designs": rows,
    }  # fmt: skip


def _row(advice: MaskAdvice, candidate: MaskCandidate) -> dict[str, Any]:
    """A design for tables and files."""
    error, random_error = candidate.errors or (None, None)
    return {
        "masks": _named(advice, candidate), "buckets": candidate.buckets,
        "judged": error, "random_judged": random_error, "slots": candidate.slots, "confusion": candidate.confusion,
        "random_confusion": float(confusion(candidate.random_covariance)),
        "error": drawn_error(candidate.covariance), "random_error": drawn_error(candidate.random_covariance),
        "throughput": candidate.camera.throughput(), "start": candidate.start, "seconds": candidate.seconds,
        "fisher": candidate.information.tolist(), "random_fisher": candidate.random_information.tolist(),
        "saved": advice.saved(candidate), "codes": _codes(_stem_of(advice, candidate)),
    }  # fmt: skip


def write_design(advice: MaskAdvice, record: dict[str, Any], out: Path, overwrite: bool) -> None:
    """Write a folder; everything is drawn before anything is written."""
    figures = {"fisher.png": _fisher(advice), "distances.png": _distances(advice)}
    for design in advice.finals:
        stem = _stem_of(advice, design)
        figures |= {f"masks_{stem}.png": design.camera.plot(), f"psf_{stem}.png": psf_figure(design.camera)}
    make_folder(out)
    filters, channels, dated = str(record["filters"]), str(record["channels"]), {CODES_DATE: now()}
    for name, figure in figures.items():
        save_figure(figure, out / name, overwrite=overwrite)
    for design, row in zip(advice.finals, record["designs"], strict=True):
        notes = {"advice": record["advice"], "confusion": row["confusion"], "sensor": record["sensor"]} | dated
        for name in (row["codes"], *(["codes.nc"] if design is advice.best else [])):
            write_phase_codes(design.camera, out / name, filters, channels, notes, overwrite=overwrite)
    write_json(record, out / "design.json", overwrite=overwrite)
    title = "Phase masks for a spectral-depth camera"
    write_report(out / "design.html", title, _sections(advice, record, figures), overwrite=overwrite)


def _named(advice: MaskAdvice, candidate: MaskCandidate) -> str:
    return advice.named(candidate) if candidate.slots > 1 else "static"


def _drawn(advice: MaskAdvice) -> list[MaskCandidate]:
    """What pictures tell apart: two buckets that show the masks of the burst are left out beside it."""
    rival = advice.burst
    return [c for c in advice.finals if rival is None or c is rival or not c.information.equal(rival.information)]


def _fisher(advice: MaskAdvice) -> Figure:
    both = {
        _named(advice, design): (design.random_information.numpy(), design.information.numpy())
        for design in _drawn(advice)
    }
    return fisher_figure(both, advice.static.camera.planes.metres.numpy())


def _distances(advice: MaskAdvice) -> Figure:
    """Kullback–Leibler and Bhattacharyya distances of all pairs of planes: random and designed masks of every K, or
    beside two buckets, where they are many, designed ones."""
    covariances = {
        f"{_named(advice, design)}, {name}": covariance
        for design in advice.finals
        for name, covariance in (("random", design.random_covariance), ("designed", design.covariance))
    }
    if advice.burst is not None:
        covariances = {_named(advice, design): design.covariance for design in _drawn(advice)}
    kinds = (("Kullback–Leibler", kullback_leibler, 10 * _SURE), ("Bhattacharyya", bhattacharyya, _SURE))
    distances = {
        kind: (top, {name: distance(covariance).numpy() for name, covariance in covariances.items()})
        for kind, distance, top in kinds
    }
    return distances_figure(distances, advice.static.camera.planes.metres.numpy())


def _sections(advice: MaskAdvice, record: Mapping[str, Any], figures: Mapping[str, Figure]) -> list[Section]:
    each = {advice.named(design): _stem_of(advice, design) for design in advice.finals}
    return [
        Section("Advice", _about(advice, record), record["designs"], columns_of(record)),
        Section("Over depth", figures={
            "Fisher information about inverse depth": figures["fisher.png"],
            "How far the snapshots of two planes are apart: square roots, alike from where they are never confused":
            figures["distances.png"]}),
        Section("Masks", figures={
            f"Masks, shutter and filters, {name}": figures[f"masks_{stem}.png"] for name, stem in each.items()}),
        Section("Point spread functions", figures={
            f"Over depth, {name}": figures[f"psf_{stem}.png"] for name, stem in each.items()}),
    ]  # fmt: skip


def _about(advice: MaskAdvice, record: Mapping[str, Any]) -> list[str]:
    """Paragraphs on the advice, and on how masks were searched."""
    effort, noise = record["effort"], record["noise"]
    return [
        record["advice"],
        f"Read noise {noise['read']:.3g}, shot variance {noise['shot']:.3g} per unit (1 = one band of a white scene); "
        f"windows of {record['window']} pixels, {len(record['wavelengths'])} bands, {len(record['depth'])} planes.",
        f"Equal effort: {effort['starts']} starts of {effort['steps']} steps for every K, at equal exposure time; more "
        f"slots also start from the best static mask shown in all of them. Shutter with several slots: "
        f"{record['shutter']}; open with one.",
        *_about_buckets(advice),
        record["caveat"],
        "Take masks along: tmca simulate spectral-depth SCENE --codes codes.nc.",
    ]


def _about_buckets(advice: MaskAdvice) -> list[str]:
    """How two buckets and the burst are compared."""
    if advice.burst is None:
        return []
    text = (
        "With two buckets the shutter is balanced, and no light is lost. A burst is two static frames with a mask "
        "each, one after the other within the same time. Each bucket and each frame has its own read noise and its own "
        "full well."
    )
    shared = any(design.alike for design in advice.candidates)
    same = " Two buckets with K = 2 read what the burst reads, a frame in either bucket: two frames do the same."
    return [text + (same if shared else "")]
