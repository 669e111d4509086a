"""Specs of sensors: of a camera, and as a data sheet gives them."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from tmca.specs.base import Spec

_Noise = Annotated[float, Field(ge=0, le=1e6)]


class NoiseSpec(Spec):
    """What a sensor does to light that it can hold."""

    read_noise: _Noise = 0.0
    "Standard deviation in snapshot units (1 = one band or view of a white scene)."
    full_well: Annotated[float, Field(ge=1e-3, le=1e15)] | None = None
    "Electrons at full scale; switches shot noise on."
    read_noise_electrons: _Noise = 0.0
    "Read noise in electrons, standard deviation; needs --full-well."
    bits: Annotated[int, Field(ge=1, le=32)] | None = None
    "Bits of the analogue-to-digital converter."


class SensorSpec(NoiseSpec):
    """The sensor."""

    saturates: Annotated[float, Field(gt=0, le=1)] | None = None
    "Share of full scale at which a pixel, or a bucket of it, is full; full scale where a full well or bits are given."


class SheetSpec(NoiseSpec):
    """A sensor and its modulator as their data sheets give them."""

    exposure: Annotated[float, Field(gt=0)] | None = None
    "Time of a snapshot, seconds."
    pattern_rate: Annotated[float, Field(gt=0)] | None = None
    "Most patterns per second of aperture (mask) and shutter, Hz."
    slot_time: Annotated[float, Field(gt=0)] | None = None
    "Shortest time a pattern may be shown, seconds."
    buckets: Annotated[int, Field(ge=1, le=2)] = 1
    "Buckets of a pixel, 1 or 2, each with this noise and full well: with 2, the light of closed slots is read too."
