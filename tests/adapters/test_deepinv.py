"""deepinv's conventions, held against a stub of its interface and against dense matrices."""

import sys
from types import SimpleNamespace

import pytest
import torch
from torch import nn

import tmca
from tmca.adapters import as_deepinv, from_deepinv
from tmca.decoders import decoders
from tmca.errors import SettingError, ShapeError


class LinearPhysics(nn.Module):
    """What tmca uses of deepinv's class, whose own maps must not be the ones that are called."""

    def __init__(self, img_size=None, noise_model=None, **_):
        super().__init__()
        self.img_size, self.noise_model = img_size, noise_model

    def A(self, x, **_):
        raise AssertionError("deepinv's own")

    A_adjoint = A_dagger = prox_l2 = A

    def forward(self, x):
        return self.noise_model(self.A(x))


class Noise(nn.Module):
    def __init__(self, gain=0.0, sigma=0.0):
        super().__init__()
        self.gain, self.sigma = gain, sigma

    def forward(self, y):
        return y + self.sigma


@pytest.fixture
def deepinv(monkeypatch):
    names = {"PoissonGaussianNoise": Noise, "GaussianNoise": Noise, "ZeroNoise": Noise}
    stub = SimpleNamespace(physics=SimpleNamespace(LinearPhysics=LinearPhysics, **names), __spec__=object())
    monkeypatch.setitem(sys.modules, "deepinv", stub)
    return stub


def camera(**settings):
    return tmca.SpectralCamera(bands=3, size=(5, 6), slots=2, **settings).double()


def matrix(physics):
    """(m, n) of the map, column by column."""
    shape = physics.img_size
    units = torch.eye(torch.Size(shape).numel(), dtype=torch.float64).reshape(-1, *shape)
    return physics.A(units).flatten(1).T


def test_the_maps_are_those_of_the_camera(deepinv):
    taken = camera()
    physics = as_deepinv(taken)
    assert isinstance(physics, LinearPhysics)
    dense, y = matrix(physics), torch.rand(2, *taken.snapshot_shape, dtype=torch.float64)
    torch.testing.assert_close(physics.A_adjoint(y).flatten(1).T, dense.T @ y.flatten(1).T)
    torch.testing.assert_close(physics.A_dagger(y).flatten(1).T, torch.linalg.pinv(dense) @ y.flatten(1).T)


@pytest.mark.parametrize("gamma", [0.3, 7.0])
def test_the_proximal_map_has_the_weight_at_the_data_as_deepinv_has_it(deepinv, gamma):
    physics = as_deepinv(camera())
    dense, z = matrix(physics), torch.rand(1, 3, 5, 6, dtype=torch.float64)
    y = torch.rand(1, 1, 5, 8, dtype=torch.float64)
    normal = gamma * dense.T @ dense + torch.eye(dense.shape[1], dtype=torch.float64)
    expected = torch.linalg.solve(normal, gamma * dense.T @ y.flatten() + z.flatten())
    torch.testing.assert_close(physics.prox_l2(z, y, gamma).flatten(), expected)
    torch.testing.assert_close(physics.prox_l2(0.0, y, gamma), physics.prox_l2(None, y, torch.tensor(gamma)))


def test_noise_becomes_deepinvs(deepinv):
    noisy = camera(sensor=tmca.Sensor(full_well=1e4, read_noise_electrons=3))
    made = as_deepinv(noisy).noise_model
    assert (made.gain, made.sigma) == (noisy.noise.shot, noisy.noise.read)
    assert as_deepinv(camera(sensor=tmca.Sensor(read_noise=0.02))).noise_model.sigma == pytest.approx(0.02)
    assert as_deepinv(camera().operator()).noise_model.sigma == 0


def test_cameras_of_light_fields_and_depth_have_flat_channels(deepinv):
    views = tmca.LightFieldCamera(views=3, size=(8, 9), slots=2)
    assert as_deepinv(views).A(torch.rand(2, 9, 8, 9)).shape == (2, 1, 8, 9)
    depths = tmca.SpectralDepthCamera.from_preset("quick", size=(32, 32))
    physics = as_deepinv(depths, depth=torch.ones(1, 1, 32, 32))
    assert physics.A(torch.rand(1, depths.bands, 32, 32)).shape == (1, *depths.snapshot_shape)


class Adjoint(nn.Module):
    """A reconstructor of deepinv's form."""

    def forward(self, y, physics):
        assert not self.training
        return 2 * physics.A_adjoint(y)


@pytest.mark.parametrize("with_deepinv", [True, False])
def test_a_reconstructor_decodes(with_deepinv, request, monkeypatch):
    if with_deepinv:
        request.getfixturevalue("deepinv")
    else:
        monkeypatch.setattr("tmca.adapters.deepinv.find_spec", lambda name: None)
    taken = camera().float()
    snapshot = tmca.Snapshot(taken(torch.rand(1, 3, 5, 6)), taken)
    estimate = tmca.reconstruct(snapshot, from_deepinv(Adjoint()))
    torch.testing.assert_close(estimate.values, 2 * taken.A_adjoint(snapshot))
    assert (estimate.decoder, estimate.notes["model"]) == ("deepinv", "Adjoint")
    assert "deepinv" not in decoders()


def test_what_is_no_model_or_returns_no_scene_is_refused():
    taken = camera().float()
    snapshot = tmca.Snapshot(taken(torch.rand(1, 3, 5, 6)), taken)
    with pytest.raises(SettingError) as refused:
        from_deepinv(3)
    assert refused.value.where == "model"
    with pytest.raises(ShapeError, match="deepinv"):
        tmca.reconstruct(snapshot, from_deepinv(lambda y, physics: y))


def test_a_missing_library_is_named_with_its_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "deepinv", None)
    with pytest.raises(SettingError, match="pip install deepinv"):
        as_deepinv(camera())


def test_what_is_no_camera_is_refused(deepinv):
    with pytest.raises(SettingError) as refused:
        as_deepinv("spectral")
    assert refused.value.where == "camera"
