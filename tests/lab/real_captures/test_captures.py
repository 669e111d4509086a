"""Captures become snapshots in the package's units, with everything known of them; what does not fit is refused."""

import json

import numpy as np
import pytest
import torch

from tests.lab.real_captures.bench import DESCRIBED, SHUTTERED, captured, mask_of, prototype_of, smooth_scene, write_mat
from tmca.cameras import Snapshot
from tmca.data import checksum_of, read_array
from tmca.decoders import decode
from tmca.errors import DataError, SettingError
from tmca.lab.importing import dark_noise, import_capture
from tmca.lab.prototype import load_prototype


@pytest.fixture
def bench(tmp_path):
    """A prototype, and the files of its mask and of a capture of a known scene."""
    mask, scene = mask_of(40, 43), smooth_scene(4, 40, 43)
    prototype = prototype_of(tmp_path, DESCRIBED)
    response = prototype.response_of_bands()
    light = captured(scene * response[:, None, None], mask)
    white = mask.mean() * response.sum()
    write_mat(tmp_path / "capture.mat", y=0.1 + 0.8 * light / white)
    write_mat(tmp_path / "mask.mat", mask=mask)
    return tmp_path, prototype, scene, light


def test_the_snapshot_is_what_its_camera_makes_of_the_scene(bench):
    folder, prototype, scene, light = bench
    taken = import_capture(folder / "capture.mat", prototype, folder / "mask.mat")
    np.testing.assert_allclose(taken.values[0, 0], light, atol=1e-5)
    imaged = taken.camera.A(torch.from_numpy(scene)[None].float())
    np.testing.assert_allclose(taken.values, imaged, atol=1e-4)
    assert taken.camera.dispersion.displacement == (0.0, 2.0, 4.0, 6.0)


def test_levels_checksums_and_noise_stay_in_the_file(bench):
    folder, prototype, _, _ = bench
    taken = import_capture(folder / "capture.mat", prototype, folder / "mask.mat", noise=0.004)
    taken.save(folder / "snapshot.nc")
    back = Snapshot.load(folder / "snapshot.nc")
    assert back.notes["source_sha256"] == checksum_of(folder / "capture.mat")
    assert back.notes["mask_sha256"] == checksum_of(folder / "mask.mat")
    assert (back.notes["scene"], back.notes["device"], back.notes["black_level"]) == ("a plain", "paper", 0.1)
    assert json.loads(back.notes["registration"])["blur"] == 0
    assert back.camera.noise.read == pytest.approx(0.004 * back.notes["gain"])
    np.testing.assert_array_equal(back.values, taken.values)
    torch.testing.assert_close(back.camera.codes()[0], taken.camera.codes()[0])
    found = decode(back, "admm-tv-joint").estimate
    assert (back.camera.A(found) - back.values).norm() < 0.05 * back.values.norm()


def test_noise_is_that_of_the_darkest_part():
    rng = np.random.default_rng(0)
    capture = 0.02 + 0.003 * rng.standard_normal((200, 180))
    capture[:, 60:] += np.linspace(0, 1, 120) + 0.1 * rng.standard_normal((200, 120))
    assert dark_noise(capture) == pytest.approx(0.003, rel=0.05)


def test_what_does_not_fit_is_refused(bench, tmp_path):
    folder, prototype, _, _ = bench
    capture, mask = folder / "capture.mat", folder / "mask.mat"
    with pytest.raises(SettingError, match="--mask: found none"):
        import_capture(capture, prototype)
    with pytest.raises(SettingError, match="--name"):
        import_capture(capture, prototype, mask, name="opt")
    narrow = write_mat(tmp_path / "narrow.mat", mask=mask_of(40, 41))
    with pytest.raises(DataError, match=r"40×49 pixels, expected 40×47"):
        import_capture(capture, prototype, narrow)
    bright = write_mat(tmp_path / "bright.mat", mask=3 * mask_of(40, 43))
    with pytest.raises(DataError, match="transmittances between 0 and 1"):
        import_capture(capture, prototype, bright)


def noisy(bench, seed=0):
    """A capture with noise of 0.002 beside a white level of 0.9 and a black one of 0.1."""
    values = read_array(bench[0] / "capture.mat", "y")
    return values + 0.002 * np.random.default_rng(seed).standard_normal(values.shape)


BAD = {
    "zeros": lambda values: 0 * values,
    "saturated": lambda values: values.clip(max=np.quantile(values, 0.4)),
    "complex": lambda values: values + 0.01j,
    "clipped black": lambda values: np.where(np.arange(49) < 20, 0.1, values),
}


@pytest.mark.parametrize("fault", BAD)
def test_captures_that_are_none_are_refused(bench, tmp_path, fault):
    bad = write_mat(tmp_path / "bad.mat", y=BAD[fault](noisy(bench)))
    with pytest.raises(DataError) as found:
        import_capture(bad, bench[1], bench[0] / "mask.mat")
    assert found.value.where == str(bad)


def test_a_complex_array_is_refused_whatever_its_file(bench, tmp_path):
    np.save(tmp_path / "c.npy", noisy(bench) + 0.01j)
    plain = bench[1].model_copy(update={"capture_key": "c"})
    with pytest.raises(DataError, match="of type complex128, expected real numbers"):
        import_capture(tmp_path / "c.npy", plain, bench[0] / "mask.mat")


@pytest.mark.parametrize("noise", [np.nan, np.inf, -0.1])
def test_an_impossible_noise_is_refused(bench, noise):
    with pytest.raises(SettingError, match="--noise"):
        import_capture(bench[0] / "capture.mat", bench[1], bench[0] / "mask.mat", noise=noise)


def test_a_pixel_shutter_brings_its_slots(tmp_path):
    rng = np.random.default_rng(0)
    slots = rng.permuted(np.tile(np.arange(8), (6, 7, 1)), axis=2)[..., 0]
    shutter = (slots[..., None] == np.arange(8)).astype(np.uint8)
    file = write_mat(tmp_path / "c.mat", a=rng.uniform(10, 250, (6, 7)), s=shutter)
    prototype = prototype_of(tmp_path, SHUTTERED)
    taken = import_capture(file, prototype, name="one")
    assert taken.camera.slots == 8
    np.testing.assert_array_equal(taken.camera.codes()[1], np.moveaxis(shutter, -1, 0))
    white = taken.camera.A(torch.ones(1, 1, 6, 7))
    np.testing.assert_allclose(white, 1)
    with pytest.raises(SettingError, match="expected one of one"):
        import_capture(file, prototype, name="two")
    with pytest.raises(SettingError, match="none: the shutter lies"):
        import_capture(file, prototype, file, name="one")


@pytest.mark.parametrize("scene", ["real_scene1", "real_scene2", "real_scene3"])
def test_the_real_captures_fit_their_prototype(real_data, scene):
    folder = real_data / "cassi" / "tsa"
    taken = import_capture(folder / f"{scene}.mat", load_prototype("tsa"), folder / "mask_660_real.mat")
    assert taken.camera.snapshot_shape == (1, 660, 714)
    assert taken.camera.size == (660, 660)
    assert 0.001 < taken.notes["noise_in_capture"] < 0.002


@pytest.mark.slow
def test_the_real_shutters_open_every_pixel_once(real_data):
    file = real_data / "cassi" / "pixel_shutter_wine" / "wine.mat"
    for name in ("opt", "rnd"):
        taken = import_capture(file, load_prototype("pixel-shutter-wine"), name=name)
        torch.testing.assert_close(taken.camera.codes()[1].sum(0), torch.ones(253, 254))
