"""What every decoder holds to on every camera that it names, at tiny and odd sizes; plug-ins are held to it too."""

from dataclasses import fields
from functools import cache, wraps

import pytest
import torch

from tests.operators.test_window_moments import camera as depth_camera
from tests.operators.test_window_moments import prior_of
from tests.small_scenes import smooth_scene
from tmca.cameras import LightFieldCamera, Snapshot, SpectralCamera
from tmca.decoders import LMMSE, Weights, build_network, decode, make_decoder
from tmca.decoders.nets.build import build_depth_network
from tmca.errors import SettingError
from tmca.priors import GaussianMixturePrior, PatchDictionary, prior_kinds
from tmca.sensor import Sensor
from tmca.testing import decoders
from tmca.testing.decoders import DecoderCase

SIZE = (13, 17)
SENSOR = Sensor(read_noise=0.02)
KINDS = ("spectral", "light-field", "spectral-depth")


def camera_for(cls, kind, buckets=1):
    if cls.name == "kriging":
        size = (7, 11)  # every pixel is predicted from its neighbours again and again
        shown = {"aperture": torch.ones(4, *size), "shutter": "one-hot"}
        return SpectralCamera(1, size, slots=4, **shown, dispersion=0.0, sensor=SENSOR)
    if kind == "spectral":
        return SpectralCamera(3, SIZE, slots=2, seed=1, sensor=SENSOR, buckets=buckets)
    if kind == "light-field":
        return LightFieldCamera(3, SIZE, slots=2, seed=1, sensor=SENSOR, buckets=buckets)
    return depth_camera(2, size=(23, 25)).replace(buckets=buckets)


def values_for(camera, seed=0):
    """(2, *snapshot_shape) snapshots of two scenes of unequal brightness."""
    height, width = camera.size
    bands = getattr(camera, "bands", None) or camera.channels
    scenes = torch.stack([smooth_scene(height, width, bands, seed=seed), 0.4 * smooth_scene(height, width, bands, 5)])
    scenes = scenes.float().clamp(0, 1)
    with torch.no_grad():
        if camera.kind == "spectral-depth":
            depth = torch.full((2, 1, height, width), 0.5 * (camera.planes.near + camera.planes.far))
            return camera(scenes, depth, generator=0)
        return camera(scenes.reshape(2, *camera.scene_shape), generator=0)


@cache
def prior_for(prior_kind, kind):
    if prior_kind is None:
        return None
    if kind == "spectral-depth":
        return prior_of((24, 24))
    channels = 3 if kind == "spectral" else 9
    block, grid = ((4, 10), None) if kind == "spectral" else ((5, 5), (3, 3))
    scene = smooth_scene(30, 40, channels, seed=3)
    if prior_kind == "mixture":
        return GaussianMixturePrior.learn([scene], block, views=grid, kinds=2, rank=8, gains=2, samples=300)
    if prior_kind != "dictionary":  # Gaussian, or a plug-in's
        return prior_kinds()[prior_kind].learn([scene], block, views=grid)
    draw = torch.randn(30, 9, 5, 5, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    draw -= draw.mean((1, 2, 3), keepdim=True)
    atoms = torch.nn.functional.normalize(draw.flatten(1), dim=1).reshape(draw.shape)
    return PatchDictionary(atoms, torch.full((30,), 0.3, dtype=torch.float64), (3, 3), 1e-4)


@cache
def weights_for(kind, buckets=1):
    torch.manual_seed(0)
    camera = camera_for(make_decoder("network", kind).__class__, kind, buckets)
    if kind == "spectral-depth":
        return Weights.of(build_depth_network({"start": "snapshot", "widths": [4, 6], "blocks": 1}, camera), camera)
    settings = {"kind": "unet", "widths": [4, 6], "blocks": 1}
    if kind == "light-field":
        settings = {"kind": "spatial-angular", "width": 4, "blocks": 1, "views": [3, 3]}
    settings |= {"buckets": buckets, "start": "dagger"}
    return Weights.of(build_network(bands=camera.channels, **settings).eval(), camera)


def settings_for(cls, kind, buckets=1):
    """Few iterations, small windows, and weights where there is a network."""
    names = {setting.name for setting in fields(cls)}
    few = {"iterations": 3} if "iterations" in names else {}
    few |= {"window": 4} if "window" in names else {}  # matrices of windows grow with its fourth power
    few |= {"changing": 0.3, "lifetime": 2.0} if "changing" in names else {}  # not looked for
    few |= {"motion": 1.0} if "motion" in names else {}  # the blocks of these priors are small
    return few | ({"weights": weights_for(kind, buckets)} if cls.name == "network" else {})


def case(cls, kind):
    camera = camera_for(cls, kind)
    return camera, values_for(camera), prior_for(cls.prior_kind, kind), settings_for(cls, kind)


def checked(cls, kind):
    """A decoder under test."""
    camera, values, prior, settings = case(cls, kind)
    # those that stop, balance their penalty, or take the level of the noise, over the whole batch
    shared = cls.name.startswith(("admm", "pnp")) or cls.name == "dictionary"
    return DecoderCase(cls(**settings), camera, values, prior, 5e-2 if shared else 1e-4)


def check_depth_has_its_shape(cls, kind):
    if kind == "spectral-depth":
        one = checked(cls, kind)
        estimate = one.decode()
        assert estimate.depth.shape == estimate.confidence.shape == (2, 1, *one.camera.size)


def check_cameras_of_other_kinds_are_refused(cls, kind):
    _, values, _, settings = case(cls, kind)
    for other in set(KINDS) - cls.cameras:
        taken = Snapshot(values, camera_for(LMMSE, other))
        for decoder in (cls.name, cls, cls(**settings)):
            with pytest.raises(SettingError) as refusal:
                decode(taken, decoder)
            assert refusal.value.where == "decoder"


def check_two_buckets(cls, kind):
    """The snapshot of both buckets is decoded, not that of the first alone; who cannot says so."""
    camera = camera_for(cls, kind, buckets=2)
    if cls.name == "kriging":
        with pytest.raises(SettingError, match="one bucket"):
            cls().prepare(camera.replace(buckets=2))
        return
    values, settings = values_for(camera), settings_for(cls, kind, 2)
    prepared = make_decoder(cls, kind, settings).prepare(camera, prior_for(cls.prior_kind, kind))
    estimate = prepared(values).values
    assert estimate.isfinite().all()
    other = torch.cat((values[:, : values.shape[1] // 2], 1.1 * values[:, values.shape[1] // 2 :]), 1)
    untrained = cls.name == "network" and kind == "spectral-depth"  # it answers zero
    assert untrained or not torch.equal(prepared(other).values, estimate)


def of_package(check):
    """A check of `tmca.testing` on a decoder and a kind of camera."""

    @wraps(check)
    def checking(cls, kind):
        if cls.name == "network" and "double_precision" in check.__name__:
            pytest.skip("networks are in single precision")
        check(checked(cls, kind))

    return checking


CHECKS = (
    *map(of_package, decoders.CHECKS),
    check_depth_has_its_shape,
    check_cameras_of_other_kinds_are_refused,
    check_two_buckets,
)
