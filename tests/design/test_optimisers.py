"""Optimisers of codes: they lower the expected error, keep codes binary and their structure, and end in an optimum."""

import itertools

import pytest
import torch

from tests.design.small_designs import BANDS, binary, designed, tile_error
from tmca.cameras import SpectralCamera
from tmca.design import KINDS, Descent, Effort, descend, designable, flip_greedily, search
from tmca.design.flips import TileState
from tmca.errors import SettingError


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("relaxed", [False, True])
def test_descent_lowers_the_error_of_binary_codes(kind, relaxed):
    period = (4, 6) if kind == "burst" else (3, 4)  # a mask for each frame alone leaves little to find in 12 pixels
    camera, error = designed(kind, 1 if kind == "static" else 3, period), tile_error()
    before = error.whole(camera)
    after = descend(camera, error, Descent(steps=30, relaxed=relaxed))
    assert after < before
    assert after == pytest.approx(error.whole(camera))
    assert binary(camera)


@pytest.mark.parametrize("kind", KINDS)
def test_flips_lower_the_error_and_keep_the_structure(kind):
    camera, error = designed(kind, 1 if kind == "static" else 4, (3, 4)), tile_error(0.02, 0.01)
    before = TileState.of(camera, error).value
    after = flip_greedily(camera, error, batch=7)
    assert after < before
    assert after == pytest.approx(TileState.of(camera, error).value, rel=1e-9)
    assert binary(camera)
    aperture, shutter = camera.codes()
    if kind == "one-hot":
        assert bool((shutter.sum(0) == 1).all())
    if kind == "complementary":
        assert bool((aperture[::2] + aperture[1::2] == 1).all())
    if kind == "static":
        assert bool((shutter == 1).all())


def test_flips_end_where_no_single_flip_helps():
    camera, error = designed("static", 1, (1, 6)), tile_error()
    value = flip_greedily(camera, error, most=20 * 80)
    latent = camera.codes.aperture.latent
    for place in range(6):
        with torch.no_grad():
            latent[0, 0, place] *= -1
            assert TileState.of(camera, error).value >= value * (1 - 1e-6)
            latent[0, 0, place] *= -1


@pytest.mark.slow
def test_descent_and_flips_come_near_the_best_of_all_codes():
    error = tile_error()
    every = []
    for bits in itertools.product((0.0, 1.0), repeat=6):
        own = SpectralCamera(bands=3, size=(1, 6), slots=1, shutter="open", aperture=torch.tensor(bits).view(1, 1, 6))
        every.append(TileState.of(own, error).value)
    found = []
    for seed in range(10):
        camera = designed("static", 1, (1, 6), seed=seed)
        descend(camera, error, Descent(steps=40, seed=seed))
        found.append(flip_greedily(camera, error, most=5 * 80))
    assert min(found) == pytest.approx(min(every), rel=1e-6)


def test_the_throughput_is_held():
    camera, error = designed("free", 2, (8, 10)), tile_error()
    descend(camera, error, Descent(steps=20, throughput=0.3))
    assert camera.throughput() == pytest.approx(0.3, abs=0.04)
    light = camera.throughput()
    flip_greedily(camera, error, throughput=(light, 0.01))
    assert camera.throughput() == pytest.approx(light, abs=0.0101)


def test_a_start_from_a_static_code_shows_it_in_every_slot():
    static = designed("static", 1, (4, 6))
    several = designed("free", 3, (4, 6), start=static)
    torch.testing.assert_close(several.operator().taps.code, static.operator().taps.code)
    error = tile_error()
    assert error.whole(several) == pytest.approx(error.whole(static), rel=1e-5)
    assert descend(several, error, Descent(steps=40)) < error.whole(static)


def test_a_start_of_fewer_slots_is_the_same_camera_in_finer_time():
    few = designed("free", 2, (4, 6), seed=3)
    many = designed("free", 6, (4, 6), start=few)
    torch.testing.assert_close(many.code_cube(), few.code_cube())
    assert tile_error().whole(many) == pytest.approx(tile_error().whole(few))
    with pytest.raises(SettingError, match="a divisor of 5"):
        designed("free", 5, (4, 6), start=few)


def test_codes_that_are_started_from_bound_the_answer_and_keep_their_kind():
    error, effort = tile_error(), Effort(descents=2, steps=8, flips=30)
    static, one_hot = (
        search(kind, k, (4, 6), error, effort=effort, bands=BANDS) for kind, k in (("static", 1), ("one-hot", 2))
    )
    free = search("free", 2, (4, 6), error, starts=[static.camera, one_hot.camera], effort=effort, bands=BANDS)
    assert free.mse <= min(static.mse, one_hot.mse) + 1e-12
    for kind, one in (("static", static), ("one-hot", one_hot)):
        again = designable(kind, one.slots, (4, 6), start=one.camera, bands=BANDS)
        assert [p.learnable for p in (again.codes.aperture, again.codes.shutter)] == [True, kind != "static"]
        flip_greedily(again, error)
        assert error.whole(again) <= one.mse + 1e-12
        assert bool((again.codes()[1].sum(0) == 1).all())
    with pytest.raises(SettingError, match="not one-hot"):
        designable("one-hot", 2, (4, 6), start=static.camera, bands=BANDS)


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: designed("pretty"), "kind"),
        (lambda: designed("static", 2), "slots"),
        (lambda: Descent(steps=0), "descent"),
        (lambda: Descent(slope=(3.0, 2.0)), "descent"),
        (lambda: flip_greedily(SpectralCamera(bands=3, size=(4, 4), slots=1), tile_error()), "learnable"),
        (lambda: descend(SpectralCamera(bands=3, size=(4, 4), slots=1), tile_error()), "learnable"),
    ],
)
def test_impossible_wishes_are_refused(make, match):
    with pytest.raises(SettingError, match=match):
        make()
