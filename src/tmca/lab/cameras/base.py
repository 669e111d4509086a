"""Light on the optical table, and one object per kind of camera that tells the laboratory what is different for it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from torch import Tensor

from tmca.cameras import Camera
from tmca.errors import DeviceError, SettingError, check_choice

if TYPE_CHECKING:
    from tmca.lab.calibration.file import Calibration
    from tmca.lab.display.codes import Planes
    from tmca.lab.frames import Array
    from tmca.sensor import Sensor

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


LAB_CAMERAS: dict[str, LabCamera] = {}
"""What the laboratory knows of every kind of camera."""
BRIGHT = 0.8
"""Of the full scale, that the brightest single wavelength or view reaches."""


class LabCamera(ABC):
    """What a kind of camera shows and sees on the simulated bench, and what a calibration makes of it.

    A new camera for the table has one: it names the camera's ``kind`` and says what is abstract here. It is registered
    as it is defined. A ``camera`` is always one of this kind.
    """

    kind: ClassVar[str]
    steps: ClassVar[frozenset[str]]  # of its calibration, see `tmca.lab.calibration.steps.STEPS`
    unmeasured: ClassVar[frozenset[str]] = frozenset()  # parts of a calibration that it does not have
    masked: ClassVar[bool] = True  # whether it codes by pixels that open and close

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        if "kind" in cls.__dict__:
            LAB_CAMERAS[cls.kind] = cls()

    # The simulated bench

    @abstractmethod
    def lit(self, camera: Any, light: Light) -> tuple[Tensor, ...]:
        """What the camera images under a light: (1, *scene_shape) of a white surface, one wavelength or view as bright
        as the sensor bears; or a point, and its depth (1, 1, H, W).

        Raises:
            DeviceError: a light that is not simulated.
        """

    @abstractmethod
    def showing(self, camera: Any, codes: Planes) -> Any:
        """The camera with the codes of an export in the place of its own.

        Raises:
            DeviceError: codes of another size.
        """

    @abstractmethod
    def opened(self, camera: Any, patterns: Sequence[int], shares: Tensor, **parts: Any) -> Any:
        """The camera with some patterns of its mask behind a shutter that is open for shares (n, H) of the time, and
        with other ``parts``."""

    def wavelengths(self, camera: Any) -> Sequence[float]:
        """Metres; of the light of a calibration where none is chosen, the one of the registration in the middle."""
        return ()

    def depths(self, camera: Any) -> Sequence[float]:
        """Metres, of the point of a calibration where none is chosen."""
        return ()

    # Calibration

    def registration_light(self, wavelengths: Sequence[float]) -> Light:
        """The light of a registration; the first of the wavelengths that were chosen, metres.

        Raises:
            SettingError: none, where one is needed.
        """
        if not wavelengths:
            raise SettingError("--wavelength", "none", "that of the light for registration, in nm")
        return Light("white", wavelength=wavelengths[0])

    def drawn_map(self, camera: Any, wavelength: float | None) -> Array | None:
        """(2, 3) map from code to sensor pixels of the camera as it was drawn, under a light (metres); None where it
        has no mask to register, or the light does not say."""
        return None

    @abstractmethod
    def calibrated(self, camera: Any, calibration: Calibration, sensor: Sensor) -> Any:
        """The camera with what was measured of its codes and optics, and this sensor.

        Raises:
            DataError, SettingError: see `tmca.lab.calibration.apply.calibrated`.
        """

    def on_camera(self, values: Tensor, nominal: Any, measured: Any) -> Tensor:
        """A capture (B, C, H, W') of the nominal camera on the planes of the measured one."""
        return values

    def on_sensor(self, values: Tensor, nominal: Any, measured: Any) -> Tensor:
        """What the measured camera images, on the sensor's pixels."""
        return values

    def code_map(self, camera: Any, calibration: Calibration) -> Array:
        """(2, 3) map from code to sensor pixels of the camera as it was drawn.

        Raises:
            SettingError: a camera without a mask to register.
        """
        raise SettingError("--calibration", f"a {self.kind} camera", "one with a coded aperture")


def lab_camera(camera: Camera | str) -> LabCamera:
    """What the laboratory knows of a camera, or of a kind of camera.

    Raises:
        SettingError: a kind that was never on the table.
    """
    kind = camera if isinstance(camera, str) else camera.kind
    check_choice("camera", kind, LAB_CAMERAS)
    return LAB_CAMERAS[kind]


def check_light(possible: bool, found: str, expected: str) -> None:
    """Raises DeviceError for a light that the simulated bench does not have."""
    if not possible:
        raise DeviceError("simulated bench", found, expected)
