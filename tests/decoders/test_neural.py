"""A trained network as a decoder: tiles without seams, and files that give the same decoder back."""

import pytest
import torch

from tmca.cameras import Snapshot, SpectralCamera
from tmca.decoders import Weights, build_network, decode
from tmca.decoders.nets.tiles import CollapsedNetwork
from tmca.decoders.nets.weights import same_bands
from tmca.errors import DataError, OutputError, SettingError, ShapeError
from tmca.sensor import Noise

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


@pytest.mark.parametrize("kind", SMALL)
@pytest.mark.parametrize("dispersion", [1.0, 0.5])
@pytest.mark.parametrize(("height", "tile"), [(160, 64), (151, 50), (203, 37), (64, 64), (65, 64)])
def test_tiles_leave_no_seam(kind, dispersion, height, tile):
    operator = camera((height, 13), dispersion=dispersion).operator()
    snapshot, network = snapshot_of(operator), trained(kind)
    whole = CollapsedNetwork(network, operator, NOISE, tile=None)(snapshot)
    tiled = CollapsedNetwork(network, operator, NOISE, tile=tile)(snapshot)
    assert tiled.shape == whole.shape
    torch.testing.assert_close(tiled, whole, rtol=0, atol=1e-5)


def test_progress_rises_to_one():
    operator, told = camera((70, 13)).operator(), []
    CollapsedNetwork(trained("unrolled"), operator, NOISE, tile=16)(snapshot_of(operator), told.append)
    assert told == sorted(told)
    assert len(told) == 5
    assert told[-1] == pytest.approx(1)


def test_tiles_of_no_rows_are_refused():
    with pytest.raises(SettingError, match="tile"):
        CollapsedNetwork(trained("unet"), camera((8, 8)).operator(), NOISE, tile=0)


@pytest.mark.parametrize("kind", SMALL)
def test_nothing_beyond_the_reach_of_a_network_changes_its_estimate(kind):
    network = trained(kind).double()
    height, row = 2 * network.reach + 9, network.reach + 4
    operator = camera((height, 6)).operator().double()
    snapshot = snapshot_of(operator.float()).double()
    operator = operator.double()
    start = operator.A_dagger(snapshot)
    near, far = start.clone(), start.clone()
    near[:, :, row + 1] += 0.2
    far[:, :, row + network.reach + 1 :] += 0.2
    far[:, :, : row - network.reach] += 0.2
    known, moved, still = (network(snapshot, operator, NOISE, x)[:, :, row] for x in (start, near, far))
    assert (moved - known).abs().max() > 1e-6
    torch.testing.assert_close(still, known, rtol=0, atol=1e-14)


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
    estimates = [CollapsedNetwork(w.network, mine.operator(), NOISE)(snapshot) for w in (kept, found)]
    torch.testing.assert_close(*estimates, rtol=0, atol=2e-3)  # weights are kept in half precision
    again = Weights.load(found.save(tmp_path / "again.safetensors"))
    for name, value in found.network.state_dict().items():
        assert torch.equal(value, again.network.state_dict()[name])


def test_codes_that_do_not_repeat_fit_their_own_size_alone():
    kept = weights((8, 10))
    assert kept.camera_for((8, 10)).scene_shape[-2:] == (8, 10)
    with pytest.raises(ShapeError, match="weights: found codes of 8×10 pixels that do not repeat, expected 9×10"):
        kept.camera_for((9, 10))


def test_weights_are_not_written_over_another_file(tmp_path):
    path = weights().save(tmp_path / "weights.safetensors")
    before = path.read_bytes()
    with pytest.raises(OutputError):
        weights().save(path)
    assert path.read_bytes() == before


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


def test_bands_are_the_same_to_a_nanometre():
    bands = (500e-9, 600e-9)
    assert same_bands(bands, [500.5e-9, 600e-9])
    assert not same_bands(bands, [502e-9, 600e-9])
    assert not same_bands(bands, bands[:1])


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
