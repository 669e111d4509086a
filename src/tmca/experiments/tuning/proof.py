"""What fine-tuning gains on a rendered bench with hidden faults: before and after, calibrated or not, few or many."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.cameras import Snapshot
from tmca.data.fitting import at_bands
from tmca.data.scenes import load_scene
from tmca.decoders import Weights
from tmca.errors import SettingError
from tmca.experiments.calibration_proof import calibrate_bench
from tmca.experiments.spectral.own_camera import training_of
from tmca.experiments.tuning.pairs import read_pair
from tmca.experiments.tuning.pictures import decoded
from tmca.experiments.tuning.run import Prepared, prepared
from tmca.lab.calibration.file import Calibration, find_calibration, load_calibration
from tmca.lab.calibration.measured_cameras import measured_sensor
from tmca.lab.calibration.rendered_bench import nominal_spectral, write_bench
from tmca.plots.cube import reconstruction_figure
from tmca.training import train, training_settings

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

SENSOR = ("dark", "flat", "linearity")
"""What is measured of the sensor alone; all else is as drawn."""
_GRID, _HELD_OUT = 2, 3
Told = Callable[[str], None]


@dataclass(frozen=True)
class TuningProof:
    """What is compared.

    Args:
        work: folder of bench, calibrations and runs, which is gone on with.
        learned: cubes and rendered scenes that the network is trained on in simulation, and parts of which are
            captured to fine-tune it.
        judged: scenes that nothing learns from.
        size: (H, W) of the bench, pixels.
        slots: K.
        counts: captures that are learned from.
        steps: of the training in simulation, and of fine-tuning.
        rate: learning rate of fine-tuning.
        seed: of the bench, the codes and the runs.
    """

    work: Path
    learned: Sequence[str]
    judged: Sequence[str]
    size: tuple[int, int] = (64, 80)
    slots: int = 4
    counts: Sequence[int] = (1, 4, 12)
    steps: tuple[int, int] = (400, 200)
    rate: float = 1e-4
    seed: int = 0

    def run(self, told: Told = print) -> tuple[dict[str, Any], Figure]:
        """Render, calibrate, train, fine-tune, judge: JSON values, and a picture of the first scene that is judged.

        Raises:
            DataError, SettingError: scenes that cannot be used, or too few.
        """
        camera = nominal_spectral(self.size, self.slots, self.seed)
        parts, apart = (self._parts(names, camera.wavelengths) for names in (self.learned, self.judged))
        held = list(parts)[-_HELD_OUT:]
        if max(self.counts) > len(parts) - _HELD_OUT or set(parts) & set(apart):
            found = f"{len(parts)} parts of scenes to learn from"
            raise SettingError("--learn", found, f"{max(self.counts) + _HELD_OUT}, none of them judged", "name others")
        told("bench")
        calibration = self._bench({**parts, **apart})
        told("training in simulation")
        weights = self._trained(calibration)
        rows, estimates = [], dict[str, Any]()
        for operator, own in {"as drawn": calibration.only(*SENSOR), "calibrated": calibration}.items():
            for count in self.counts:
                told(f"{operator}, {count} captures")
                run = self._ready(weights, own, list(parts)[:count], held)
                tuned = self._tuned(run, operator)
                rows += self._rows(run, tuned, operator, held, list(apart))
            estimates |= self._decoded(run, tuned, operator, next(iter(apart)))
        result = {"rows": _once(rows), "held_out": held, "judged": list(apart), **self._stated()}
        return result, self._figure(estimates, apart)

    def _stated(self) -> dict[str, Any]:
        return {
            "learned": [Path(name).name for name in self.learned], "size": list(self.size), "slots": self.slots,
            "steps": list(self.steps), "rate": self.rate, "seed": self.seed,
        }  # fmt: skip

    def _parts(self, names: Sequence[str], wavelengths: Sequence[float]) -> dict[str, xr.DataArray]:
        """Parts of scenes of the bench's size by name: the first of every scene, then the second, …"""
        cut = [_parts_of(name, wavelengths, self.size) for name in names]
        return {
            f"{Path(name).stem}-{i}": parts[i]
            for i in range(_GRID**2)
            for name, parts in zip(names, cut, strict=True)
            if i < len(parts)
        }

    def _bench(self, scenes: Mapping[str, Any]) -> Calibration:
        """Captures and calibration of the bench, rendered once."""
        folder, prefix = self.work / "bench", self.work / "calibration"
        if not folder.exists():
            self.work.mkdir(parents=True, exist_ok=True)
            write_bench(folder, size=self.size, slots=self.slots, seed=self.seed, scenes=scenes)
        if not any(self.work.glob("calibration_*.nc")):
            calibrate_bench(folder).save(prefix)
        return load_calibration(find_calibration(prefix))

    def _trained(self, calibration: Calibration) -> Weights:
        """The network, trained in simulation for the camera as drawn with the noise of the bench."""
        capture = self.work / "bench" / "snapshot.nc"
        camera = Snapshot.load(capture).camera
        noise = measured_sensor(camera, calibration).settings()
        changes = training_of(capture)[0] | {
            "data.train": list(self.learned), "data.validation": [], "data.shares": [1, 0, 0], "data.batch": 8,
            "data.pool": 384, "data.patch": min(48, *self.size), "optimiser.steps": self.steps[0], "seed": self.seed,
            "noise": [{"read_noise": noise["read_noise"], "full_well": noise["full_well"]}], "decoder.stages": 2,
        }  # fmt: skip
        settings = training_settings("spectral", "quick", None, changes)

        def load(name: str) -> xr.DataArray:
            return at_bands(load_scene(name, bands=None), camera.wavelengths)

        return Weights.load(train(settings, self.work / "simulated", load).weights)

    def _ready(self, weights: Weights, calibration: Calibration, names: list[str], held: list[str]) -> Prepared:
        """Fine-tuning on some captures."""
        assert weights.path is not None
        changes = {"data.train": names, "optimiser.steps": self.steps[1], "optimiser.decoder_rate": self.rate}
        changes |= {"seed": self.seed}
        captures = self.work / "bench" / "captures"
        return prepared(weights.path, captures, calibration, validation=held, changes=changes)

    def _tuned(self, run: Prepared, operator: str) -> Weights:
        """The weights that come out, made once."""
        folder = self.work / f"{operator.replace(' ', '-')}-{len(run.settings.data.train)}"
        run.run(folder)
        return Weights.load(folder)

    def _rows(
        self, run: Prepared, tuned: Weights, operator: str, held: list[str], judged: list[str]
    ) -> list[dict[str, Any]]:
        """Before and after."""
        before: Any = run.tuning.weights
        count, step = len(run.settings.data.train), tuned.card["best"]["step"]
        return [
            {"operator": operator, "captures": own, "step": at, **self._judge(run, tuned, network, held, judged)}
            for own, at, network in ((0, 0, before.network), (count, step, tuned.network))
        ]

    def _decoded(self, run: Prepared, tuned: Weights, operator: str, name: str) -> dict[str, Any]:
        """Estimates (L, H, W) of a capture before and after, by what they are called."""
        before: Any = run.tuning.weights
        camera: Any = run.tuning.camera.cpu()
        pair, _ = read_pair(run.pairs[name], before, run.calibration)
        networks = {"": before.network, f"\ntuned on {len(run.settings.data.train)} captures": tuned.network}
        return {
            f"{operator}{how}": decoded(one, tuned.load_prior(), pair, camera).numpy()[0]
            for how, one in networks.items()
        }

    def _figure(self, estimates: Mapping[str, Any], scenes: Mapping[str, xr.DataArray]) -> Figure:
        truth = next(iter(scenes.values()))
        return reconstruction_figure(estimates, truth["wavelength"].values.tolist(), truth.values)

    def _judge(self, run: Prepared, tuned: Weights, network: Any, held: list[str], judged: list[str]) -> dict[str, Any]:
        """PSNR of captures that chose the step, and of those that nothing learned from."""
        prior, found = tuned.load_prior(), {}
        camera: Any = run.tuning.camera.cpu()
        for name in (*held, *judged):
            pair, _ = read_pair(run.pairs[name], run.tuning.weights, run.calibration)
            error = np.square(decoded(network, prior, pair, camera).numpy() - pair.truth).mean()
            found[name] = float(-10 * np.log10(error))
        means = {
            what: float(np.mean([found[n] for n in own])) for what, own in {"held_out": held, "judged": judged}.items()
        }
        return {**means, "each": found}


def _parts_of(name: str, wavelengths: Sequence[float], size: tuple[int, int]) -> list[xr.DataArray]:
    """Up to four parts of a scene, from corner to corner, pixels averaged so that they show much of it."""
    cube = at_bands(load_scene(name, bands=None), wavelengths)
    sides = (int(cube.sizes["y"]), int(cube.sizes["x"]))
    by = max(1, min(n // m for n, m in zip(sides, size, strict=True)) // _GRID)
    small = cube.coarsen(y=by, x=by, boundary="trim").mean()
    tops, lefts = (_places(int(small.sizes[axis]), n) for axis, n in zip(("y", "x"), size, strict=True))
    found = [(top, left) for top in tops for left in lefts]
    return [small[:, top : top + size[0], left : left + size[1]].astype("float32") for top, left in found]


def _places(length: int, side: int) -> list[int]:
    """First rows or columns of parts that do not overlap.

    Raises:
        SettingError: a scene smaller than a part.
    """
    count = min(_GRID, length // side)
    if not count:
        raise SettingError("--size", f"{side} pixels", f"{length} at most, those of the smallest scene")
    return [round(i * (length - side) / max(1, count - 1)) for i in range(count)]


def _once(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows of each operator and number of captures, the same ones left out."""
    return list({(row["operator"], row["captures"]): row for row in rows}.values())
