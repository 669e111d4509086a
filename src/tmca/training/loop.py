"""The training loop: any system, one process or many, exact resume.

Everything random follows from the seed and the step, so a run that is killed and resumed ends as one that was not.
"""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor, nn

from tmca.errors import TmcaError
from tmca.training.checkpoints import latest_checkpoint, load_latest, save_checkpoint
from tmca.training.log import TrainingLog
from tmca.training.patches import Patch
from tmca.training.pool import Pool
from tmca.training.settings import RunSettings
from tmca.training.system import System

if TYPE_CHECKING:
    from lightning_fabric import Fabric

LOG = "log.csv"
"""In a run's folder."""
Progress = Callable[[int, int, str], None]
"""Takes steps done, steps in all, and a line on how it goes."""


class TrainingError(TmcaError):
    """A run that cannot go on; its last checkpoint stays."""


class Stopped(KeyboardInterrupt):
    """The run was asked to stop (Ctrl-C, SIGTERM) and has left a checkpoint."""


@dataclass
class Setup:
    """What is trained.

    Args:
        system: camera and decoder.
        patch: (step, index) → patch.
        save: writes the weights; called with the best validation figures whenever they are the best so far, and at the
            end of a run that never validated.
        pool: patches to draw from while the codes stay as they are, and their first estimates.
    """

    system: System
    patch: Callable[[int, int], Patch]
    save: Callable[[dict[str, Any]], None]
    pool: Pool | None = None


@dataclass
class Run:
    """One process' part of a run.

    Args:
        setup: what is trained.
        settings: of the run.
        steps: in all.
        folder: checkpoints and log.
        fabric: engine (Lightning Fabric): precision, device, processes.
        progress: called after every step.
    """

    setup: Setup
    settings: RunSettings
    steps: int
    folder: Path
    fabric: Fabric
    progress: Progress | None = None
    best: dict[str, Any] = field(default_factory=lambda: {"psnr": -math.inf, "score": -math.inf, "step": 0})
    losses: list[float] = field(default_factory=list)
    detail: str = ""
    cpu_seconds: float = 0.0
    begun: float = 0.0

    def __post_init__(self) -> None:
        self.system = self.setup.system
        groups = self.system.groups()
        self.optimizers = {name: _optimizer(name, params) for name, params in groups.items() if params}
        self.log = TrainingLog(self.folder / LOG)

    def resume(self) -> int:
        """Steps done at the newest checkpoint, whose state is taken over."""
        state = load_latest(self.folder / "checkpoints", self.system, self.optimizers)
        self.begun = time.process_time()
        if state is None:
            return 0
        self.cpu_seconds = float(state.get("cpu_seconds", 0.0))
        self.best = state["best"] if state["best"]["score"] is not None else self.best  # JSON has no infinity
        self.losses = list(state["losses"])
        return int(state["step"])

    def train(self) -> dict[str, Any]:
        """Go on to the last step; returns the best validation figures.

        Raises:
            TrainingError: a loss or gradient that is not finite.
            Stopped: asked to stop, after a checkpoint.
        """
        first = self._begin()
        wrapped, *_ = self.fabric.setup(self.system, *self.optimizers.values())
        with _asked_to_stop() as asked:
            for step in range(first, self.steps):
                loss = self._step(wrapped, step)
                self.losses.append(loss)
                done = step + 1
                if done % self.settings.validate_every == 0 or done == self.steps:
                    self._validate(done)
                stop = self._anyone(asked)
                if done % self.settings.checkpoint_every == 0 or done == self.steps or stop:
                    self._checkpoint(done)
                if self.progress:
                    self.progress(done, self.steps, f"loss {loss:.3g}{self.detail}")
                if stop and done < self.steps:
                    raise Stopped(f"stopped after step {done} of {self.steps}")
        if self.setup.pool:
            self.setup.pool.delete()
        return self.best

    def _begin(self) -> int:
        """Steps that are done; all is as it was behind the last of them."""
        first = self.resume()
        self.log.keep_until(first)
        self._set_rates(first)
        if self.setup.pool and not self.system.frozen:
            self.setup.pool.delete()  # estimates of codes that this run has still to learn
        if first == 0 and self.settings.starts_trained:
            self._validate(0)
        return first

    def _step(self, wrapped: Any, step: int) -> float:
        share = self.settings.data.batch // self.fabric.world_size
        indexes = range(self.fabric.global_rank * share, (self.fabric.global_rank + 1) * share)
        self._set_rates(step)
        patches, *drawn = self._batch(step, indexes)
        loss = wrapped(patches, *drawn)
        self.fabric.backward(loss)
        self._check_finite(loss, step, patches)
        groups = self.system.groups()
        if self.settings.optimiser.clip and groups["decoder"]:
            nn.utils.clip_grad_norm_(groups["decoder"], self.settings.optimiser.clip)
        for optimizer in self.optimizers.values():
            optimizer.step()
            optimizer.zero_grad()
        if not self.system.frozen:
            self.system.hold()
        return float(loss.detach())

    def _batch(self, step: int, indexes: Sequence[int]) -> tuple[list[Patch], int, list[int], Tensor | None]:
        """Patches, the step and indexes of their random numbers, and their first estimates if these are cached."""
        start, places = None, list(indexes)
        if self.setup.pool and self.system.frozen:
            step, places = self.setup.pool.draw(step, places)
            start = self.setup.pool.starts(step, places)
        return [self.setup.patch(step, index) for index in places], step, places, start

    def _set_rates(self, step: int) -> None:
        rates = self.settings.rates(step, self.steps)
        self.system.frozen = not any(rates[name] for name in self.optimizers if name != "decoder")
        for name, optimizer in self.optimizers.items():
            for group in optimizer.param_groups:
                group["lr"] = rates[name]
        self.system.anneal(self.settings.slope(step, self.steps))

    def _check_finite(self, loss: Tensor, step: int, patches: list[Patch]) -> None:
        learned = [(n, p) for n, p in self.system.named_parameters() if p.grad is not None]
        broken = [n for n, p in learned if not (p.grad is None or p.grad.isfinite().all())]
        if bool(loss.isfinite()) and not broken:
            return
        newest = latest_checkpoint(self.folder / "checkpoints")
        lost = [n for n, p in learned if not p.isfinite().all()]
        everywhere = "every derivative" if learned and len(broken) == len(learned) else ""
        where = (lost or ([everywhere] if everywhere else broken) or ["the loss"])[0]
        raise TrainingError(
            f"step {step + 1}",
            f"a loss of {float(loss.detach()):g}, not finite in {where}; batch: {'; '.join(p.origin for p in patches)}",
            "finite numbers",
            f"look at these scenes or lower the learning rate; kept: {newest or 'no checkpoint yet'}",
        )

    def _validate(self, done: int) -> None:
        figures = {"loss": math.fsum(self.losses) / max(len(self.losses), 1), **self.system.figures()}
        merit = self.system.validate()
        self.detail = f", validation {merit['psnr']:.2f} dB" if merit else ""
        score = merit.get("score", merit.get("psnr", -math.inf))
        if score > self.best["score"] or (done == self.steps and not merit):
            self.best = {"psnr": score, **merit, "score": score, "step": done}
            if self.fabric.is_global_zero:
                self.setup.save(self.best)
        self.losses.clear()
        if self.fabric.is_global_zero:
            self.log.add(done, figures | merit)

    def _checkpoint(self, done: int) -> None:
        now = time.process_time()
        self.cpu_seconds, self.begun = self.cpu_seconds + now - self.begun, now
        if self.fabric.is_global_zero:
            save_checkpoint(
                self.folder / "checkpoints",
                done,
                self.system,
                self.optimizers,
                {"best": self.best, "losses": self.losses, "time": time.time(), "cpu_seconds": self.cpu_seconds},
            )
        self.fabric.barrier()

    def _anyone(self, asked: list[int]) -> bool:
        """Whether any process was asked to stop: all of them stop after the same step."""
        if self.fabric.world_size == 1:
            return bool(asked)
        total = self.fabric.all_reduce(torch.tensor(float(len(asked))), reduce_op="sum")
        return bool(torch.as_tensor(total) > 0)


@contextmanager
def _asked_to_stop() -> Iterator[list[int]]:
    """Signals that arrived; Ctrl-C and SIGTERM let the step finish, a second Ctrl-C does not."""
    asked: list[int] = []

    def note(number: int, frame: Any) -> None:
        if asked and number == signal.SIGINT:
            raise KeyboardInterrupt
        asked.append(number)

    try:
        before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    except ValueError:  # not in the main thread: signals are somebody else's
        yield asked
        return
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _optimizer(name: str, parameters: list[nn.Parameter]) -> torch.optim.Optimizer:
    """Of the decoder, or of codes of any kind."""
    if name == "decoder":
        return torch.optim.AdamW(parameters, lr=1e-3, weight_decay=1e-4)
    return torch.optim.Adam(parameters, lr=1e-3, betas=(0.9, 0.99))
