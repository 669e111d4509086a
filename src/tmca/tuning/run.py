"""From a trained run, a calibration and a folder of captures to a decoder that knows its bench."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tmca.data import checksum_of
from tmca.decoders import Weights
from tmca.errors import DataError, SettingError
from tmca.lab.calibration.file import Calibration, load_calibration
from tmca.training.captures import Pair
from tmca.training.run import Trained
from tmca.training.tuning import Tuning, TuningSettings, tune, tuning_settings
from tmca.tuning.folder import PairFiles, find_pairs, held_out
from tmca.tuning.pairs import read_pair


@dataclass(frozen=True)
class Prepared:
    """A run of fine-tuning, checked and ready.

    Args:
        tuning: network and camera.
        settings: of the run.
        pairs: by the names of the captures.
        calibration: of the camera, None without.
    """

    tuning: Tuning
    settings: TuningSettings
    pairs: Mapping[str, PairFiles]
    calibration: Calibration | None

    def read(self, name: str) -> Pair:
        """A capture with its truth."""
        return read_pair(self.pairs[name], self.tuning.weights, self.calibration)[0]

    def run(self, folder: Path, read: Any = None, **how: Any) -> Trained:
        """Fine-tune, or go on; arguments as of `tmca.training.tuning.tune`, ``read`` in the place of this one's."""
        return tune(self.tuning, self.settings, folder, read or self.read, **how)


def prepared(
    weights: str | Path,
    captures: str | Path,
    calibration: str | Path | Calibration | None = None,
    *,
    validation: Sequence[str] | None = None,
    changes: Mapping[str, Any] | None = None,
) -> Prepared:
    """Read and check everything that a run of fine-tuning needs, before anything is written.

    Args:
        weights: the run to go on from: its folder or weights file, or ``"default"``.
        captures: folder of them, see ``find_pairs``.
        calibration: of the camera; None for the run's own operator.
        validation: captures that are held out, see ``held_out``.
        changes: settings by dotted name.

    Raises:
        DataError: weights, a calibration or captures that cannot be used, or do not belong together.
        SettingError: impossible settings.
    """
    known = Weights.find(weights)
    found = {pair.name: pair for pair in find_pairs(captures)}
    seed = (changes or {}).get("seed", 0)
    learned, apart = held_out(list(found), validation, seed if isinstance(seed, int) else 0)
    used = load_calibration(calibration) if isinstance(calibration, str | Path) else calibration
    settings = tuning_settings(_described(known, found, used, learned, apart), known.card, changes or {})
    camera = _one_camera(known, found, used)
    return Prepared(Tuning(known, camera, used is not None), settings, found, used)


def _described(
    weights: Weights,
    pairs: Mapping[str, PairFiles],
    calibration: Calibration | None,
    learned: Sequence[str],
    apart: Sequence[str],
) -> dict[str, Any]:
    """Where everything comes from, with checksums, and which captures are learned from."""
    assert weights.path is not None
    path = None if calibration is None else calibration.path
    return {
        "weights": _source(weights.path),
        "calibration": None if path is None else _source(path),
        "captures": {
            name: {"capture": _source(files.capture), "truth": _source(files.truth)} for name, files in pairs.items()
        },
        "data": {"train": tuple(learned), "validation": tuple(apart)},
    }


def _source(path: Path) -> dict[str, str]:
    return {"path": str(path), "sha256": checksum_of(path)}


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
