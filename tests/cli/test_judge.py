"""``tmca design judge``: figures of codes that exist, from files of every kind that holds them."""

import pytest
import torch

from tests.cli.calls import answer, said
from tests.cli.refusals import refused
from tmca.cameras import Snapshot, SpectralCamera, SpectralDepthCamera
from tmca.codes import write_codes
from tmca.design import measures
from tmca.priors import GaussianPrior, expected_psnr
from tmca.sensor import Sensor


@pytest.fixture
def camera():
    return SpectralCamera(bands=4, size=(128, 128), slots=3, period=8, seed=5, sensor=Sensor(read_noise=0.01))


@pytest.fixture
def codes(tmp_path, camera):
    planes = [plane.tile() for plane in (camera.codes.aperture, camera.codes.shutter)]
    return write_codes(tmp_path / "codes.nc", *planes, (8, 8))


def judged(capsys, *arguments):
    return answer(capsys, "design", "judge", *arguments)


def test_a_file_of_codes_is_judged_as_the_camera_that_shows_them(capsys, camera, codes, tmp_path):
    found, own = judged(capsys, codes, "--bands", 4, "--figure", tmp_path / "codes.png"), measures(camera)
    assert found["throughput"] == pytest.approx(own.throughput)
    assert found["singular_values"] == pytest.approx(own.singular_values.tolist())
    assert sum(found["levels"].values()) == pytest.approx(1)
    torch.testing.assert_close(torch.tensor(found["correlation"]).double(), own.band_correlation.double())
    assert (tmp_path / "codes.png").exists()
    assert "above a thousandth" in said(capsys, "design", "judge", codes, "--bands", "4")


def test_a_snapshot_is_judged_under_its_own_noise_and_prior(capsys, camera, tmp_path):
    snapshot = Snapshot(torch.zeros(1, *camera.snapshot_shape), camera)
    file, prior = snapshot.save(tmp_path / "taken.nc"), tmp_path / "prior.nc"
    cube = torch.rand(4, 40, 50, generator=torch.Generator().manual_seed(0))
    known = GaussianPrior.learn([cube], (4, 20), wavelengths=camera.wavelengths)
    known.save(prior)
    found = judged(capsys, file, "--prior", prior)
    noise = camera.noise
    assert found["expected_psnr"] == pytest.approx(expected_psnr(known, camera.taps(), noise), abs=1e-3)
    noisier = judged(capsys, file, "--prior", prior, "--read-noise", "0.1")
    assert noisier["expected_psnr"] < found["expected_psnr"] - 0.2


def test_what_holds_no_aperture_codes_is_refused(capsys, codes, tmp_path):
    depth = SpectralDepthCamera.from_preset("quick", size=(32, 32), slots=1, shutter="open", channels="monochrome")
    taken = Snapshot(torch.zeros(1, *depth.snapshot_shape), depth).save(tmp_path / "depth.nc")
    assert "spectral-depth snapshot" in refused(capsys, "design", "judge", taken)
    assert "--prior" in refused(capsys, "design", "judge", codes, "--read-noise", "0.1")
    prior = tmp_path / "prior.nc"
    GaussianPrior.learn([torch.rand(3, 30, 40)], (4, 20)).save(prior)
    assert "3 bands" in refused(capsys, "design", "judge", codes, "--bands", "4", "--prior", prior)
