"""What fine-tuning on captures gains: ``python -m studies.fine_tuning --data data --out page.md``.

A network is trained in simulation for the spectral camera as drawn. A rendered bench with hidden faults (registration,
blur, dispersion, timing, response, sensor) captures parts of the training scenes and of scenes that nothing learns
from. The network is fine-tuned on some of the former, through the camera as drawn, whose sensor alone is calibrated,
and through the calibrated camera. Three captures choose the step; scenes that nothing learns from judge. A run that
was stopped resumes in ``--work``.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, cast

import numpy as np

from studies.bench import (
    Calibration,
    find_calibration,
    load_calibration,
    measured_sensor,
    training_of,
)
from studies.grid import repository_commit
from studies.rendered_bench import calibrate_bench, capture_scenes, nominal_spectral, write_bench
from studies.tables import Column, table, write_results
from tmca.cameras import CodedCamera, Snapshot
from tmca.data import at_bands, load_scene, read_split
from tmca.decoders import Weights
from tmca.errors import SettingError
from tmca.plots import reconstruction_figure, save_figure
from tmca.training import train, training_settings
from tmca.tuning import FineTuning, decoded, prepared, read_pair

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

SENSOR = ("dark", "flat", "linearity")
"""What is measured of the sensor alone; all else is as drawn."""
_GRID, _HELD_OUT = 2, 3
_COLUMNS = (
    Column("operator"),
    Column("learned", "captures learned from"),
    Column("step", "step kept"),
    Column("held_out", "held out, dB", ".2f"),
    Column("judged", "judged, dB", ".2f"),
)
Told = Callable[[str], None]


class Row(TypedDict):
    """A network: captures that it learned from, its best step, and mean PSNR in dB, and that of each capture."""

    operator: str
    captures: int
    step: int
    held_out: float
    judged: float
    each: dict[str, float]


class Results(TypedDict):
    """What ``fine-tuning.json`` holds."""

    rows: list[Row]
    held_out: list[str]
    judged: list[str]
    learned: list[str]
    size: list[int]
    slots: int
    steps: list[int]
    rate: float
    seed: int


@dataclass(frozen=True)
class TuningProof:
    """What is compared.

    Args:
        work: folder of bench, calibrations and runs; what is there is used.
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

    def run(self, told: Told = print) -> tuple[Results, Figure]:
        """Render, calibrate, train, fine-tune, judge: results, and a picture of the first scene that is judged.

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
        rows: dict[tuple[str, int], Row] = {}
        estimates: dict[str, np.ndarray] = {}
        for operator, used in {"as drawn": calibration.only(*SENSOR), "calibrated": calibration}.items():
            for count in self.counts:
                told(f"{operator}, {count} captures")
                run = self._ready(weights, used, list(parts)[:count], held)
                tuned = self._tuned(run, operator)
                for row in self._rows(run, tuned, operator, held, list(apart)):
                    rows[operator, row["captures"]] = row
            estimates |= self._decoded(run, tuned, operator, next(iter(apart)))
        truth = next(iter(apart.values()))
        figure = reconstruction_figure(estimates, truth["wavelength"].values.tolist(), truth.values)
        return self._results(list(rows.values()), held, list(apart)), figure

    def _results(self, rows: list[Row], held: list[str], judged: list[str]) -> Results:
        return {
            "rows": rows, "held_out": held, "judged": judged, "learned": [Path(name).name for name in self.learned],
            "size": list(self.size), "slots": self.slots, "steps": list(self.steps), "rate": self.rate,
            "seed": self.seed,
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

    def _bench(self, scenes: Mapping[str, xr.DataArray]) -> Calibration:
        """Captures and calibration of the bench, rendered once."""
        folder, prefix = self.work / "bench", self.work / "calibration"
        if not folder.exists():
            self.work.mkdir(parents=True, exist_ok=True)
            write_bench(folder, size=self.size, slots=self.slots, seed=self.seed)
        if not (folder / "captures").exists():
            capture_scenes(folder / "captures", self.size, self.slots, self.seed, scenes)
        if not any(self.work.glob("calibration_*.nc")):
            calibrate_bench(folder).save(prefix)
        return load_calibration(find_calibration(prefix))

    def _trained(self, calibration: Calibration) -> Weights:
        """The network, trained in simulation for the camera as drawn with the noise of the bench."""
        capture = self.work / "bench" / "snapshot.nc"
        camera: Any = Snapshot.load(capture).camera
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

    def _ready(self, weights: Weights, calibration: Calibration, names: list[str], held: list[str]) -> FineTuning:
        """Fine-tuning on some captures."""
        assert weights.path is not None
        changes = {"data.train": names, "optimiser.steps": self.steps[1], "optimiser.decoder_rate": self.rate}
        captures = self.work / "bench" / "captures"
        changes |= {"seed": self.seed}
        return prepared(weights.path, captures, calibration, validation=held, changes=changes)

    def _tuned(self, run: FineTuning, operator: str) -> Weights:
        """The weights that come out, made once."""
        folder = self.work / f"{operator.replace(' ', '-')}-{len(run.settings.data.train)}"
        run.run(folder)
        return Weights.load(folder)

    def _rows(self, run: FineTuning, tuned: Weights, operator: str, held: list[str], judged: list[str]) -> list[Row]:
        """Before and after."""
        before: Any = run.weights
        count, step = len(run.settings.data.train), int(tuned.card["best"]["step"])
        rows: list[Row] = []
        for captures, at, network in ((0, 0, before.network), (count, step, tuned.network)):
            psnr = {name: self._psnr(run, tuned, network, name) for name in (*held, *judged)}
            means = [float(np.mean([psnr[name] for name in names])) for names in (held, judged)]
            rows.append({"operator": operator, "captures": captures, "step": at, "held_out": means[0],
                         "judged": means[1], "each": psnr})  # fmt: skip
        return rows

    def _psnr(self, run: FineTuning, tuned: Weights, network: Any, name: str) -> float:
        """Of a capture, dB."""
        camera = cast(CodedCamera, run.camera.cpu())
        pair, _ = read_pair(run.pairs[name], run.weights, run.calibration)
        error = np.square(decoded(network, tuned.load_prior(), pair, camera) - pair.truth).mean()
        return float(-10 * np.log10(error))

    def _decoded(self, run: FineTuning, tuned: Weights, operator: str, name: str) -> dict[str, np.ndarray]:
        """Estimates (L, H, W) of a capture before and after, by what they are called."""
        before, camera = run.weights, cast(CodedCamera, run.camera.cpu())
        pair, _ = read_pair(run.pairs[name], before, run.calibration)
        after = f"\ntuned on {len(run.settings.data.train)} captures"
        networks: dict[str, Any] = {"": before.network, after: tuned.network}
        return {
            f"{operator}{how}": decoded(network, tuned.load_prior(), pair, camera)[0]
            for how, network in networks.items()
        }


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


def page(found: Results, command: str, commit: str | None) -> str:
    """The result as Markdown."""
    first, then = found["steps"]
    size = "×".join(map(str, found["size"]))
    rows = [{**row, "learned": row["captures"] or "none, as trained in simulation"} for row in found["rows"]]
    lines = ["# Fine-tuning a decoder on captures of its bench", "", f"Command: `{command}` at commit `{commit}`.", ""]
    lines += [f"{size} pixels, K = {found['slots']}; {first} steps in simulation, {then} of "
              f"fine-tuning at a rate of {found['rate']:g}. Mean PSNR of {len(found['held_out'])} captures that "
              f"choose the step, and of {len(found['judged'])} of scenes that nothing learns from.", ""]  # fmt: skip
    lines += [table(rows, _COLUMNS)]
    lines += ["![A scene that nothing learned from, decoded by every operator before and after](fine-tuning.png)", ""]
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """The command line of this study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, help="folder with splits/ and cubes; rendered scenes without")
    parser.add_argument("--work", type=Path, default=Path("runs/fine-tuning"))
    parser.add_argument("--out", type=Path, default=Path("runs/fine-tuning.md"), help="page; .json and .png beside it")
    parser.add_argument("--counts", default="1,4,12", help="captures that are learned from")
    parser.add_argument("--steps", default="400,200", help="in simulation, and of fine-tuning")
    parser.add_argument("--rate", type=float, default=1e-4)
    given = parser.parse_args(arguments)
    learned, judged = ["astronaut", "chelsea", "rocket", "retina", "motorcycle"], ["coffee"]
    if given.data:
        lists = given.data / "splits"
        cubes, apart = ([str(p) for p in read_split(lists / f"spectral_{part}.txt")] for part in ("train", "val"))
        learned, judged = [*cubes, *learned[:3]], [*apart, "coffee", "motorcycle"]
    counts, steps = (tuple(map(int, text.split(","))) for text in (given.counts, given.steps))
    proof = TuningProof(given.work, learned, judged, counts=counts, steps=(steps[0], steps[1]), rate=given.rate)
    found, figure = proof.run(lambda said: print(said, flush=True))
    command = shlex.join(["python", "-m", "studies.fine_tuning", *(sys.argv[1:] if arguments is None else arguments)])
    text = page(found, command, repository_commit())
    write_results(found, text, given.out.with_suffix(".json"), overwrite=True)
    save_figure(figure, given.out.with_suffix(".png"), overwrite=True)
    print(text)


if __name__ == "__main__":
    main()
