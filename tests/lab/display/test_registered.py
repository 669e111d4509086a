"""Codes that are placed by a registration fall on the sensor pixels that the camera was drawn with."""

import numpy as np
import pytest
import torch

from tests.cli.refusals import refused
from tmca.cameras import LightFieldCamera, Snapshot, SpectralCamera
from tmca.cli import main
from tmca.errors import DataError, SettingError
from tmca.lab.calibration.apply import registered_affine
from tmca.lab.calibration.file import Calibration
from tmca.lab.calibration.registration import Registration
from tmca.lab.display.codes import read_planes
from tmca.lab.display.devices import device_named
from tmca.lab.display.export import export_codes
from tmca.lab.display.manifest import read_export, read_frame

WAVES = (450e-9, 500e-9, 560e-9, 640e-9)
DEVICE = (97, 114)


def taken(folder, camera):
    return Snapshot(torch.zeros(1, *camera.snapshot_shape), camera).save(folder / "taken.nc", overwrite=True)


def spectral(size=(20, 23)):
    return SpectralCamera(WAVES, size, 2, dispersion=[-1.0, 0.0, 2.0, 3.0], seed=3)


def calibration(sensor, device=DEVICE, pitch=0.26, angle=0.02, wavelength=530e-9):
    """Device pixels of ``pitch`` sensor pixels, turned and mirrored in columns."""
    linear = pitch * np.array([[np.cos(angle), np.sin(angle)], [np.sin(angle), -np.cos(angle)]])
    middles = (np.array(sensor) - 1) / 2, (np.array(device) - 1) / 2
    matrix = np.hstack([linear, (middles[0] + (0.3, -0.2) - linear @ middles[1])[:, None]])
    part = Registration(matrix, np.full((2, 3), 1e-4), 0.1, 0.01, device, sensor, wavelength)
    return Calibration.empty("bench").with_part("registration", part, {"residual": 0.01}, sensor=sensor, codes=device)


def mirrors(folder, size=DEVICE):
    text = f"name: small\nkind: dmd\nsize: [{size[0]}, {size[1]}]\npattern_rate_hz: 1000\nmemory_patterns: 100\n"
    (folder / "small.yaml").write_text(text)
    return device_named(str(folder / "small.yaml"))


@pytest.mark.parametrize("size", [(20, 23), (17, 22)])
def test_every_code_pixel_is_seen_where_the_camera_has_it(tmp_path, size):
    """Device pixel by device pixel: on the middle of a sensor pixel falls the code that the camera has there."""
    camera = spectral(size)
    known = calibration(camera.snapshot_shape[1:])
    source, device = taken(tmp_path, camera), mirrors(tmp_path)
    affine = registered_affine(source, known, device)
    folder = export_codes(read_planes(source), [device], tmp_path / "out", affine=affine).folder
    frames = np.stack([read_frame(folder / "aperture" / f"aperture_{k:03d}.png") for k in range(2)])
    matrix, aperture = known.part("registration").matrix, camera.codes()[0].numpy()
    shift = np.interp(530, (500, 560), (0.0, 2.0)) + 1  # displacements count from the first, at -1
    for row in range(size[0]):
        for column in range(size[1]):
            place = np.linalg.solve(matrix[:, :2], np.array([row, column + shift]) - matrix[:, 2])
            y, x = np.round(place).astype(int)
            assert np.array_equal(frames[:, y, x], aperture[:, row, column])
    assert torch.equal(read_export(folder).planes["aperture"], camera.codes()[0])


def test_a_light_field_mask_lies_middle_on_middle(tmp_path):
    camera = LightFieldCamera(views=3, size=(16, 18), slots=2, shear=1.0, mask_scale=0.5)
    known, source = calibration((16, 18)), taken(tmp_path, camera)
    affine = np.array(registered_affine(source, known, mirrors(tmp_path)))
    matrix = known.part("registration").matrix
    for place in ((0, 0), (5, 7), tuple(n - 1 for n in camera.mask_size)):
        on_device = affine @ (*place, 1)
        on_sensor = matrix @ (*on_device, 1)
        middles = [
            (s - 1) / 2 + (p - (m - 1) / 2) / 0.5 for s, p, m in zip((16, 18), place, camera.mask_size, strict=True)
        ]
        np.testing.assert_allclose(on_sensor, middles, atol=1e-9)


def test_what_no_registration_can_place_is_refused(tmp_path):
    camera = spectral()
    sensor, source, device = camera.snapshot_shape[1:], taken(tmp_path, camera), mirrors(tmp_path)
    with pytest.raises(DataError, match="no registration"):
        registered_affine(source, Calibration.empty(), device)
    with pytest.raises(DataError, match="a registration of 97×114 pixels, expected 50×60"):
        registered_affine(source, calibration(sensor), mirrors(tmp_path, (50, 60)))
    with pytest.raises(DataError, match="sensor of 20×30 pixels"):
        registered_affine(source, calibration((20, 30)), device)
    (tmp_path / "codes.nc").write_text("none")
    with pytest.raises(DataError, match="no snapshot"):
        registered_affine(tmp_path / "codes.nc", calibration(sensor), device)
    with pytest.raises(SettingError, match="diamond"):
        registered_affine(source, calibration(sensor), device_named("dli4120", lattice="diamond"))
    coarse = calibration(sensor, pitch=1.1)
    with pytest.raises(SettingError, match="--calibration"):
        export_codes(read_planes(source), [device], tmp_path / "x", affine=registered_affine(source, coarse, device))
    assert not (tmp_path / "x").exists()


def test_the_command_takes_a_calibration(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    camera = spectral()
    source = taken(tmp_path, camera)
    mirrors(tmp_path)
    calibration(camera.snapshot_shape[1:]).save("bench")
    main(["export", str(source), "--device", "small.yaml", "--calibration", "bench", "--out", "patterns"])
    assert "20×23 code pixels on 97×114 pixels of small" in capsys.readouterr().out
    assert torch.equal(read_export("patterns").planes["aperture"], camera.codes()[0])
    again = ("export", str(source), "--device", "small.yaml", "--calibration", "bench", "--out", "other")
    assert "--macro-pixel: found 2.0 beside --calibration" in refused(capsys, *again, "--macro-pixel", "2")
    only = ("export", str(source), "--device", "emulated-shutter", "--calibration", "bench", "--out", "other")
    assert "no device of the aperture" in refused(capsys, *only)
    assert not (tmp_path / "other").exists()
