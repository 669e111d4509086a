"""Trained networks as files: the same decoder comes back, and cameras that they were not trained for are named."""

from pathlib import Path

import pytest
import torch

import tmca
from tmca.applications import application_of
from tmca.cameras import Snapshot, SpectralCamera
from tmca.data import rendered_scene, select_bands
from tmca.decoders import Weights, build_network, decode, usual_for
from tmca.decoders.nets.bands import same_bands
from tmca.decoders.nets.tiles import CollapsedNetwork
from tmca.errors import DataError, SettingError, ShapeError
from tmca.metrics import psnr
from tmca.sensor import Noise, Sensor

NOISE = Noise(0.01, 0.02)
SMALL = {
    "unet": {"start": "dagger", "widths": [4, 6], "blocks": 1},
    "unrolled": {"start": "dagger", "stages": 2, "widths": [4, 6], "blocks": 1},
}


def trained(kind, bands=3):
    torch.manual_seed(1)
    network = build_network(kind, bands=bands, **SMALL[kind]).eval()
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(0.1 * torch.randn(parameter.shape))
    return network


def camera(size, **settings):
    return SpectralCamera(3, size, slots=4, seed=3, **settings)


def snapshot_of(operator):
    """A scene bright at its top and dark at its foot: levels and shot noise differ from tile to tile."""
    generator = torch.Generator().manual_seed(5)
    scene = torch.rand(1, *operator.scene_shape, generator=generator)
    return operator.A(scene * torch.linspace(1, 0.05, operator.scene_shape[1])[:, None])


def weights(size=(8, 8)):
    made = camera(size)
    return Weights.of(trained("unrolled"), made, "", {"psnr": 31.5, "scenes": ["one", "two"]})


def test_a_file_of_weights_gives_the_same_camera_and_the_same_decoder(tmp_path):
    kept = weights()
    found = Weights.load(kept.save(tmp_path / "weights.safetensors"))
    mine, theirs = kept.camera_for(), found.camera_for()
    assert torch.equal(mine.operator().code, theirs.operator().code)
    assert found.wavelengths == kept.wavelengths
    assert found.card == kept.card
    assert found.load_prior() is None
    snapshot = snapshot_of(mine.operator())
    estimates = [CollapsedNetwork(w.network, mine.operator(), NOISE)(snapshot).values for w in (kept, found)]
    torch.testing.assert_close(*estimates, rtol=0, atol=2e-3)  # weights are kept in half precision
    again = Weights.load(found.save(tmp_path / "again.safetensors"))
    for name, value in found.network.state_dict().items():
        assert torch.equal(value, again.network.state_dict()[name])


def test_codes_that_do_not_repeat_fit_their_own_size_alone():
    kept = weights((8, 10))
    assert kept.camera_for((8, 10)).scene_shape[-2:] == (8, 10)
    with pytest.raises(ShapeError, match="weights: found codes of 8×10 pixels that do not repeat, expected 9×10"):
        kept.camera_for((9, 10))


@pytest.mark.parametrize("damage", ["gone", "text", "cut", "other", "misfit"])
def test_a_file_that_holds_no_weights_is_named(tmp_path, damage):
    from safetensors.torch import save_file

    path = tmp_path / "weights.safetensors"
    kept = weights()
    if damage == "text":
        path.write_text("no weights")
    elif damage == "cut":
        whole = kept.save(path).read_bytes()
        path.write_bytes(whole[: len(whole) // 2])
    elif damage == "other":
        save_file({"x": torch.zeros(3)}, path)
    elif damage == "misfit":
        kept.network.settings = {**kept.network.settings, "stages": 3}
        kept.save(path)
    with pytest.raises(DataError, match=r"weights\.safetensors"):
        Weights.load(path)


def test_weights_at_bands_that_are_a_nanometre_away_name_the_first_that_differs():
    kept = Weights.of(trained("unrolled"), SpectralCamera([400e-9, 500e-9, 700e-9], (8, 8), slots=2))
    for bands, words in (
        ([400e-9, 502e-9, 700e-9], r"number 2 at 500 nm, expected the camera's number 2 at 502 nm"),
        ([400e-9, 700e-9], r"found 3 bands of 400 to 700 nm, expected the camera's 2 bands"),
    ):
        with pytest.raises(SettingError, match=words):
            kept.check(SpectralCamera(bands, (8, 8), slots=2))
    assert same_bands(kept.wavelengths, [400.5e-9, 500e-9, 699.5e-9])


def weights_of(own, kind="unrolled", **network):
    torch.manual_seed(1)
    return Weights.of(build_network(kind, bands=3, **(SMALL[kind] | network)).eval(), own)


def seen_by(own):
    return Snapshot(own.A(torch.rand(1, 3, *own.size)), own)


@pytest.mark.parametrize(
    ("changes", "words"),
    [({"dispersion": 2.0}, "dispersion"), ({"disperser": "dual"}, "disperser"), ({"exposure": "per-slot"}, "exposure")],
)
def test_a_network_of_other_optics_is_refused(changes, words):
    weights = weights_of(camera((12, 16), period=4))
    with pytest.raises(SettingError, match=words):
        decode(seen_by(camera((12, 16), period=4, **changes)), "network", weights=weights)


def test_a_network_that_is_not_told_the_codes_warns_of_others():
    blind = weights_of(camera((12, 16), period=4), "unet", codes=False)
    decode(seen_by(camera((20, 24), period=4)), "network", weights=blind)  # the same tile on a larger frame
    with pytest.warns(UserWarning, match="trained for others"):
        decode(seen_by(SpectralCamera(3, (12, 16), slots=4, seed=9, period=4)), "network", weights=blind)
    told = weights_of(camera((12, 16), period=4), "unet")
    decode(seen_by(SpectralCamera(3, (12, 16), slots=4, seed=9, period=4)), "network", weights=told)


# The weights that come with the package

SENSORS = {
    "σ = 0.001": Sensor(read_noise=1e-3),
    "σ = 0.01": Sensor(read_noise=1e-2),
    "10 000 e⁻": Sensor(full_well=10_000, read_noise_electrons=3),
}


@pytest.fixture(scope="module")
def coffee():
    cube = select_bands(rendered_scene("coffee", size=(96, 128))["radiance"], 12)
    return torch.from_numpy(cube.values.astype("float32"))[None]


@pytest.mark.parametrize("slots", [pytest.param(1, marks=pytest.mark.slow), 8])
@pytest.mark.parametrize(
    "noise", [next(iter(SENSORS)), *(pytest.param(one, marks=pytest.mark.slow) for one in [*SENSORS][1:])]
)
def test_the_network_beats_the_lmmse_it_starts_from(coffee, slots, noise):
    weights = Weights.find("default", slots)
    camera = weights.camera_for((96, 128), sensor=SENSORS[noise])
    snapshot = Snapshot(camera(coffee, generator=0).detach(), camera)
    prior = weights.load_prior()
    plain, trained = decode(snapshot, "lmmse", prior=prior), decode(snapshot, "network", weights=weights)
    assert float(psnr(trained.estimate, coffee)) > float(psnr(plain.estimate, coffee)) + 0.1


def test_a_camera_with_shipped_codes_is_decoded_by_their_network_where_nothing_else_is_asked(coffee):
    own = Weights.find("default", 8).camera_for((64, 64), sensor=SENSORS["σ = 0.01"])
    other = SpectralCamera(own.wavelengths, (64, 64), 8, period=32, sensor=own.sensor)
    taken = Snapshot(own(coffee[..., :64, :64], generator=0).detach(), own)
    assert usual_for(own) == ("network", {"weights": "default"})
    assert decode(taken).decoder == "network"
    for unlike in (other, own.replace(exposure="per-slot"), SpectralCamera(6, (64, 64), 8, period=32),
                   SpectralCamera(12, (20, 24), 8), SpectralCamera(12, (20, 24), 1, shutter="open")):  # fmt: skip
        assert usual_for(unlike) == ("lmmse", {})
    prior = Weights.find("default", 8).load_prior()
    assert decode(taken, prior=prior).decoder == decode(taken, fast=True).decoder == "lmmse"
    assert decode(taken, adapt=1).decoder == decode(taken, "network").decoder == "network"
    for noise, usual in ((0.05, "network"), (0.1, "lmmse")):
        assert usual_for(own.replace(sensor=Sensor(read_noise=noise)))[0] == usual
    assert usual_for(own.replace(sensor=Sensor(full_well=100)))[0] == "lmmse"
    with pytest.raises(SettingError, match="none come with tmca for a pinhole camera"):
        Weights.find("default", 4, "pinhole")


def test_the_network_of_the_depth_camera_corrects_colours_of_a_rendered_scene_at_the_likelihoods_depths():
    camera = Weights.find("default", kind="spectral-depth").camera_for((72, 96), sensor=Sensor(read_noise=2e-3))
    scene = application_of("spectral-depth").demo.scene("motorcycle", (72, 96))
    taken = tmca.simulate(scene, camera, seed=0, progress=False)
    assert usual_for(camera) == ("likelihood", {})
    plain, trained = decode(taken), decode(taken, "network")
    assert trained.notes["weights"].endswith("spectral-depth.safetensors")
    torch.testing.assert_close(trained.depth, plain.depth, rtol=1e-3, atol=1e-3)
    truth = torch.from_numpy(scene["radiance"].values)[None]
    assert float(psnr(trained.values, truth)) > float(psnr(plain.values, truth)) + 0.5


@pytest.mark.parametrize(("kind", "slots"), [("spectral", 8), ("light-field", 8), ("spectral-depth", 4)])
def test_cameras_that_come_with_tmca_are_named_by_their_kind(kind, slots):
    weights = Weights.find(f"default-{kind}")
    assert (weights.kind, weights.camera.slots, weights.path) == (kind, slots, Weights.file("default", slots, kind))
    assert Weights.file("default-of-mine") == Path("default-of-mine")


@pytest.mark.slow
def test_learned_codes_beat_random_ones_of_the_same_kind(coffee):
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
            snapshot = Snapshot(camera(coffee, generator=0).detach(), camera)
            found.append(float(psnr(decode(snapshot, "lmmse", prior=weights.load_prior()).estimate, coffee)))
        assert found[0] > found[1]


def with_head(path, change):
    """Weights whose head says otherwise."""
    import json

    from safetensors import safe_open
    from safetensors.torch import save_file

    with safe_open(weights().save(path), "pt") as file:
        head, tensors = file.metadata(), {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    about = json.loads(head["tmca"])
    change(about)
    save_file(tensors, path, head | {"tmca": json.dumps(about)})
    return path


LARGE = {"widths": [1_000_000, 1_000_000], "blocks": 10**9, "stages": 10**9, "bands": 10**12, "gather": 10**6}
FRAME = {"size": "[60000, 60000]", "period": "[4, 4]"}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        *((lambda about, prior=prior: about.update(prior=prior), "the name of a file beside it")
          for prior in ("/etc/hostname", "../prior.nc", "..", "sub/prior.nc", "..\\prior.nc")),
        *((lambda about, own=own: about["network"]["settings"].update([own]), "do not fit") for own in LARGE.items()),
        (lambda about: about["camera"]["attrs"].update(FRAME), r"size = \[60000, 60000\]"),
    ],
)  # fmt: skip
def test_a_head_that_asks_for_more_than_the_file_holds_is_refused(tmp_path, change, words):
    with pytest.raises(DataError, match=words) as caught:
        Weights.load(with_head(tmp_path / "w.safetensors", change))
    assert len(str(caught.value)) < 600
