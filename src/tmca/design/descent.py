"""Binary codes by gradient descent on their expected error: through a smooth stand-in, or from grey to binary.

What every search shares is here, too: the best parameters so far, and the progress of its parts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import inf

import torch
from torch import Tensor, nn

from tmca.cameras import CodedCamera
from tmca.design.kinds import hold_throughput
from tmca.design.tile import CodeError
from tmca.errors import SettingError, check_range

Progress = Callable[[float, str], None]
"""Called with the share that is done and what is done."""


class Parts:
    """Progress of parts one after the other.

    Args:
        progress: of all of them; nobody is told if None.
        lengths: of each, in any unit.
    """

    def __init__(self, progress: Progress | None, lengths: Sequence[float]) -> None:
        self.progress, self.all, self.left = progress, sum(lengths), list(lengths)

    def __call__(self, what: str = "") -> Callable[[float], None]:
        """What takes the share that is done of the next part."""
        before, length, progress = (
            self.all - sum(self.left),
            self.left.pop(0),
            self.progress or (lambda share, what: None),
        )
        return lambda share: progress((before + length * share) / self.all, what)


@dataclass
class Best:
    """The parameters of the lowest value so far; those that they begin with before any."""

    parameters: Sequence[nn.Parameter]
    value: float = inf
    copies: list[Tensor] = field(init=False)

    def __post_init__(self) -> None:
        self.copies = [parameter.detach().clone() for parameter in self.parameters]

    def meet(self, value: float) -> None:
        """Take over the present parameters if their value is lower."""
        if value < self.value:
            self.value, self.copies = value, [parameter.detach().clone() for parameter in self.parameters]

    @torch.no_grad()
    def restore(self) -> float:
        """Bring them back; their value."""
        for parameter, copy in zip(self.parameters, self.copies, strict=True):
            parameter.copy_(copy)
        return self.value


@dataclass(frozen=True)
class Descent:
    """How codes descend.

    Args:
        steps: of Adam.
        rate: its learning rate, in units of the latent values, which stay within ±1.
        slope: first and last slope of the smooth stand-in, raised geometrically.
        relaxed: let the codes be grey on the way, ever nearer to 0 and 1, instead of binary all the time.
        throughput: share of light to hold after every step; free if None.
        seed: of the blocks' shifts.
        checks: how often the binary codes are judged; the best of them stay.

    Raises:
        SettingError: no steps or checks, no rate, or slopes that do not rise from above 0.
    """

    steps: int = 300
    rate: float = 0.1
    slope: tuple[float, float] = (2.0, 20.0)
    relaxed: bool = False
    throughput: float | None = None
    seed: int = 0
    checks: int = 12

    def __post_init__(self) -> None:
        check_range("descent steps", self.steps, 1)
        check_range("descent rate", self.rate, above=0)
        check_range("descent checks", self.checks, 1)
        if not 0 < self.slope[0] <= self.slope[1]:
            raise SettingError("descent slope", str(self.slope), "slopes rising from above 0")


def descend(
    camera: CodedCamera,
    error: CodeError,
    how: Descent | None = None,
    progress: Callable[[float], None] | None = None,
) -> float:
    """Lower the expected error of a camera of one period by its learnable codes, in place.

    Args:
        camera: as large as one period of its codes, see ``designable``.
        error: of its tile.
        how: settings.
        progress: called with the share that is done.

    Returns:
        Expected mean squared error of the binary codes that the camera is left with, never above the first, once those
        hold the throughput.

    Raises:
        SettingError: nothing to learn.
    """
    how = how or Descent()
    latents = learnable(camera)
    if how.throughput is not None:
        hold_throughput(camera, how.throughput)
    best = Best(latents, error.whole(camera))
    optimiser = torch.optim.Adam(latents, lr=how.rate)
    shifts = torch.randint(1 << 16, (how.steps, 2), generator=torch.Generator().manual_seed(how.seed)).tolist()
    for step, shift in enumerate(shifts, 1):
        camera.codes.anneal(how.slope[0] * (how.slope[1] / how.slope[0]) ** ((step - 1) / how.steps))
        _step(camera, error, optimiser, (shift[0], shift[1]), how)
        if step % max(1, how.steps // how.checks) == 0 or step == how.steps:
            best.meet(error.whole(camera))
        if progress:
            progress(step / how.steps)
    return best.restore()


def learnable(camera: CodedCamera) -> list[nn.Parameter]:
    """The latent values of a camera's learnable codes.

    Raises:
        SettingError: there are none.
    """
    latents = [p for p in camera.codes.parameters() if p.requires_grad]
    if not latents:
        raise SettingError("camera", "fixed codes", "learnable=True, 'aperture' or 'shutter'")
    return latents


def _step(
    camera: CodedCamera, error: CodeError, optimiser: torch.optim.Optimizer, shift: tuple[int, int], how: Descent
) -> None:
    camera.codes.relax(how.relaxed)
    value = error(camera.taps().code, shift)
    camera.codes.relax(False)
    optimiser.zero_grad()
    value.log().backward()
    optimiser.step()
    with torch.no_grad():
        for latent in learnable(camera):
            latent.clamp_(-1, 1)
    if how.throughput is not None:
        hold_throughput(camera, how.throughput)
