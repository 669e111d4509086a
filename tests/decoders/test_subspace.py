"""One network for cameras of any bands, and the one that comes with the package."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from tmca.cameras import LightFieldCamera, Snapshot, SpectralCamera
from tmca.data import rendered_scene
from tmca.decoders import Weights, decode
from tmca.decoders.nets.subspace import SubspaceNetwork
from tmca.decoders.nets.weights import FOLDER, UNIVERSAL
from tmca.errors import SettingError, ShapeError
from tmca.operators import TapOperator
from tmca.priors import SubspacePrior, interpolation
from tmca.sensor import Noise, Sensor

SMALL = {"rank": 3, "widths": [8], "blocks": 1, "stages": 2}
PRIOR = FOLDER / f"{UNIVERSAL}-prior.nc"


def small(seed: int = 0) -> SubspaceNetwork:
    """A network whose layers answer something."""
    torch.manual_seed(seed)
    network = SubspaceNetwork(**SMALL)
    torch.nn.init.normal_(network.body.leave.weight, std=0.05)
    network.basis.copy_(torch.rand(network.basis.shape))
    return network.eval()


def camera(bands: int = 4, **settings) -> SpectralCamera:
    lengths = (1e-9 * np.linspace(430, 680, bands)).tolist()
    return SpectralCamera(lengths, (13, 18), **{"slots": 3, **settings})


def seen(one: SpectralCamera):
    scene = torch.rand(2, one.bands, *one.size, generator=torch.Generator().manual_seed(1))
    operator = TapOperator(one.taps())
    return operator.A(scene), operator, Noise(0.01), 0.9 * scene


@pytest.mark.parametrize(
    "settings", [{}, {"buckets": 2, "shutter": "balanced", "slots": 4}, {"disperser": "dual"}, {"dispersion": 1.5}]
)
@pytest.mark.parametrize("bands", [1, 4, 40])
def test_one_network_serves_any_bands_codes_and_buckets(bands, settings):
    one = camera(bands, **settings)
    given, network = seen(one), small().at(one.wavelengths)
    estimate, deviation = network.moments(*given)
    assert estimate.shape == deviation.shape == (2, bands, 13, 18)
    assert (deviation > 0).all()
    alone = network(*(part[1:] if isinstance(part, torch.Tensor) else part for part in given))
    torch.testing.assert_close(alone, estimate[1:], atol=1e-5, rtol=1e-4)


def test_what_it_adds_lies_in_the_subspace_at_the_cameras_bands():
    one = camera(6)
    network = small().at(one.wavelengths)
    given = seen(one)
    added = network(*given) - given[-1]
    between = interpolation(one.wavelengths, network.knots.double() * 1e-9).float() @ network.basis
    spectra = added.transpose(0, 1).flatten(1)
    outside = spectra - between @ torch.linalg.lstsq(between, spectra).solution
    assert added.abs().max() > 1e-3
    assert outside.abs().max() < 1e-4 * added.abs().max()


def test_a_network_at_other_bands_shares_its_layers():
    network = small()
    there, elsewhere = network.at([500e-9, 600e-9]), network.at([450e-9])
    assert there.body is elsewhere.body is network.body
    assert (there.bands, elsewhere.bands) == (2, 1)
    assert there.spectra.shape == (2, 3) and elsewhere.spectra.shape == (1, 3)  # noqa: PT018
    assert there.state_dict().keys() == network.state_dict().keys()


def test_wavelengths_beyond_its_range_are_refused():
    with pytest.raises(SettingError, match="400 to 700 nm"):
        small().at([365e-9, 500e-9])
    with pytest.raises(ShapeError, match="network"):
        small().at([500e-9])(*seen(camera(2)))


def test_bands_a_little_beyond_its_range_keep_their_first_estimate():
    network = small().at([380e-9, 399.5e-9, 500e-9])
    assert network.spectra[0].eq(0).all()
    assert network.spectra[1:].ne(0).any(1).all()
    assert torch.equal(network.shapes[0], small().at([400e-9, 500e-9]).shapes[0])


def scene_of(one: SpectralCamera) -> torch.Tensor:
    cube = rendered_scene("coffee", wavelengths=list(one.wavelengths), size=one.size)["radiance"]
    return torch.from_numpy(cube.values.astype(np.float32))[None]


def decibels(estimate: torch.Tensor, scene: torch.Tensor) -> float:
    return float(-10 * torch.log10((estimate.clamp(0, 1) - scene).square().mean()))


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        {"bands": 12, "slots": 1, "aperture": "static", "shutter": "open"},
        {"bands": 12, "slots": 4, "shutter": "balanced", "buckets": 2, "sensor": Sensor(read_noise=0.01)},
        {"bands": (1e-9 * np.linspace(450, 650, 9)).tolist(), "slots": 8, "sensor": Sensor(read_noise=0.01)},
    ],
)
def test_the_one_that_comes_with_the_package_is_better_than_its_first_estimate(settings):
    one = SpectralCamera(size=(64, 72), period=16, seed=3, **settings)
    scene = scene_of(one)
    snapshot = Snapshot(one(scene, generator=0), one, {"scene": "coffee"})
    first, estimate = decode(snapshot, "lmmse", prior=PRIOR), decode(snapshot, "network", weights=UNIVERSAL)
    assert decibels(estimate.values, scene) > decibels(first.values, scene) + 0.3
    within = (estimate.values - scene).abs() <= 2 * estimate.deviation
    assert 0.5 < float(within.float().mean()) <= 1


def test_it_serves_spectral_cameras_within_its_range_alone():
    weights = Weights.find(UNIVERSAL)
    with pytest.raises(SettingError, match="400 to 700 nm"):
        weights.check(SpectralCamera([300e-9, 500e-9], (16, 16)))
    with pytest.raises(SettingError, match="spectral"):
        weights.check(LightFieldCamera(views=3, size=(16, 16)))
    with pytest.raises(SettingError, match="brings none"):
        weights.camera_for((16, 16))


def test_a_snapshot_in_double_precision_and_a_prior_of_ones_own_are_taken():
    one = SpectralCamera(4, (16, 20), 2, sensor=Sensor(read_noise=0.01))
    values = one(scene_of(one), generator=0)
    known = decode(Snapshot(values, one), "network", weights=UNIVERSAL)
    exact = decode(Snapshot(values.double(), one), "network", weights=UNIVERSAL)
    torch.testing.assert_close(exact.values.float(), known.values)
    flat = SubspacePrior(torch.full((2,), 0.3), torch.eye(2), torch.eye(2)[..., None, None], (400e-9, 700e-9))
    flat = replace(flat, moments=torch.nn.functional.pad(0.01 * flat.moments, (0, 23, 0, 11)))
    other = decode(Snapshot(values, one), "network", weights=UNIVERSAL, prior=flat)
    assert (other.values - known.values).abs().max() > 0.01


@pytest.mark.parametrize("name", ["beside", "relay_blur"])
def test_optics_that_one_code_does_not_describe_are_refused_by_their_name(name):
    one = SpectralCamera(4, (16, 20), 2, **{name: {"beside": (1, 1), "relay_blur": 0.7}[name]})
    with pytest.raises(SettingError, match=f"{name}: found"):
        decode(Snapshot(one(scene_of(one)), one), "network", weights=UNIVERSAL)
