"""A trained decoder that goes on learning, from captures with their truth: camera and codes stay as they are."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from shutil import rmtree
from typing import TYPE_CHECKING, Any, cast

from tmca.cameras import CodedCamera, SpectralDepthCamera
from tmca.data import atomic_path
from tmca.decoders import Weights
from tmca.training.patches import Load, Patch
from tmca.training.run import Prepared, Trained, train
from tmca.training.scenes import SceneLists
from tmca.training.tuning.captured import KeptCaptures, ReadPair, Windows
from tmca.training.tuning.imaging import TunedImaging
from tmca.training.tuning.settings import WHOLE, TuningSettings
from tmca.training.tuning.spectral_depth import TunedDepth

if TYPE_CHECKING:
    from lightning_fabric import Fabric


@dataclass(frozen=True)
class Tuning:
    """What is fine-tuned.

    Args:
        weights: of the run that is gone on from.
        camera: that took the captures, calibrated or as the run knows it.
        calibrated: whether ``camera`` is another one than the run's.
    """

    weights: Weights
    camera: CodedCamera | SpectralDepthCamera
    calibrated: bool = False

    def tuned(self, folder: Path) -> Weights:
        """A copy of the network with the camera of the captures, as weights in this folder."""
        path = folder / "weights.safetensors"
        copied = replace(self.weights, network=deepcopy(self.weights.network), path=path)
        calibrated = Weights.of(copied.network, self.camera).variables if self.calibrated else copied.variables
        return replace(copied, variables=calibrated)


def tune(tuning: Tuning, settings: TuningSettings, folder: Path, read: ReadPair, **how: Any) -> Trained:
    """Fine-tune a decoder, or go on with a run that was stopped; the step that is kept is never worse on the captures
    that are held out than the decoder as it was, which is step 0.

    Args:
        tuning: network and camera.
        settings: of the run.
        folder: of the run, see ``train``.
        read: of a capture with its truth, by its name.
        how: see ``train``.

    Raises:
        OutputError: the folder holds another run.
        SettingError, DataError: a network that does not fit the camera, or captures that cannot be read.
        TrainingError: a loss that is not finite.
    """
    found = train(partial(_prepare, tuning, read), settings, folder, cast(Load, read), **how)
    rmtree(folder / "starts", ignore_errors=True)
    return found


def _prepare(
    tuning: Tuning,
    read: ReadPair,
    settings: TuningSettings,
    folder: Path,
    load: Load,
    lists: SceneLists,
    fabric: Fabric,
) -> Prepared:
    names = (*lists.train, *lists.validation)
    if fabric.is_global_zero:
        _bring_prior(tuning.weights, folder)
    fabric.barrier()
    captures = KeptCaptures(names, len(lists.train), read, folder)
    tuned = tuning.tuned(folder)
    windows = Windows(
        captures.learned, captures.size, settings.data.patch or WHOLE, mixes_columns(tuning.camera),
        settings.data.batch, settings.seed,
    )  # fmt: skip
    system = _system(tuned, tuning.camera, captures, windows, settings)

    def patch(step: int, index: int) -> Patch:
        window = windows(step, index)
        truth, place = captures.truth(window), f"{captures.names[window.which]} at row {window.top}"
        return Patch(truth, truth, f"{place}, column {window.left}")

    def keep(best: dict[str, Any]) -> None:
        card = {**tuned.card, "best": best, "tuning": settings.model_dump(mode="json")}
        replace(tuned, card=card).save(folder / "weights.safetensors", overwrite=True)

    return Prepared(system, patch, keep)


def _bring_prior(weights: Weights, folder: Path) -> None:
    """A copy of the prior that a network starts from, beside its weights."""
    if weights.prior in ("", "rendered") or weights.path is None or (folder / weights.prior).exists():
        return
    with atomic_path(folder / weights.prior, overwrite=True) as temporary:
        temporary.write_bytes((weights.path.parent / weights.prior).read_bytes())


def _system(
    tuned: Weights,
    camera: CodedCamera | SpectralDepthCamera,
    captures: KeptCaptures,
    windows: Windows,
    settings: TuningSettings,
) -> TunedImaging | TunedDepth:
    chosen = settings.optimiser
    if isinstance(camera, SpectralDepthCamera):
        how: dict[str, Any] = {"loss": chosen.loss, "depth_weight": chosen.depth_weight}
        return TunedDepth(camera, tuned.network, cast(Any, tuned.load_prior()), captures, windows, **how)
    return TunedImaging(camera, tuned.network, tuned.load_prior(), captures, windows, loss=chosen.loss)


def mixes_columns(camera: CodedCamera | SpectralDepthCamera) -> bool:
    """Whether the network needs whole rows, because the optics lay light of a scene column on other columns."""
    if isinstance(camera, SpectralDepthCamera):
        return False
    taps = camera.taps()
    return any(taps.offsets) or taps.snapshot_width != taps.scene_shape[2]
