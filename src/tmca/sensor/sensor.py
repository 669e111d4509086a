"""The sensor: shot noise, read noise, saturation, analogue-to-digital conversion."""

from __future__ import annotations

from math import isfinite

import torch
from torch import Tensor, nn

from tmca.errors import SettingError
from tmca.sensor.noise import Noise, quantise, shot_noise


class Sensor(nn.Module):
    """From exact irradiance to a recorded snapshot, in the same units.

    Units of the snapshot: 1 is one band of a white scene through an open aperture and shutter over the whole exposure.
    Full scale (a white scene, Σκ) is the saturation level, and the full well is the electron count there (errata).

    Args:
        read_noise: snapshot units, standard deviation.
        full_well: electrons at full scale; None switches shot noise off.
        read_noise_electrons: electrons, standard deviation, added to ``read_noise``; needs ``full_well``.
        bits: of the converter; None leaves the values continuous.
        saturates: clip at full scale; by default where a full well or bits are given.
        pedestal: share of full scale that the converter keeps below zero, so that noise around black is not clipped.

    Raises:
        SettingError: negative noise, full well ≤ 0, bits outside 1…32, electrons without a full well.
    """

    def __init__(
        self,
        read_noise: float = 0.0,
        full_well: float | None = None,
        read_noise_electrons: float = 0.0,
        bits: int | None = None,
        saturates: bool | None = None,
        pedestal: float = 1 / 64,
    ) -> None:
        super().__init__()
        for name, value in (
            ("read_noise", read_noise),
            ("read_noise_electrons", read_noise_electrons),
            ("pedestal", pedestal),
        ):
            if not (isfinite(value) and value >= 0):
                raise SettingError(name, str(value), "a finite number ≥ 0")
        if full_well is not None and not (isfinite(full_well) and full_well > 0):
            raise SettingError("full_well", str(full_well), "electrons > 0", "leave it out for no shot noise")
        if read_noise_electrons and full_well is None:
            raise SettingError(
                "read_noise_electrons",
                str(read_noise_electrons),
                "a full_well beside it",
                "or use read_noise",
            )
        if bits is not None and not 1 <= bits <= 32:
            raise SettingError("bits", str(bits), "1 to 32")
        self.read_noise, self.full_well, self.read_noise_electrons = (
            read_noise,
            full_well,
            read_noise_electrons,
        )
        self.bits, self.pedestal = bits, pedestal
        self.saturates = saturates if saturates is not None else (bits is not None or full_well is not None)

    def noise(self, full_scale: float, exposures: int = 1) -> Noise:
        """Read and shot noise in snapshot units, the converter's rounding error counted as read noise.

        Args:
            full_scale: level of a white scene over one exposure time, snapshot units.
            exposures: exposure times that are accumulated; they widen the converter's range.
        """
        electron = full_scale / self.full_well if self.full_well else 0.0
        rounding = self._step(full_scale * exposures) / 12**0.5
        read = (self.read_noise**2 + (self.read_noise_electrons * electron) ** 2 + rounding**2) ** 0.5
        return Noise(read=read, shot=electron)

    def _step(self, top: float) -> float:
        """Width of one level of the converter, snapshot units; 0 without one."""
        return 0.0 if self.bits is None else (1 + self.pedestal) * top / (2**self.bits - 1)

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
        source = _generator(generator, irradiance.device)
        noise, values, top = self.noise(full_scale), irradiance, full_scale * exposures
        read = (self.read_noise**2 + (self.read_noise_electrons * noise.shot) ** 2) ** 0.5
        if noise.shot:
            values = shot_noise(values / noise.shot, source) * noise.shot
        if read:
            values = values + read * torch.randn(
                values.shape, generator=source, dtype=values.dtype, device=values.device
            )
        if self.saturates:
            values = values.clamp_max(top)
        if self.bits is not None:
            values = quantise(values, -self.pedestal * top, top, self.bits)
        return values

    def settings(self) -> dict[str, float | int | bool | None]:
        """Everything that makes this sensor, for files."""
        return {
            "read_noise": self.read_noise,
            "full_well": self.full_well,
            "read_noise_electrons": self.read_noise_electrons,
            "bits": self.bits,
            "saturates": self.saturates,
            "pedestal": self.pedestal,
        }

    def extra_repr(self) -> str:
        """Shown by ``print``."""
        return ", ".join(f"{name}={value}" for name, value in self.settings().items())


def _generator(source: torch.Generator | int | None, device: torch.device) -> torch.Generator | None:
    if isinstance(source, int):
        return torch.Generator(device=device).manual_seed(source)
    return source
