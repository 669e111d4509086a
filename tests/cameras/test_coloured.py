"""A coloured aperture in the place of the codes."""

import pytest
import torch

from tmca.cameras import Snapshot, SpectralCamera


def coloured_camera(**changes):
    code = torch.rand(4, 6, 7, generator=torch.Generator().manual_seed(0))
    return SpectralCamera(bands=4, size=(6, 7), coloured=code, **changes), code


def test_a_coloured_aperture_weighs_every_band_by_itself():
    camera, code = coloured_camera(dispersion=2)
    scene = torch.rand(2, 4, 6, 7)
    expected = torch.zeros(2, 1, 6, 13)
    for band in range(4):
        expected[:, 0, :, 2 * band : 2 * band + 7] += code[band] * scene[:, band]
    assert torch.allclose(camera.A(scene), expected, atol=1e-6)
    assert camera.throughput() == pytest.approx(float(code.mean()))


def test_a_time_multiplexed_code_is_a_coloured_aperture_that_nobody_made():
    multiplexed = SpectralCamera(bands=4, size=(6, 7), slots=5)
    coloured = SpectralCamera(bands=4, size=(6, 7), coloured=multiplexed.code_cube())
    scene = torch.rand(1, 4, 6, 7)
    assert torch.allclose(coloured.A(scene), multiplexed.A(scene), atol=1e-6)


def test_a_snapshot_file_keeps_the_coloured_aperture(tmp_path):
    camera, code = coloured_camera()
    Snapshot(camera(torch.rand(1, 4, 6, 7)), camera).save(tmp_path / "s.nc")
    assert torch.equal(Snapshot.load(tmp_path / "s.nc").camera.code_cube(), code)
