"""Binary codes by gradient descent on their expected error: through a smooth stand-in, or from grey to binary."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from tmca.cameras import CodedCamera
from tmca.design.throughput import hold_throughput
from tmca.design.tile import CodeError
from tmca.errors import SettingError


@dataclass(frozen=True)
class Descent:
    """How codes descend.

    Args:
        steps: of Adam.
        rate: its learning rate, in units of the latent values, which are kept within ±1.
        slope: first and last slope of the smooth stand-in, raised geometrically.
        relaxed: let the codes be grey on the way, ever nearer to 0 and 1, instead of binary all the time.
        throughput: share of light to hold after every step; free if None.
        seed: of the blocks' shifts.
        checks: how often the binary codes are judged; the best of them are kept.
    """

    steps: int = 300
    rate: float = 0.1
    slope: tuple[float, float] = (2.0, 20.0)
    relaxed: bool = False
    throughput: float | None = None
    seed: int = 0
    checks: int = 12

    def __post_init__(self) -> None:
        if self.steps < 1 or not self.rate > 0 or not 0 < self.slope[0] <= self.slope[1] or self.checks < 1:
            found = f"{self.steps} steps, rate {self.rate}, slope {self.slope}, {self.checks} checks"
            raise SettingError("descent", found, "steps and checks ≥ 1, rate > 0, slopes rising from above 0")


def descend(
    camera: CodedCamera,
    error: CodeError,
    how: Descent | None = None,
    progress: Callable[[float], None] | None = None,
) -> float:
    """Lower the expected error of a camera of one period by its learnable codes, in place.

    Args:
        camera: as large as one period of its codes, see ``tmca.design.designable``.
        error: of its tile.
        how: settings.
        progress: told the share that is done.

    Returns:
        Expected mean squared error of the binary codes that the camera is left with, never above the first, once those
        hold the throughput.

    Raises:
        SettingError: nothing to learn.
    """
    how = how or Descent()
    latents = learned(camera)
    if how.throughput is not None:
        hold_throughput(camera, how.throughput)
    best = Best.of(camera, error, latents)
    optimiser = torch.optim.Adam(latents, lr=how.rate)
    shifts = torch.randint(1 << 16, (how.steps, 2), generator=torch.Generator().manual_seed(how.seed)).tolist()
    for step in range(how.steps):
        camera.codes.anneal(how.slope[0] * (how.slope[1] / how.slope[0]) ** (step / how.steps))
        _step(camera, error, optimiser, latents, shifts[step], how)
        if (step + 1) % max(1, how.steps // how.checks) == 0 or step == how.steps - 1:
            best.meet(camera, error, latents)
        if progress:
            progress((step + 1) / how.steps)
    return best.leave(latents)


def learned(camera: CodedCamera) -> list[nn.Parameter]:
    """The latent values of a camera's learnable codes.

    Raises:
        SettingError: there are none.
    """
    found = [p for p in camera.codes.parameters() if p.requires_grad]
    if not found:
        raise SettingError("camera", "fixed codes", "learnable=True, 'aperture' or 'shutter'")
    return found


def _step(
    camera: CodedCamera,
    error: CodeError,
    optimiser: torch.optim.Optimizer,
    latents: Sequence[nn.Parameter],
    shift: Sequence[int],
    how: Descent,
) -> None:
    camera.codes.relax(how.relaxed)
    value = error(camera.taps().code, (shift[0], shift[1]))
    camera.codes.relax(False)
    optimiser.zero_grad()
    value.log().backward()
    optimiser.step()
    with torch.no_grad():
        for latent in latents:
            latent.clamp_(-1, 1)
    if how.throughput is not None:
        hold_throughput(camera, how.throughput)


@dataclass
class Best:
    """The best binary codes so far, and their error."""

    value: float
    latents: list[Tensor]

    @classmethod
    def of(cls, camera: CodedCamera, error: CodeError, latents: Sequence[nn.Parameter]) -> Best:
        return cls(error.whole(camera), [latent.detach().clone() for latent in latents])

    def meet(self, camera: CodedCamera, error: CodeError, latents: Sequence[nn.Parameter]) -> None:
        value = error.whole(camera)
        if value < self.value:
            self.value, self.latents = value, [latent.detach().clone() for latent in latents]

    def leave(self, latents: Sequence[nn.Parameter]) -> float:
        with torch.no_grad():
            for latent, kept in zip(latents, self.latents, strict=True):
                latent.copy_(kept)
        return self.value
