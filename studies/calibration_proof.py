"""Calibration held against the hidden truth of rendered benches, and what it is worth in a reconstruction."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

import tmca
from studies.bench import Calibration, MeasuredDispersion, calibrated_snapshot, wavefront_rms
from studies.ray_physics import REFERENCE
from studies.rendered_bench import DEPTH, WAVES, calibrate_bench, write_bench
from tmca.cameras import Snapshot, SpectralDepthCamera
from tmca.data import read_dataset
from tmca.errors import check_range
from tmca.optics import PhaseMaskBench
from tmca.plots import reconstruction_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Truth = dict[str, Any]
"""Hidden numbers of a bench by name, as `tmca.lab` draws them."""
_SENSOR = ("dark", "flat", "linearity")
_OPTICS: dict[str, tuple[str, ...]] = {
    "spectral": ("registration", "dispersion", "timing"),
    "light-field": ("registration", "shear", "timing"),
    "spectral-depth": (),
}
BOUNDS: dict[str, tuple[str, float | None]] = {
    "registration": ("px rms", 0.05),
    "dispersion": ("px, worst", 0.1),
    "response κ": ("relative, worst", None),
    "shear": ("px per view", 0.02),
    "delay of the shutter": ("slots", None),
    "duration of its slots": ("relative", None),
    "leakage of the aperture": ("share of the light", None),
    "leakage of the shutter": ("share of the light", None),
    "wavefront": ("waves rms", 0.02),
    "electrons per digital number": ("relative", None),
}
"""Quantity → its unit, and the largest error that counts as right."""


class Reconstructed(TypedDict):
    """A snapshot by one operator: PSNR of the estimate, None of none, and of the snapshot over what is left, dB."""

    camera: str
    seed: int
    operator: str
    psnr: float | None
    explained: float


class Mean(TypedDict):
    """The same, over all benches."""

    camera: str
    operator: str
    psnr: float | None
    explained: float


class Error(TypedDict):
    """Errors of a quantity, of every bench and the worst, beside the bound."""

    quantity: str
    unit: str
    bound: float | None
    error: float
    all: list[float]


class Results(TypedDict):
    """What ``tmca calibrate proof --json`` prints."""

    seeds: int
    snr_db: float
    errors: list[Error]
    reconstruction: list[Mean]
    rows: list[Reconstructed]


@dataclass
class Proof:
    """Errors of every bench, and reconstructions of their snapshots.

    Args:
        seeds: benches of each camera.
        snr_db: of their captures.
        found: quantity → errors.
        rows: of reconstructions.
        cubes: of seed 0 of the spectral camera: operator → estimate (L, H, W).
        scene: the truth of these.
        wavelengths: (L,) metres of these.
    """

    seeds: int
    snr_db: float
    found: dict[str, list[float]] = field(default_factory=dict)
    rows: list[Reconstructed] = field(default_factory=list)
    cubes: dict[str, np.ndarray] = field(default_factory=dict)
    scene: np.ndarray | None = None
    wavelengths: tuple[float, ...] = ()

    def stated(self) -> Results:
        """Worst errors beside their bounds, and means over benches of the reconstructions."""
        errors: list[Error] = [
            {"quantity": name, "unit": BOUNDS[name][0], "bound": BOUNDS[name][1], "error": max(values), "all": values}
            for name, values in self.found.items()
        ]
        kinds = dict.fromkeys((row["camera"], row["operator"]) for row in self.rows)
        return {
            "seeds": self.seeds,
            "snr_db": self.snr_db,
            "errors": errors,
            "reconstruction": [self._mean(*kind) for kind in kinds],
            "rows": self.rows,
        }

    def _mean(self, camera: str, operator: str) -> Mean:
        own = [row for row in self.rows if (row["camera"], row["operator"]) == (camera, operator)]
        known = [row["psnr"] for row in own if row["psnr"] is not None]
        psnr = float(np.mean(known)) if known else None
        explained = float(np.mean([row["explained"] for row in own]))
        return {"camera": camera, "operator": operator, "psnr": psnr, "explained": explained}


def prove(
    seeds: int,
    size: tuple[int, int] = (64, 80),
    snr_db: float = 40.0,
    cameras: Sequence[str] = tuple(_OPTICS),
    told: Callable[[str], None] | None = None,
) -> Proof:
    """Render benches, calibrate them from their files alone, compare with the truth, and reconstruct their snapshots.

    Args:
        seeds: benches of each camera, seeds 0 to ``seeds - 1``.
        size: (H, W) of the scenes.
        snr_db: of the captures of patterns and points.
        cameras: of the benches, some of ``spectral``, ``light-field``, ``spectral-depth``.
        told: what is done next.

    Raises:
        SettingError: no bench.
    """
    check_range("--seeds", seeds, 1)
    proof = Proof(seeds, snr_db)
    for seed in range(seeds):
        for camera in cameras:
            if told is not None:
                told(f"{camera} bench, seed {seed}")
            with tempfile.TemporaryDirectory() as place:
                folder = Path(place) / "bench"
                slots = 2 if camera == "spectral-depth" else 4
                truth = write_bench(folder, camera=camera, size=size, slots=slots, snr_db=snr_db, seed=seed)
                calibration = calibrate_bench(folder)
                _compare(proof, calibration, truth)
                _reconstruct(proof, folder, camera, seed, calibration, truth)
    return proof


def _compare(proof: Proof, calibration: Calibration, truth: Truth) -> None:
    """Errors of what was measured."""
    for quantity, error in _errors(calibration, truth):
        proof.found.setdefault(quantity, []).append(float(error))


def _errors(calibration: Calibration, truth: Truth) -> Iterator[tuple[str, float]]:
    yield "electrons per digital number", abs(calibration.part("linearity").gain / truth["gain"] - 1)
    if (part := calibration.part("registration")) is not None:
        timing = calibration.part("timing")
        yield "registration", part.offset(truth["matrix"])
        yield "delay of the shutter", abs(timing.delay - truth["delay"])
        yield "duration of its slots", abs(timing.ratio / truth["ratio"] - 1)
        yield "leakage of the aperture", abs(part.leakage - 1 / truth["contrast_ratio"])
        yield "leakage of the shutter", abs(timing.leakage - truth["leakage"])
    if (part := calibration.part("dispersion")) is not None:
        response = truth["response"] / np.mean(truth["response"])
        yield "dispersion", np.abs(part.at(WAVES) - truth["shifts"]).max()
        yield "response κ", np.abs(part.response_at(WAVES) / response - 1).max()
    if (part := calibration.part("shear")) is not None:
        yield "shear", np.abs(part.step - truth["step"]).max()
    for slot, coefficients in enumerate(truth["coefficients"]):
        if (part := calibration.part(f"wavefront{slot}")) is not None:
            yield "wavefront", wavefront_rms(part.coefficients - coefficients, _bench_of(calibration), REFERENCE)


def _bench_of(calibration: Calibration) -> PhaseMaskBench:
    window = calibration.part("psf0").values.shape[2:]
    return PhaseMaskBench(window=(int(window[0]), int(window[1])))


def _reconstruct(proof: Proof, folder: Path, camera: str, seed: int, calibration: Calibration, truth: Truth) -> None:
    """The snapshot by the nominal, the calibrated and the true operator, digital numbers corrected alike in all."""
    raw: Snapshot[Any] = Snapshot.load(folder / "snapshot.nc")
    scene = np.asarray(next(iter(read_dataset(folder / "scene.nc").data_vars.values())).values, dtype=np.float64)
    for name, operator in _operators(camera, calibration, truth).items():
        taken = calibrated_snapshot(raw, operator)
        estimate = None if camera == "spectral-depth" else _estimate(taken)
        psnr = None if estimate is None else float(-10 * np.log10(((estimate - scene) ** 2).mean()))
        explained = _explained(taken, scene)
        proof.rows.append(
            {"camera": camera, "seed": seed, "operator": name, "psnr": psnr, "explained": explained}
        )  # fmt: skip
        if camera == "spectral" and seed == 0 and estimate is not None and not name.startswith("without"):
            proof.cubes[name], proof.scene, proof.wavelengths = estimate, scene, taken.camera.wavelengths


def _operators(camera: str, calibration: Calibration, truth: Truth) -> dict[str, Calibration]:
    """Calibrations that are compared, by name."""
    operators = {
        "nominal": calibration.only(*_SENSOR),
        "calibrated": calibration,
        "true": true_calibration(calibration, truth),
        **{f"without {name}": calibration.without(name) for name in _OPTICS[camera]},
    }
    if "timing" in _OPTICS[camera]:
        operators["without contrast and leakage"] = _without_leaks(calibration)
    return operators


@dataclass(frozen=True)
class TrueDispersion(MeasuredDispersion):
    """The bench's own curve instead of a fitted one, at its wavelengths and between them by a fine interpolation."""

    fine: tuple[Array, Array, Array] | None = None

    def at(self, wavelengths: ArrayLike) -> Array:
        """(n, 2) true displacement."""
        waves, shifts, _ = self.fine or (self.wavelengths, self.shifts, self.response)
        asked = np.asarray(wavelengths, dtype=np.float64)
        return np.stack([np.interp(asked, waves, shifts[:, axis]) for axis in (0, 1)], axis=1)

    def response_at(self, wavelengths: ArrayLike) -> Array:
        """(n,) true κ."""
        waves, _, response = self.fine or (self.wavelengths, self.shifts, self.response)
        return np.interp(np.asarray(wavelengths, dtype=np.float64), waves, response)


def true_calibration(calibration: Calibration, truth: Truth) -> Calibration:
    """A calibration with the bench's true numbers; the sensor's stays as it was measured."""
    parts = dict(calibration.parts)
    if "registration" in parts:
        parts["registration"] = replace(
            parts["registration"],
            matrix=np.asarray(truth["matrix"]),
            blur=float(truth["blur"]),
            leakage=1 / truth["contrast_ratio"],
        )
        parts["timing"] = replace(parts["timing"], delay=truth["delay"], ratio=truth["ratio"], leakage=truth["leakage"])
    if "dispersion" in parts:
        fine = tuple(np.asarray(truth[f"fine_{name}"]) for name in ("wavelengths", "shifts", "response"))
        known = {f.name: getattr(parts["dispersion"], f.name) for f in fields(MeasuredDispersion)}
        parts["dispersion"] = TrueDispersion(**known, fine=(fine[0], fine[1], fine[2]))
    if "shear" in parts:
        places = parts["shear"].places
        light = 1 - truth["fall_off"] * (places**2).sum(axis=1)
        parts["shear"] = replace(parts["shear"], step=np.asarray(truth["step"]), light=light)
    for name in [name for name in parts if name.startswith("wavefront")]:
        own = truth["coefficients"][int(name.removeprefix("wavefront"))]
        parts[name] = replace(parts[name], coefficients=np.asarray(own))
    true = Calibration(parts, calibration.about, calibration.path)
    # without the settings of the fit, which know the leakage of the mask as it was measured
    return true.with_part("timing", parts["timing"], {}) if "timing" in parts else true


def _without_leaks(calibration: Calibration) -> Calibration:
    """As if codes were shut where they are closed."""
    registration, timing = calibration.part("registration"), calibration.part("timing")
    shut = {"registration": replace(registration, leakage=None), "timing": replace(timing, leakage=0.0)}
    return Calibration({**calibration.parts, **shut}, calibration.about, calibration.path)


def _estimate(taken: Snapshot[Any]) -> Array:
    """Linear least mean squares under the rendered scenes' prior, which has not seen the scene."""
    estimate = tmca.reconstruct(taken, "lmmse").to_xarray()
    return np.asarray(estimate["estimate"].values, dtype=np.float64)


def _explained(taken: Snapshot[Any], scene: Array) -> float:
    """Snapshot over what the operator's image of the true scene leaves of it, dB."""
    light = torch.from_numpy(scene)[None].float()
    with torch.no_grad():
        if isinstance(taken.camera, SpectralDepthCamera):
            image = taken.camera.A(light, torch.full((1, 1, *taken.camera.size), DEPTH))
        else:
            image = taken.camera.A(light)
    left = (image - taken.values).square().mean()
    return float(10 * torch.log10(taken.values.square().mean() / left))


def reconstructions_figure(proof: Proof) -> Figure:
    """Truth and the reconstructions of the first spectral bench."""
    return reconstruction_figure(proof.cubes, list(proof.wavelengths), proof.scene)


def table_of(results: Mapping[str, Any]) -> str:
    """A line per quantity with its bound, then the reconstructions."""
    lines = [f"{'worst of ' + str(results['seeds']) + ' benches':<44} {'error':>10} {'bound':>8}"]
    for row in results["errors"]:
        bound = "" if row["bound"] is None else f"{row['bound']:g}"
        mark = "" if row["bound"] is None or row["error"] <= row["bound"] else "  missed"
        lines.append(f"{row['quantity'] + ' (' + row['unit'] + ')':<44} {row['error']:>10.4g} {bound:>8}{mark}")
    lines.append(f"\n{'camera':<16}{'operator':<30} {'PSNR (dB)':>10} {'snapshot explained (dB)':>25}")
    for row in results["reconstruction"]:
        psnr = "" if row["psnr"] is None else f"{row['psnr']:.2f}"
        lines.append(f"{row['camera']:<16}{row['operator']:<30} {psnr:>10} {row['explained']:>25.1f}")
    return "\n".join(lines)
