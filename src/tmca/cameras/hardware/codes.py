"""Codes as a bench shows them: in both planes, at their times."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from tmca.cameras.hardware.faults import Hardware
from tmca.codes import Outside, leaked, misplaced, slot_overlap, through_time
from tmca.optics import gaussian_spread


def in_turn(steps: Tensor) -> Tensor:
    """Times (…, K) of a shutter's steps, none before the one ahead of it, none in the next exposure.

    A pattern whose successor is already due is left out: no time is recorded twice.
    """
    return torch.minimum(steps.cummax(-1).values, steps[..., :1] + steps.shape[-1])


class ShutterFaults(nn.Module):
    """What becomes of shutter patterns (K, H, W): leakage, and everything that is not in time.

    Args:
        hardware: faults.
        slots: K.
        rows: of the sensor.
        seed: of the jitter.
    """

    overlap: Tensor

    def __init__(self, hardware: Hardware, slots: int, rows: int, seed: int = 0) -> None:
        super().__init__()
        self.leakage = hardware.leakage
        late = hardware.delay + hardware.rolling * torch.linspace(0, 1, rows, dtype=torch.float64)[:, None]
        source = torch.Generator().manual_seed(seed)
        drawn = torch.arange(slots) + late + hardware.jitter * torch.randn(slots, generator=source).double()
        steps = in_turn(drawn)
        ends = torch.cat((steps[:, 1:], steps[:, :1] + slots), 1)
        starts = torch.minimum(steps + hardware.dead_time, ends)
        self.register_buffer("overlap", slot_overlap(slots, starts, ends, hardware.switching))
        self.timed = bool((self.overlap - torch.eye(slots)).abs().max() > 1e-12)

    def forward(self, shutter: Tensor) -> Tensor:
        """(K, H, W) → (K, H, W), grey."""
        known = leaked(shutter, self.leakage)
        return through_time(known, self.overlap) if self.timed else known


class ImperfectCodes(nn.Module):
    """Codes of both planes as a bench shows them.

    Args:
        codes: the module that gives (aperture, shutter).
        shutter: faults of the shutter.
        hardware: those of the aperture.
        size: (H, W) of the aperture plane that is seen.
        blur: standard deviation by which the aperture's image is blurred, pixels.
        beside: closed columns to the left and the right of the shutter.
        outside: what is beside the aperture.
    """

    def __init__(
        self,
        codes: nn.Module,
        shutter: ShutterFaults,
        hardware: Hardware,
        size: tuple[int, int],
        *,
        blur: float = 0.0,
        beside: tuple[int, int] = (0, 0),
        outside: Outside = "edge",
    ) -> None:
        super().__init__()
        self.outside = outside
        self.codes, self.faults, self.hardware, self.size, self.beside = codes, shutter, hardware, size, beside
        self.kernel = gaussian_spread(blur, 1) if blur else None

    @property
    def learnable(self) -> bool:
        """Whether either plane is learned."""
        return bool(self.codes.learnable)

    def forward(self) -> tuple[Tensor, Tensor]:
        """(aperture (K, H, Wa), shutter (K, H, W')), grey."""
        aperture, shutter = self.codes()
        own = self.hardware
        placed = misplaced(aperture, own.shift, own.magnification, own.rotation, self.size, self.outside)
        shown = leaked(placed, 1 / own.contrast_ratio)
        seen = self.faults(shutter)
        return self._blurred(shown), torch.nn.functional.pad(seen, self.beside) if any(self.beside) else seen

    def _blurred(self, aperture: Tensor) -> Tensor:
        if self.kernel is None:
            return aperture
        reach = self.kernel.shape[-1] // 2
        edged = torch.nn.functional.pad(aperture[:, None], (reach,) * 4, mode="replicate")
        return torch.nn.functional.conv2d(edged, self.kernel[:, None].to(edged))[:, 0].clamp(0, 1)


class ImperfectPlane(nn.Module):
    """A shutter plane as a sensor shows it.

    Args:
        plane: (K, H, W) patterns.
        faults: of the shutter.
    """

    period = None

    def __init__(self, plane: nn.Module, faults: ShutterFaults) -> None:
        super().__init__()
        self.plane, self.faults = plane, faults

    def forward(self) -> Tensor:
        """(K, H, W), grey."""
        found: Tensor = self.faults(self.plane())
        return found

    def part(self, rows: slice, columns: slice) -> Tensor:
        """(K, h, w) over some pixels."""
        return self()[:, rows, columns]
