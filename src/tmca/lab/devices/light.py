"""What is before the camera while it is calibrated, and benches that can set it themselves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

from tmca.data import metres_to_nm

Kind = Literal["none", "even", "white", "point"]


_WORDS = {"none": "no light", "even": "even light on the sensor", "white": "a white scene", "point": "a point source"}


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

    def said(self) -> str:
        """In words."""
        words = _WORDS[self.kind]
        words += "" if self.wavelength is None else f" at {metres_to_nm(self.wavelength):g} nm"
        words += "" if self.view is None else f", view {self.view[0]}, {self.view[1]} alone open"
        words += "" if self.depth is None else f", {self.depth:g} m away"
        return words + ("" if self.exposure == 1 else f", exposed {self.exposure:g} times as long")


@runtime_checkable
class Lamp(Protocol):
    """A `Device` that sets the light itself; without, a person does, one light at a time."""

    def illuminate(self, light: Light) -> None:
        """Set the light, and the exposure time of the frames to come.

        Raises:
            DeviceError: it cannot.
        """
