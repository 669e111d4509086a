"""Cameras whose slots collapse into one code, bands or views behind masks of pixels, in training."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tmca.decoders import first_estimate
from tmca.decoders.nets.tiles import Tile, keeps_columns, window_of
from tmca.design import hold_throughput, throughput_of
from tmca.errors import SettingError
from tmca.operators import TapOperator
from tmca.training.settings import CodeSettings
from tmca.training.system import Seen, TrainingSystem, Window


class CodedSystem(TrainingSystem):
    """A `CodedCamera` and a `Network` that learn together.

    A batch is seen through one window of the codes; a patch is a scene of its own, dark around.

    Args:
        given: camera, network, sensors, prior and validation scenes, as of `TrainingSystem`.
        codes: throughput and how it is held, and whether the codes' gradient passes through the first estimate.
        how: ``loss``, ``faults`` and ``seed`` of `TrainingSystem`.

    Raises:
        SettingError: see `TrainingSystem`; optics that keep the slots apart; codes that learn through a mixture.
    """

    untrained = ("motion",)  # scenes move by ``data.motion``

    def __init__(self, *given: Any, codes: CodeSettings | None = None, **how: Any) -> None:
        super().__init__(*given, **how)
        self.mixes_columns = not keeps_columns(self.optics())  # optics that keep the slots apart are refused
        self.codes = codes or CodeSettings(through_start=False)
        self.through_start = self.codes.through_start and self.camera.learnable
        if self.through_start and self.network.start == "mixture":
            raise SettingError(
                "codes.through_start",
                "true with start mixture",
                "false, or start lmmse",
                "codes learn with start lmmse",
            )

    def optics(self, window: Window | None = None) -> TapOperator:
        taps = self.camera.taps()
        return TapOperator(taps if window is None else taps.window(*window))

    def image(self, scenes: Tensor, window: Window, bench: Any, optics: Any) -> Tensor:
        """See `TrainingSystem`; scenes that move are (B, K, L, h, w)."""
        if scenes.ndim == 5:
            return bench.moving_window(*window).A(scenes)
        return (optics if bench is self.camera else bench.window(*window)).A(scenes)

    def first(self, seen: Seen) -> Tensor:
        kind, noise, through = self.network.start, self.noise(seen.sensor), self.through_start and not self.frozen
        with torch.autocast(seen.snapshot.device.type, enabled=False):
            return first_estimate(kind, seen.snapshot, seen.optics, noise, self.prior, differentiable=through)

    def cut(self, seen: Seen, tile: Tile) -> Seen:
        return Seen(*window_of(seen.optics, seen.snapshot, tile), seen.sensor)

    def cost_of_codes(self, seen: Seen, truth: Tensor, step: int) -> Tensor | float:
        """See `TrainingSystem`: the penalty of another throughput than the target."""
        target = self.codes.throughput
        if target is None or self.codes.hold != "penalty":
            return 0.0
        return self.codes.penalty * (throughput_of(self.camera) - target) ** 2

    def means(self, rows: Sequence[Sequence[dict[str, float]]]) -> dict[str, float]:
        """See `TrainingSystem`; of several sensors ``psnr_0``, ``psnr_1``, … too."""
        each = [float(np.mean([row["psnr"] for row in rows_of_sensor])) for rows_of_sensor in rows]
        several = {f"psnr_{place}": value for place, value in enumerate(each)} if len(each) > 1 else {}
        return {"psnr": float(np.mean(each)), **several}

    def anneal(self, slope: float) -> None:
        self.camera.codes.anneal(slope)

    def hold(self) -> None:
        """See `TrainingSystem`: bring the throughput back to a hard target."""
        if self.codes.throughput is not None and self.codes.hold == "hard":
            hold_throughput(self.camera, self.codes.throughput)

    def figures(self) -> dict[str, float]:
        """See `TrainingSystem`: light throughput, share of open aperture and shutter pixels."""
        with torch.no_grad():
            open_pixels = {"transmittance": self.camera.codes.transmittance(), "duty": self.camera.codes.duty()}
        return {**super().figures(), **open_pixels}
