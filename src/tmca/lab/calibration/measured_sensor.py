"""The sensor as it was measured: its digital numbers as relative irradiance, and its noise."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from tmca.cameras import Camera
from tmca.errors import DataError
from tmca.lab.calibration.file import Calibration
from tmca.lab.frames import check_size
from tmca.sensor import Sensor


def white_level(calibration: Calibration) -> float:
    """Digital numbers above the dark of a white scene with everything open.

    Raises:
        DataError: dark or flat were not measured.
    """
    if calibration.part("dark") is None or calibration.part("flat") is None:
        remedy = "measure both with tmca calibrate dark and flat"
        raise DataError(calibration.where, "no dark and flat", "both, for a snapshot in digital numbers", remedy)
    stated = calibration.settings("flat").get("white_level")
    return float(stated or calibration.part("flat").level)


def from_digital_numbers(
    values: Tensor, calibration: Calibration, full_scale: float, *, above_dark: bool = False
) -> Tensor:
    """Relative irradiance of raw values (…, H, W): ``(raw - dark) / flat · full_scale / white level``.

    Args:
        values: digital numbers.
        calibration: with dark and flat.
        full_scale: of the camera.
        above_dark: values are without a dark frame of their own already.

    Raises:
        DataError: see ``white_level``, or values of another size than the dark.
    """
    level = white_level(calibration)
    check_size(calibration.where, "a dark", calibration.part("dark").mean.shape, values.shape[-2:])
    raw = values.double().numpy() + (calibration.part("dark").mean if above_dark else 0)
    shares = calibration.corrected(raw) / level
    return torch.from_numpy(shares * full_scale).to(values)


def measured_sensor(camera: Camera, calibration: Calibration) -> Sensor:
    """The camera's sensor with read noise and full well as they were measured.

    Read noise needs dark and flat, the full well linearity too; else the nominal sensor stays.
    """
    dark, flat, linearity = (calibration.part(name) for name in ("dark", "flat", "linearity"))
    if dark is None or flat is None:
        return camera.sensor
    level = white_level(calibration)
    read = dark.noise * camera.full_scale / level
    if linearity is None:
        return Sensor(**{**camera.sensor.settings(), "read_noise": read, "read_noise_electrons": 0.0})
    # electrons of a white scene: there the sensor counts its full well
    return Sensor(read_noise=read, full_well=linearity.gain * level / camera.exposures, saturates=False)


def captured_sensor(camera: Camera, calibration: Calibration, gain: float, white: float, frames: float) -> Sensor:
    """The sensor of joined frames: the noise that they were told, rescaled as they are; electrons from the linearity.

    Args:
        camera: of the joined snapshot, with its noise.
        calibration: with dark and flat.
        gain: snapshot units of a digital number, before.
        white: snapshot units of a white scene in one frame.
        frames: whose mean an open pixel is.
    """
    level, linearity = white_level(calibration), calibration.part("linearity")
    scaled = white / (level * gain)
    settings: dict[str, Any] = {
        **camera.sensor.settings(),
        "read_noise": camera.sensor.read_noise * scaled,
        "saturates": False,
    }
    if linearity is not None:
        settings["full_well"] = linearity.gain * level * frames * camera.white / white
    return Sensor(**settings)
