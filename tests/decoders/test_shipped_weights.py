"""The weights that come with the package: small, binary, and better than what needs no training."""

import pytest
import torch

from tmca.cameras import Snapshot
from tmca.data import rendered_scene, select_bands
from tmca.decoders import Weights, decode
from tmca.decoders.nets.weights import FOLDER, SHIPPED
from tmca.errors import DataError
from tmca.metrics import psnr
from tmca.sensor import Sensor

SENSORS = {
    "σ = 0.001": Sensor(read_noise=1e-3),
    "σ = 0.01": Sensor(read_noise=1e-2),
    "10 000 e⁻": Sensor(full_well=10_000, read_noise_electrons=3),
}


@pytest.fixture(scope="module")
def scene():
    cube = select_bands(rendered_scene("coffee", size=(96, 128))["radiance"], 12)
    return torch.from_numpy(cube.values.astype("float32"))[None]


def test_both_are_small_and_hold_binary_tiles():
    assert sum((FOLDER / f"{name}.safetensors").stat().st_size for name in SHIPPED) <= 5e6
    for slots in (1, 8):
        weights = Weights.find("default", slots)
        assert weights.slots == slots
        assert weights.prior == "rendered"
        for plane in weights.codes.values():
            assert set(plane.unique().tolist()) <= {0.0, 1.0}


@pytest.mark.parametrize("slots", [1, 8])
@pytest.mark.parametrize("noise", SENSORS)
def test_the_network_beats_the_lmmse_it_starts_from(scene, slots, noise):
    weights = Weights.find("default", slots)
    camera = weights.camera_for((96, 128), sensor=SENSORS[noise])
    snapshot = Snapshot(camera(scene, generator=0).detach(), camera)
    prior = weights.load_prior()
    plain, trained = decode(snapshot, "lmmse", prior=prior), decode(snapshot, "network", weights=weights)
    assert float(psnr(trained.estimate, scene)) > float(psnr(plain.estimate, scene)) + 0.1


def test_learned_codes_beat_random_ones_of_the_same_kind(scene):
    for slots in (1, 8):
        weights = Weights.find("default", slots)
        found = []
        for changes in ({}, {"random": True}):
            camera = weights.camera_for((96, 128), sensor=SENSORS["σ = 0.01"])
            if changes:
                settings = {"aperture": "random", "shutter": "random" if slots > 1 else "open", "period": 32}
                camera = type(camera)(
                    bands=weights.wavelengths, slots=slots, size=(96, 128), sensor=camera.sensor, **settings
                )
            snapshot = Snapshot(camera(scene, generator=0).detach(), camera)
            found.append(float(psnr(decode(snapshot, "lmmse", prior=weights.load_prior()).estimate, scene)))
        assert found[0] > found[1]


def test_a_run_s_folder_is_as_good_as_its_file(tmp_path):
    weights = Weights.find("default", 1)
    weights.save(tmp_path / "weights.safetensors")
    torch.testing.assert_close(Weights.load(tmp_path).codes, weights.codes)
    with pytest.raises(DataError, match="no such file"):
        Weights.find(tmp_path / "none")
