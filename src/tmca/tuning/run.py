"""From a trained run, a calibration and a folder of captures to a decoder that knows its bench."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from shutil import rmtree
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tmca.data import atomic_path, checksum_of
from tmca.decoders import Weights
from tmca.errors import DataError, SettingError
from tmca.lab.calibration.file import Calibration, load_calibration
from tmca.training.camera_training import TRAININGS
from tmca.training.folder import WEIGHTS
from tmca.training.loop import Setup
from tmca.training.patches import Patch
from tmca.training.run import Trained, carry_out
from tmca.training.scenes import SceneLists
from tmca.tuning.captures import Captures, Pair, ReadPair
from tmca.tuning.folder import PairFiles, find_pairs, held_out
from tmca.tuning.pairs import read_pair
from tmca.tuning.settings import TuningSettings, tuning_settings
from tmca.tuning.system import TunedSystem

if TYPE_CHECKING:
    from lightning_fabric import Fabric


@dataclass(frozen=True)
class FineTuning:
    """A run of fine-tuning, checked and ready.

    Args:
        weights: of the run before.
        camera: that took the captures, calibrated or as the run has it.
        settings: of the run.
        pairs: by the names of the captures.
        calibration: of the camera, None without.
    """

    weights: Weights
    camera: Any
    settings: TuningSettings
    pairs: Mapping[str, PairFiles]
    calibration: Calibration | None

    def read(self, name: str) -> Pair:
        """A capture with its truth."""
        return read_pair(self.pairs[name], self.weights, self.calibration)[0]

    def run(
        self, folder: Path, read: ReadPair | None = None, *, finish: Callable[[], None] | None = None, **how: Any
    ) -> Trained:
        """Fine-tune, or go on with a run that was stopped; the step that is saved is never worse on the captures that
        are held out than the decoder as it was, which is step 0.

        Args:
            folder: of the run, see `tmca.training.train`.
            read: of a capture with its truth, by its name; `read` without.
            finish: called when it is done, while other runs are still kept out of the folder.
            how: see `tmca.training.train`.

        Raises:
            OutputError: the folder holds another run.
            SettingError, DataError: a network that does not fit the camera, or captures that cannot be read.
            TrainingError: a loss that is not finite.
        """
        data, steps = self.settings.data, self.settings.optimiser.steps
        prepare = partial(self.set_up, folder=folder, read=read or self.read)

        def done() -> None:
            rmtree(folder / "starts", ignore_errors=True)
            if finish:
                finish()

        lists = SceneLists(data.train, data.validation)
        return carry_out(prepare, self.settings, folder, lists, steps, finish=done, **how)

    def set_up(self, settings: TuningSettings, fabric: Fabric, folder: Path, read: ReadPair) -> Setup:
        """Network, captures and windows of a run."""
        if fabric.is_global_zero:
            self._copy_prior(folder)
        fabric.barrier()
        data, weights = settings.data, self._tuned(folder)
        captures = Captures((*data.train, *data.validation), len(data.train), read, folder)
        parts = (self.camera, weights.network, (self.camera.sensor,), weights.load_prior())
        simulated = TRAININGS[self.camera.kind].system(settings, *parts)
        system = TunedSystem(simulated, captures, data.patch, data.batch, settings.seed)

        def patch(step: int, index: int) -> Patch:
            return captures.patch(system.windows(step, index))

        def save(best: dict[str, Any]) -> None:
            card = {**weights.card, "best": best, "tuning": settings.model_dump(mode="json")}
            replace(weights, card=card).save(folder / WEIGHTS, overwrite=True)

        return Setup(system, patch, save)

    def _tuned(self, folder: Path) -> Weights:
        """A copy of the network with the camera of the captures, as weights in this folder."""
        copied = replace(self.weights, network=deepcopy(self.weights.network), path=folder / WEIGHTS)
        calibrated = self.calibration is not None
        variables = Weights.of(copied.network, self.camera).variables if calibrated else copied.variables
        return replace(copied, variables=variables)

    def _copy_prior(self, folder: Path) -> None:
        """A copy of the prior that the network starts from, beside its weights."""
        prior, path = self.weights.prior, self.weights.path
        if prior in ("", "rendered") or path is None or (folder / prior).exists():
            return
        with atomic_path(folder / prior, overwrite=True) as temporary:
            temporary.write_bytes((path.parent / prior).read_bytes())


def prepared(
    weights: str | Path,
    captures: str | Path,
    calibration: str | Path | Calibration | None = None,
    *,
    validation: Sequence[str] | None = None,
    changes: Mapping[str, Any] | None = None,
) -> FineTuning:
    """Read and check everything that a run of fine-tuning needs, before anything is written.

    Args:
        weights: the run to go on from: its folder or weights file, or a camera that comes with tmca: ``"default"``
            (spectral, K = 8), ``"default-light-field"``, ``"default-spectral-depth"``.
        captures: folder of them, see ``find_pairs``.
        calibration: of the camera; None for the run's own operator.
        validation: captures that are held out, see ``held_out``.
        changes: settings by dotted name.

    Raises:
        DataError: weights, a calibration or captures that cannot be used, or do not belong together.
        SettingError: impossible settings, or a network of any codes.
    """
    before = Weights.find(weights)
    before.check_codes()
    pairs = {pair.name: pair for pair in find_pairs(captures)}
    seed = (changes or {}).get("seed", 0)
    learned, apart = held_out(list(pairs), validation, seed if isinstance(seed, int) else 0)
    used = load_calibration(calibration) if isinstance(calibration, str | Path) else calibration
    described = _sources(before, pairs, used) | {"data": {"train": tuple(learned), "validation": tuple(apart)}}
    settings = tuning_settings(described, before.card, changes or {})
    return FineTuning(before, _one_camera(before, pairs, used), settings, pairs, used)


def _sources(weights: Weights, pairs: Mapping[str, PairFiles], calibration: Calibration | None) -> dict[str, Any]:
    """Where everything comes from, with checksums."""

    def source(path: Path | None) -> dict[str, str] | None:
        return None if path is None else {"path": str(path), "sha256": checksum_of(path)}

    return {
        "weights": source(weights.path),
        "calibration": source(None if calibration is None else calibration.path),
        "captures": {
            name: {"capture": source(files.capture), "truth": source(files.truth)} for name, files in pairs.items()
        },
    }


def _one_camera(weights: Weights, pairs: Mapping[str, PairFiles], calibration: Calibration | None) -> Any:
    """The camera of all captures.

    Raises:
        DataError: captures of different sizes, or see ``read_pair``.
    """
    first = None
    for files in pairs.values():
        camera = read_pair(files, weights, calibration)[1]
        first = first or camera
        if camera.size != first.size:
            found, wanted = ("×".join(map(str, one.size)) for one in (camera, first))
            remedy = "fine-tune on captures of one size"
            raise DataError(files.capture, f"a scene of {found} pixels", f"{wanted}, as the captures before", remedy)
    if first is None:
        raise SettingError("--captures", "none", "some")
    return first


def tuning_pictures(prepared: FineTuning, folder: Path) -> list[Path]:
    """Write ``before_after.png``, the first capture that was held out, decoded by the network as it was and as it is
    through the same operator, and what every run has into a run's folder, in the place of earlier ones."""
    from tmca.plots.style import save_figure
    from tmca.reports.training import training_pictures

    pair, camera = prepared.read(prepared.settings.data.validation[0]), prepared.camera.cpu()
    tuned = Weights.load(folder)
    networks, prior = {"before": prepared.weights.network, "fine-tuned": tuned.network}, tuned.load_prior()
    estimates = {name: decoded(network, prior, pair, camera) for name, network in networks.items()}
    figure = TRAININGS[camera.kind].figure(estimates, pair.truth, camera)
    return [*training_pictures(folder), save_figure(figure, folder / "before_after.png", overwrite=True)]


def decoded(network: Any, prior: Any, pair: Pair, camera: Any) -> NDArray[np.float32]:
    """(B, L, H, W) estimate of a capture; its last channel is inverse depth where that of the truth is."""
    return TRAININGS[camera.kind].decode(network, prior, pair.values, camera.replace(sensor=pair.sensor))
