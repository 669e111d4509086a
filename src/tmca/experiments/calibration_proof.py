"""Calibration held against the hidden truth of rendered benches, and what it is worth in a reconstruction."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import ArrayLike

from tmca.cameras import Snapshot, SpectralDepthCamera
from tmca.errors import SettingError
from tmca.lab.calibration.apply import calibrated_snapshot
from tmca.lab.calibration.bench_physics import REFERENCE
from tmca.lab.calibration.dispersion import MeasuredDispersion
from tmca.lab.calibration.file import Calibration
from tmca.lab.calibration.fits import Told
from tmca.lab.calibration.psf import wavefront_rms
from tmca.lab.calibration.rendered_bench import DEPTH, NAME, WAVES, write_bench
from tmca.lab.calibration.steps import measure_all
from tmca.lab.frames import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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


@dataclass
class Proof:
    """Errors of every bench, and reconstructions of their snapshots.

    Args:
        seeds: benches of each camera.
        snr_db: of their captures.
        found: quantity → errors.
        rows: of reconstructions: camera, seed, operator, psnr, explained.
        cubes: of seed 0 of the spectral camera: operator → estimate (L, H, W).
        scene: the truth of these.
        wavelengths: (L,) metres of these.
    """

    seeds: int
    snr_db: float
    found: dict[str, list[float]] = field(default_factory=dict)
    rows: list[dict[str, Any]] = field(default_factory=list)
    cubes: dict[str, np.ndarray] = field(default_factory=dict)
    scene: np.ndarray | None = None
    wavelengths: tuple[float, ...] = ()

    def add(self, quantity: str, error: float) -> None:
        """One more error."""
        self.found.setdefault(quantity, []).append(float(error))

    def stated(self) -> dict[str, Any]:
        """Worst errors beside their bounds, and means over benches of the reconstructions."""
        errors = [
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

    def _mean(self, camera: str, operator: str) -> dict[str, Any]:
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
    if seeds < 1:
        raise SettingError("--seeds", str(seeds), "1 or more")
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


def calibrate_bench(folder: Path) -> Calibration:
    """Every step of a camera, as ``tmca calibrate all`` measures them."""
    told = Told(wavelength=REFERENCE, camera=folder / "snapshot.nc")
    *_, (_, found) = measure_all(folder, Calibration.empty(NAME), told)
    return found


def _compare(proof: Proof, calibration: Calibration, truth: dict[str, Any]) -> None:
    """Errors of what was measured."""
    proof.add("electrons per digital number", abs(calibration.part("linearity").gain / truth["gain"] - 1))
    part = calibration.part("registration")
    if part is not None:
        proof.add("registration", part.offset(truth["matrix"]))
        timing = calibration.part("timing")
        proof.add("delay of the shutter", abs(timing.delay - truth["delay"]))
        proof.add("duration of its slots", abs(timing.ratio / truth["ratio"] - 1))
        proof.add("leakage of the aperture", abs(part.leakage - 1 / truth["contrast_ratio"]))
        proof.add("leakage of the shutter", abs(timing.leakage - truth["leakage"]))
    part = calibration.part("dispersion")
    if part is not None:
        proof.add("dispersion", np.abs(part.at(WAVES) - truth["shifts"]).max())
        known = truth["response"] / np.mean(truth["response"])
        proof.add("response κ", np.abs(part.response_at(WAVES) / known - 1).max())
    part = calibration.part("shear")
    if part is not None:
        proof.add("shear", np.abs(part.step - truth["step"]).max())
    for slot, own in enumerate(truth["coefficients"]):
        part = calibration.part(f"wavefront{slot}")
        if part is not None:
            bench = _bench_of(calibration)
            proof.add("wavefront", wavefront_rms(part.coefficients - own, bench, REFERENCE))


def _bench_of(calibration: Calibration) -> Any:
    from tmca.optics import PhaseMaskBench

    window = calibration.part("psf0").values.shape[2:]
    return PhaseMaskBench(window=(int(window[0]), int(window[1])))


def _reconstruct(
    proof: Proof, folder: Path, camera: str, seed: int, calibration: Calibration, truth: dict[str, Any]
) -> None:
    """The snapshot by the nominal, the calibrated and the true operator, digital numbers corrected alike in all."""
    raw, scene = Snapshot.load(folder / "snapshot.nc"), _scene(folder)
    operators = {
        "nominal": calibration.only(*_SENSOR),
        "calibrated": calibration,
        "true": true_calibration(calibration, truth),
        **{f"without {name}": calibration.without(name) for name in _OPTICS[camera]},
    }
    if "timing" in _OPTICS[camera]:
        operators["without contrast and leakage"] = _without_leaks(calibration)
    for name, own in operators.items():
        taken = calibrated_snapshot(raw, own)
        estimate = None if camera == "spectral-depth" else _estimate(taken)
        psnr = None if estimate is None else -10 * np.log10(float(((estimate - scene) ** 2).mean()))
        row = {"camera": camera, "seed": seed, "operator": name, "psnr": psnr, "explained": _explained(taken, scene)}
        proof.rows.append(row)
        if camera == "spectral" and seed == 0 and estimate is not None and not name.startswith("without"):
            proof.cubes[name], proof.scene, proof.wavelengths = estimate, scene, taken.camera.wavelengths


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


def true_calibration(calibration: Calibration, truth: dict[str, Any]) -> Calibration:
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
    return Calibration(parts, calibration.about, calibration.path)


def _without_leaks(calibration: Calibration) -> Calibration:
    """As if codes were shut where they are closed."""
    registration, timing = calibration.part("registration"), calibration.part("timing")
    shut = {"registration": replace(registration, leakage=None), "timing": replace(timing, leakage=0.0)}
    return Calibration({**calibration.parts, **shut}, calibration.about, calibration.path)


def _scene(folder: Path) -> Array:
    import xarray as xr

    with xr.open_dataset(folder / "scene.nc", engine="h5netcdf") as stored:
        return np.asarray(next(iter(stored.data_vars.values())).values, dtype=np.float64)


def _estimate(taken: Snapshot[Any]) -> np.ndarray:
    """Linear least mean squares under the rendered scenes' prior, which has not seen the scene."""
    from tmca.experiments.light_field.imaging import reconstruct_light_field
    from tmca.experiments.spectral.imaging import reconstruct_snapshot

    if taken.camera.kind == "spectral":
        return np.asarray(reconstruct_snapshot(taken).cube.values, dtype=np.float64)
    return np.asarray(reconstruct_light_field(taken).light_field.values, dtype=np.float64)


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
    from tmca.plots.cube import reconstruction_figure

    return reconstruction_figure(proof.cubes, list(proof.wavelengths), proof.scene)
