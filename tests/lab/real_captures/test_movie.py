"""Frames behind a pixel shutter: the operator by a slow loop, scenes whose frames are known."""

import numpy as np
import pytest
import torch

from tmca.cameras import Snapshot, SpectralCamera
from tmca.cli.lab.real import frames_of
from tmca.decoders import decode
from tmca.decoders.kriging import shutter_samples
from tmca.decoders.space_time import frame_operator
from tmca.errors import SettingError
from tmca.sensor import Sensor


def camera(slots=8, size=(7, 6), bands=1, dispersion=0.0, **how):
    aperture = torch.ones(slots, *size)
    return SpectralCamera(bands=bands, size=size, slots=slots, aperture=aperture, dispersion=dispersion, **how)


def one_hot(slots, size, seed=0):
    chosen = torch.randint(slots, size, generator=torch.Generator().manual_seed(seed))
    return (chosen[None] == torch.arange(slots)[:, None, None]).float()


@pytest.mark.parametrize("exposure", ["equal", "per-slot"])
@pytest.mark.parametrize(("bands", "dispersion"), [(1, 0.0), (3, 1.0), (2, -2.0)])
def test_a_frame_stands_for_its_slots(exposure, bands, dispersion):
    own = camera(bands=bands, dispersion=dispersion, exposure=exposure)
    scene = torch.rand(2, 4, bands, 7, 6)
    found = frame_operator(own, 4).A(scene)
    aperture, shutter = own.codes()
    shifts = [round(d) - own.dispersion.origin for d in own.dispersion.displacement]
    wanted = torch.zeros(found.shape)
    for slot in range(8):
        for band, shift in enumerate(shifts):
            light = torch.zeros(found.shape)
            light[..., shift : shift + 6] = (aperture[slot] * scene[:, slot // 2, band])[:, None]
            wanted += shutter[slot] * light / (8 if exposure == "equal" else 1)
    torch.testing.assert_close(found, wanted)


def test_the_gram_matrix_is_solved_in_closed_form():
    operator = frame_operator(camera(bands=3, dispersion=1.0), 2).double()
    snapshot = torch.randn(1, 1, 7, 8, dtype=torch.float64)
    solved = operator.gram_solve(snapshot, 0.3)
    torch.testing.assert_close(operator.A(operator.A_adjoint(solved)) + 0.3 * solved, snapshot)


@pytest.mark.parametrize("exposure", [pytest.param("equal", marks=pytest.mark.slow), "per-slot"])
def test_the_kriged_frames_of_an_even_scene_are_even(exposure):
    own = camera(16, (10, 11), shutter=one_hot(16, (10, 11)), exposure=exposure)
    snapshot = Snapshot(own.A(torch.full((1, 1, 10, 11), 0.4)), own)
    found = decode(snapshot, "kriging", frames=4)
    torch.testing.assert_close(found.values, torch.full((1, 4, 1, 10, 11), 0.4))
    torch.testing.assert_close(found.deviation, torch.zeros(1, 4, 1, 10, 11), atol=1e-5, rtol=0)


def test_a_pixel_is_a_sample_at_the_middle_of_its_slots():
    shutter = torch.zeros(8, 3, 5)
    shutter[2:5, :, :3] = 1  # slots 2, 3 and 4: of frames 0 and 1 of two, of one frame of one
    shutter[6, :, 3] = 1
    own = camera(8, (3, 5), shutter=shutter, exposure="equal")
    snapshot = Snapshot(own.A(torch.full((1, 1, 3, 5), 0.7)), own)
    found = shutter_samples(own, frame_operator(own, 1), snapshot.values[0, 0])
    assert sorted(set(found.points[:, 2].tolist())) == [3.0, 6.0]
    assert set(found.points[:, 1].long().tolist()) == {0, 1, 2, 3}
    torch.testing.assert_close(found.values, torch.full((12,), 0.7, dtype=torch.float64))
    with pytest.raises(SettingError, match=r"^decoder: found 'kriging'.* within one frame.* take space-time-mixture"):
        decode(snapshot, "kriging", frames=2)


@pytest.mark.parametrize(("method", "share"), [("kriging", 0.35), ("space-time-dct", 0.3)])
def test_a_bar_that_moves_is_followed(method, share):
    size, slots = (40, 41), 32
    rows = np.arange(40)[None, :, None]
    edge = 12 + np.arange(slots)[:, None, None] * 0.4
    movie = np.broadcast_to(1 / (1 + np.exp((rows - edge) / 1.5)), (slots, *size)).astype(np.float32).copy()
    shutter = one_hot(slots, size)
    own = camera(slots, size, shutter=shutter, exposure="per-slot")
    values = (shutter * torch.from_numpy(movie)).sum(0)[None, None]
    found = decode(Snapshot(values, own), method, frames=8)
    truth = movie.reshape(8, 4, *size).mean(1)
    error = np.sqrt(np.mean((found.values[0, :, 0].numpy() - truth) ** 2))
    still = np.sqrt(np.mean((truth.mean(0) - truth) ** 2))
    assert error < share * still
    if found.deviation is not None:
        assert error / np.sqrt(np.mean(found.deviation.numpy() ** 2)) == pytest.approx(1, abs=0.4)


@pytest.mark.slow
def test_the_noise_of_a_sample_is_in_its_standard_deviation():
    """The error where a pixel was open, in the frame in which it was: that of its sample, little less."""
    noise, size, slots = 0.02, (48, 49), 16
    shutter = one_hot(slots, size)
    own = camera(slots, size, shutter=shutter, exposure="per-slot", sensor=Sensor(read_noise=noise))
    rows = torch.linspace(0, 9, 48)[:, None]
    scene = (0.5 + 0.3 * torch.sin(rows) * torch.cos(torch.linspace(0, 7, 49))).expand(1, 1, *size)
    found = decode(Snapshot(own(scene, generator=3), own), "kriging", frames=4)
    open_then = shutter.unflatten(0, (4, 4)).sum(1).bool()
    error = (found.values[0, :, 0] - scene[0])[open_then]
    z = error / found.deviation[0, :, 0][open_then]
    assert float(z.square().mean().sqrt()) == pytest.approx(1, abs=0.25)
    assert float(error.std()) < 1.02 * noise


def test_frames_carry_their_slots():
    own = camera(8, (5, 6), shutter=one_hot(8, (5, 6)), exposure="per-slot")
    snapshot = Snapshot(torch.rand(1, 1, 5, 6), own, {"scene": "x"})
    found = frames_of(decode(snapshot, "kriging", frames=2, lifetime=4.0))
    assert found["frames"].dims == found["frames_std"].dims == ("frame", "wavelength", "y", "x")
    assert found.attrs["scene_lifetime"] == 4
    np.testing.assert_array_equal(found["first_slot"], [0, 4])
    assert found.attrs["scene"] == "x"


def test_what_cannot_be_framed_is_refused():
    with pytest.raises(SettingError, match="frames: found 3, expected a divisor or a multiple of the 8 slots"):
        frame_operator(camera(), 3)
    snapshot = Snapshot(torch.rand(1, 1, 7, 6), camera())
    with pytest.raises(SettingError, match="opens every pixel within one frame"):
        decode(snapshot, "kriging", frames=2)
