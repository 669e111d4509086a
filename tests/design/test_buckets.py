"""Expected errors, searches and files of codes for sensors with two buckets a pixel."""

import pytest
import torch

from tests.small_scenes import smooth_scene
from tmca.cameras import SpectralCamera
from tmca.codes.files import read_codes, write_codes
from tmca.data import read_dataset, write_dataset
from tmca.design import designable
from tmca.design.expected_error import BlockMse, TileMse, design_model, even_places, windows
from tmca.design.search import Effort, search
from tmca.design.transfer import learn_examples
from tmca.errors import DataError, SettingError, ShapeError
from tmca.operators.blocks import BlockModel
from tmca.priors import GaussianPrior

BANDS, PERIOD = 3, (4, 6)
SCENES = {f"scene {seed}": smooth_scene(24, 30, BANDS, seed=seed) for seed in range(2)}


def camera(kind="two-bucket", slots=2, **more):
    return designable(kind, slots, PERIOD, bands=BANDS, **more)


def examples():
    model = design_model(camera("static", 1).taps(), rows=2)
    return learn_examples(SCENES, model, camera().wavelengths)


@pytest.mark.parametrize("kind", ["two-bucket", "burst"])
@pytest.mark.parametrize("noise", [(0.02, 0.0), (0.01, 0.003)])
def test_the_expected_error_is_that_of_the_whole_matrix(kind, noise):
    """Block by block: ``tr S - tr S Aᵀ (A S Aᵀ + R)⁻¹ A S`` with the rows of both buckets in A."""
    made, example = camera(kind), examples()
    taps = made.taps()
    model, prior = BlockModel.of(taps, example.model.block), example.prior
    places = even_places(model, PERIOD, 1)
    seen = windows(taps.code.double(), model.block, places)
    direct = example.tile_mse(*noise).for_buckets(2).error(seen)
    from tmca.design.measures import block_matrices

    for matrix, error in zip(block_matrices(model, seen), direct, strict=True):
        expected = matrix @ prior.mean.flatten()
        variance = noise[0] ** 2 + 1e-9 + noise[1] * expected.clamp_min(0)
        cross = matrix @ prior.covariance
        solved = torch.linalg.solve(cross @ matrix.T + torch.diag(variance), cross)
        left = prior.variance - (cross * solved).sum(0)
        torch.testing.assert_close(error, model.in_valid(left[None]).mean(), rtol=1e-6, atol=0)


def test_errors_for_buckets_are_those_of_a_model_of_buckets():
    prior = GaussianPrior.learn(list(SCENES.values()), (2, 9))
    one, two = (BlockModel.of(camera(kind, slots).taps(), prior.block) for kind, slots in (("static", 1), ("burst", 2)))
    made, direct = BlockMse.of(prior, one, 0.01).for_buckets(2), BlockMse.of(prior, two, 0.01)
    assert made.model == direct.model
    for name in ("covariance", "reach", "mean"):
        torch.testing.assert_close(getattr(made, name), getattr(direct, name))


def test_codes_of_two_buckets_are_not_judged_by_a_model_of_one():
    with pytest.raises(ShapeError):
        TileMse(BlockMse.of(examples().prior, examples().model, 0.01))(camera().taps().code)


def test_a_search_lowers_the_error_and_two_buckets_beat_one():
    error, effort = examples().tile_mse(0.01, 0.0), Effort(descents=1, steps=8, flips=20)
    best = {
        kind: search(kind, 2, PERIOD, error, effort=effort, bands=BANDS) for kind in ("free", "two-bucket", "burst")
    }
    assert best["two-bucket"].mse < best["two-bucket"].random
    assert best["two-bucket"].mse < best["free"].mse
    frames = best["burst"].camera.codes.shutter()
    assert frames.unflatten(0, (2, 2))[:, :, 0, 0].tolist() == [[1, 0], [0, 1]]  # a search leaves a burst a burst


@pytest.mark.parametrize("kind", ["two-bucket", "burst"])
def test_codes_files_say_how_many_buckets(kind, tmp_path):
    made = camera(kind)
    codes = made.codes
    file = write_codes(tmp_path / "c.nc", codes.aperture.tile(), codes.shutter.tile(), PERIOD, buckets=made.buckets)
    again = SpectralCamera(bands=BANDS, size=PERIOD, **read_codes(file).settings())
    assert again.buckets == 2
    assert torch.equal(again.taps().code, made.taps().code)


@pytest.mark.parametrize(("about", "told"), [({}, "no attribute buckets"), ({"buckets": 3}, "buckets = 3")])
def test_codes_whose_file_says_other_buckets_are_refused_by_that_attribute(tmp_path, about, told):
    made, file = camera().codes, tmp_path / "c.nc"
    shutter = made.shutter.tile()
    write_codes(file, made.aperture.tile(), torch.cat([shutter, 1 - shutter]), PERIOD, buckets=2)
    stored = read_dataset(file)
    stored.attrs = {"period": stored.attrs["period"], **about}
    other = write_dataset(stored, tmp_path / "other.nc")
    with pytest.raises(DataError, match=rf"{told}, expected .*\(bucket, slot, rows, columns\)"):
        read_codes(other)


def test_a_burst_has_a_frame_in_each_slot_and_a_longer_one_contains_the_shorter():
    error, effort = examples().tile_mse(1e-6, 0.0), Effort(descents=1, steps=6, flips=0)
    two = search("burst", 2, PERIOD, error, effort=effort, bands=BANDS)
    four = search("burst", 4, PERIOD, error, effort=effort, starts=[two.camera], bands=BANDS)
    frames = four.camera.codes.shutter().unflatten(0, (4, 4))
    assert torch.equal(frames[:, :, 0, 0], torch.eye(4))
    assert (frames == frames[..., :1, :1]).all()
    assert (two.camera.buckets, four.camera.buckets) == (2, 4)
    assert four.mse <= two.mse * (1 + 1e-6)


@pytest.mark.parametrize(("slots", "start", "said"), [
    (1, None, "each frame of a burst has a slot"), (4, camera("free"), "patterns"), (5, camera("burst"), "a divisor"),
])  # fmt: skip
def test_other_codes_are_no_burst(slots, start, said):
    with pytest.raises((SettingError, ShapeError), match=said):
        camera("burst", slots, start=start)
