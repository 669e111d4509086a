"""What stands before a camera on the optical table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal["none", "even", "white", "point"]


@dataclass(frozen=True)
class Light:
    """What is before the camera.

    Args:
        kind: ``none`` (lens covered), ``even`` (light on the bare sensor, out of focus), ``white`` (a white scene),
            ``point`` (a point source in the middle of the view, as bright as the sensor bears).
        wavelength: of the light, metres; all of them without.
        view: (row, column) from the middle one that alone is open; all without.
        reflectance: of the white scene, or of the even light as a share of it.
        exposure: of a frame, as a multiple of the usual one.
        depth: of the point, metres.
    """

    kind: Kind
    wavelength: float | None = None
    view: tuple[int, int] | None = None
    reflectance: float = 1.0
    exposure: float = 1.0
    depth: float | None = None
