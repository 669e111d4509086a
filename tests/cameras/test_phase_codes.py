"""Masks, shutter and filters of a spectral-depth camera as a file."""

import torch

from tests.priors.test_spectral_depth import BENCH, camera
from tmca.cameras import SpectralDepthCamera
from tmca.cameras.phase_codes import read_phase_codes, write_phase_codes


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
