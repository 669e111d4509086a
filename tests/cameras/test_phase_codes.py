"""Masks, shutter and filters of a spectral-depth camera as a file."""

import pytest
import torch
import xarray as xr

from tests.operators.test_window_moments import BENCH, camera
from tmca.cameras import SpectralDepthCamera
from tmca.cameras.phase_codes import read_phase_codes, write_phase_codes
from tmca.errors import DataError
from tmca.optics import RotationalProfile, Stroke, ZernikeHeights


def test_a_file_of_codes_makes_the_camera_again_at_any_bands(tmp_path):
    made = camera(4, shutter="one-hot")
    file = write_phase_codes(made, tmp_path / "codes.nc", "gaussian", "rgb")
    again = SpectralDepthCamera(made.wavelengths, made.size, **read_phase_codes(file))
    assert again.bench == BENCH
    assert again.planes == made.planes
    torch.testing.assert_close(again.psf(), made.psf())
    for one, other in zip(again.tile(), made.tile(), strict=True):
        torch.testing.assert_close(one, other)
    assert SpectralDepthCamera(5, made.size, **read_phase_codes(file)).colour().shape[:2] == (3, 5)


@pytest.mark.parametrize(("family", "kept"), [("zernike", ZernikeHeights), ("rotational", RotationalProfile)])
def test_masks_keep_their_family(tmp_path, family, kept):
    made = camera(4, shutter="one-hot", mask=family, stroke=Stroke(-1e-7, 1e-7, 9))
    file = write_phase_codes(made, tmp_path / "codes.nc", "gaussian", "rgb")
    maps = read_phase_codes(file)["mask"]
    assert isinstance(maps, kept)
    torch.testing.assert_close(maps(), made.codes()[0])
    torch.testing.assert_close(maps.profile(), made.point_spread.heights.profile())
    stored = xr.load_dataset(file)
    stored["heights"] = stored["heights"] / 2
    stored.to_netcdf(tmp_path / "edited.nc")
    with pytest.raises(DataError, match="others than their modes"):
        read_phase_codes(tmp_path / "edited.nc")
