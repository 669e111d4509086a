"""The sensor: shot noise, read noise, saturation, analogue-to-digital conversion, with derivatives for training."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from warnings import warn

import torch
from torch import Tensor, nn

from tmca.arguments import Float, Int, checked
from tmca.errors import SettingError, check_range
from tmca.summaries import Summary

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WHITE, _WELL = 1.0, 0.1
"""Read noise, snapshot units, above which it was most likely meant in electrons, and the same beside a full well."""
_LEAST_NOISE = 1e-6
_MOST_NOISE = 1e6
"""Snapshot units or electrons that no sensor's noise reaches."""


class SensorWarning(UserWarning):
    """A sensor that was most likely meant otherwise."""


@dataclass(frozen=True)
class Noise:
    """What a decoder has to know of a sensor's noise: variance ``read² + shot · snapshot`` per pixel.

    Args:
        read: standard deviation of the signal-independent part, snapshot units.
        shot: variance per unit of snapshot, full scale / full well.

    Raises:
        SettingError: a negative number.
    """

    read: float = 0.0
    shot: float = 0.0

    def __post_init__(self) -> None:
        if not (self.read >= 0 and self.shot >= 0):
            raise SettingError("noise", f"read noise {self.read}, shot {self.shot}", "numbers ≥ 0")

    def variance(self, snapshot: Tensor) -> Tensor:
        """Variance of every pixel of a snapshot, snapshot units squared."""
        return self.read**2 + self.shot * snapshot.clamp_min(0)

    def in_words(self) -> str:
        """Standard deviation of the one part and variance of the other, snapshot units; ``none`` without any."""
        said = [f"read σ = {self.read:.3g}"] if self.read else []
        said += [f"shot variance = {self.shot:.3g} per unit of light"] if self.shot else []
        return ", ".join(said) or "none"


class _Poisson(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, electrons: Tensor, generator: torch.Generator | None) -> Tensor:
        mean = electrons.clamp_min(0)
        drawn = torch.poisson(mean, generator)
        ctx.save_for_backward(mean, drawn)
        return drawn

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None]:
        # pathwise derivative of mean + sqrt(mean)·z at the drawn z
        mean, drawn = ctx.saved_tensors
        return grads[0] * (1 + (drawn - mean) / (2 * mean.clamp_min(1.0))), None


def shot_noise(electrons: Tensor, generator: torch.Generator | None = None) -> Tensor:
    """Poisson counts of expected ``electrons``; the derivative is that of the Gaussian of equal mean and variance."""
    return _Poisson.apply(electrons, generator)


class _Round(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, values: Tensor) -> Tensor:
        return values.round()

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> Tensor:
        return grads[0]


def quantise(values: Tensor, low: float, high: float, bits: int) -> Tensor:
    """Nearest of 2^bits evenly spaced levels from ``low`` to ``high``; passes gradients straight through inside."""
    step = (high - low) / (2**bits - 1)
    return _Round.apply((values.clamp(low, high) - low) / step) * step + low


@checked
class Sensor(Summary, nn.Module):
    """From exact irradiance to a recorded snapshot, in the same units.

    Units of the snapshot: 1 is one band of a white scene through an open aperture and shutter over the whole exposure.
    Full scale (a white scene, Σκ) is the saturation level, and the full well is the electron count there (errata).

    Args:
        read_noise: snapshot units, standard deviation.
        full_well: electrons at full scale; None switches shot noise off.
        read_noise_electrons: electrons, standard deviation, added to ``read_noise``; needs ``full_well``.
        bits: of the converter; None leaves the values continuous.
        saturates: clip at full scale; by default where a full well or bits are given. A number is the share of full
            scale at which a pixel is full and the converter ends, such as 0.5 for two buckets that halve the well.
        pedestal: share of full scale that the converter keeps below zero, so that noise around black is not clipped.

    Raises:
        SettingError: no number, negative or absurd noise, a full well of no electrons, bits outside 1…32, electrons
            without a full well.
    """

    def __init__(
        self,
        read_noise: Float = 0.0,
        full_well: Float | None = None,
        read_noise_electrons: Float = 0.0,
        bits: Int | None = None,
        saturates: bool | Float | None = None,
        pedestal: Float = 1 / 64,
    ) -> None:
        super().__init__()
        check_range("read_noise", read_noise, 0, _MOST_NOISE)
        check_range("read_noise_electrons", read_noise_electrons, 0, _MOST_NOISE, unit="electrons")
        check_range("pedestal", pedestal, 0, 1)
        if full_well is not None:
            check_range(
                "full_well", full_well, 1e-3, 1e15, unit="electrons", remedy="leave it out for a sensor without one"
            )
        elif read_noise_electrons:
            found, expected = str(read_noise_electrons), "a full_well beside it"
            raise SettingError("read_noise_electrons", found, expected, "or use read_noise")
        if bits is not None:
            check_range("bits", bits, 1, 32)
        self.read_noise, self.full_well, self.read_noise_electrons = read_noise, full_well, read_noise_electrons
        self.bits, self.pedestal = bits, pedestal
        self.saturates = saturates if saturates is not None else (bits is not None or full_well is not None)
        self._top = 1.0 if isinstance(self.saturates, bool) else self.saturates
        check_range("saturates", self._top, high=1, above=0, unit="of full scale")

    def warn_of_electrons(self) -> None:
        """Warn of a read noise that hides every scene, as one that was meant in electrons does.

        Only for sensors that somebody described: that of a capture may be in digital numbers.

        Warns:
            SensorWarning: of it.
        """
        if self.doubt:
            warn(self.doubt, SensorWarning, stacklevel=3)

    @property
    def doubt(self) -> str:
        """What of it was most likely meant otherwise: a read noise in electrons; empty without any."""
        if self.read_noise <= (_WHITE if self.full_well is None else _WELL):
            return ""
        remedy = "full_well and read_noise_electrons" if self.full_well is None else "read_noise_electrons"
        return f"read_noise {self.read_noise:g} is in units of one white band or view; for electrons use {remedy}"

    def noise(self, full_scale: float, exposures: int = 1) -> Noise:
        """Read and shot noise in snapshot units, the converter's rounding error counted as read noise.

        Args:
            full_scale: level of a white scene over one exposure time, snapshot units.
            exposures: exposure times that are accumulated; they widen the converter's range.
        """
        electron, rounding = full_scale / self.full_well if self.full_well else 0.0, 0.0
        if self.bits is not None:
            rounding = (1 + self.pedestal) * self._top * full_scale * exposures / (2**self.bits - 1) / 12**0.5
        read = (self.read_noise**2 + (self.read_noise_electrons * electron) ** 2 + rounding**2) ** 0.5
        return Noise(read=read, shot=electron)

    def forward(
        self,
        irradiance: Tensor,
        full_scale: float,
        generator: torch.Generator | int | None = None,
        exposures: int = 1,
    ) -> Tensor:
        """Record a snapshot.

        Args:
            irradiance: (B, C, H, W') exact snapshot, snapshot units.
            full_scale: level of a white scene over one exposure time, snapshot units: there the full well is counted.
            exposures: exposure times accumulated on the sensor; saturation and the converter's range grow with them.
            generator: source of randomness or a seed; the global one if None.

        Returns:
            (B, C, H, W') recorded snapshot, snapshot units.
        """
        values, device, top = irradiance, irradiance.device, self._top * full_scale * exposures
        source = torch.Generator(device).manual_seed(generator) if isinstance(generator, int) else generator
        electron = full_scale / self.full_well if self.full_well else 0.0
        read = (self.read_noise**2 + (self.read_noise_electrons * electron) ** 2) ** 0.5
        if electron:
            values = shot_noise(values / electron, source) * electron
        if read:
            values = values + read * torch.randn(values.shape, generator=source, dtype=values.dtype, device=device)
        if self.saturates is not False:
            values = values.clamp_max(top)
        if self.bits is not None:
            values = quantise(values, -self.pedestal * top, top, self.bits)
        return values

    def settings(self) -> dict[str, float | int | bool | None]:
        """Everything that makes this sensor, for files."""
        names = ("read_noise", "full_well", "read_noise_electrons", "bits", "saturates", "pedestal")
        return {name: getattr(self, name) for name in names}

    def plot(self) -> Figure:
        """Signal-to-noise ratio of a pixel over the light, a share of full scale."""
        import numpy as np

        from tmca.plots.thumbnails import curve_figure

        light, noise = np.logspace(-3, 0), self.noise(1.0)
        deviation = np.sqrt(noise.read**2 + noise.shot * light)
        ratio = light / np.maximum(deviation, _LEAST_NOISE)
        return curve_figure(light, ratio, ("light (share of full scale)", "signal-to-noise ratio"), log=True)

    def _facts(self) -> dict[str, str]:
        electrons = "" if self.full_well is None else f"{self.full_well:g} electrons"
        read = [f"{self.read_noise:g} snapshot units"] if self.read_noise else []
        read += [f"{self.read_noise_electrons:g} electrons"] if self.read_noise_electrons else []
        return {
            "full well": electrons or "unlimited, no shot noise",
            "read noise": " and ".join(read) or "none",
            "bits": "" if self.bits is None else str(self.bits),
            "saturates": f"at {self._top:g} of full scale" if self.saturates else "",
        }

    def _picture(self) -> Figure:
        return self.plot()
