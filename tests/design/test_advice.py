"""Advice for a sensor: slots that fit, the same effort for all, gains that are counted from the static code."""

from dataclasses import replace
from types import SimpleNamespace as Made

import pytest
import torch

from tests.design.small_designs import designed
from tests.small_scenes import smooth_scene
from tmca.design import Effort, SensorSheet, advise, design_model, designable, learn_examples
from tmca.design.advice import _best
from tmca.design.advised import code_advice
from tmca.errors import SettingError

SMALL = Effort(descents=1, steps=3, flips=0)


@pytest.fixture(scope="module")
def examples():
    cubes = {name: smooth_scene(24, 40, seed=s) for s, name in enumerate("abc")}
    return learn_examples(cubes, design_model(designed().taps()), (4e-7, 5e-7, 6e-7))


@pytest.fixture(scope="module")
def several(examples):
    """Advice for a sensor that takes two slots and four."""
    return advise(examples, SensorSheet(), slots=[2, 4], period=(4, 6), survey=SMALL, effort=SMALL, bands=3)


def test_advice_is_shown_by_its_sentences_and_as_a_table(several):
    assert repr(several).startswith("Advice\n  advice: ")
    assert code_advice(several) in repr(several)
    assert len(repr(several).splitlines()) == 4
    assert "data:image/png" in several._repr_html_()
    table = several.to_pandas()
    assert table["codes"].tolist() == [each.design.kind for each in several.finals]
    assert table["gain"].tolist() == [each.gain for each in several.finals]


def test_slots_that_fit_the_exposure():
    assert SensorSheet().most_slots is None
    assert SensorSheet(exposure=0.02, pattern_rate=400).most_slots == 8
    assert SensorSheet(exposure=0.02, pattern_rate=1000, slot_time=0.003).most_slots == 6
    assert SensorSheet(exposure=0.02, pattern_rate=400).allowed(None) == [2, 4, 8]
    assert SensorSheet(exposure=0.02, pattern_rate=400).allowed([1, 5, 3, 5]) == [3, 5]
    with pytest.raises(SettingError, match=r"9 slots.*at most 8"):
        SensorSheet(exposure=0.02, pattern_rate=400).allowed([9])


@pytest.mark.parametrize(
    "changes",
    [{"exposure": 0.0}, {"pattern_rate": 100}, {"exposure": 1, "slot_time": -1}, {"bits": 0}, {"full_well": -1},
     {"read_noise": -0.1}, {"read_noise_electrons": 3}, {"buckets": 0}, {"buckets": 3}, {"buckets": 1.5}],
)  # fmt: skip
def test_impossible_sensors_are_refused(changes):
    with pytest.raises(SettingError):
        SensorSheet(**changes)


def test_gains_are_counted_from_the_static_code_scene_by_scene(examples):
    sheet = SensorSheet(full_well=10_000, read_noise_electrons=3)
    found = advise(examples, sheet, slots=[2], period=(4, 6), survey=SMALL, effort=SMALL, bands=3)
    assert [(c.design.kind, c.design.slots) for c in found.surveyed] == [
        ("static", 1),
        ("one-hot", 2),
        ("free", 2),
        ("burst", 2),
    ]
    noise = sheet.sensor().noise(3.0)
    assert found.noise == (noise.read, noise.shot)
    for name in "abc":
        gain = found.chosen.held_out[name] - found.static.held_out[name]
        assert found.chosen.gains[name] == pytest.approx(gain)
    assert found.static.gain == 0
    # free codes contain the static and the one-hot ones, and start from both
    assert found.surveyed[2].design.mse <= found.surveyed[1].design.mse * (1 + 1e-6)
    free = advise(examples, sheet, slots=[2], kinds=["free"], period=(4, 6), survey=SMALL, effort=SMALL, bands=3)
    assert free.chosen.design.mse <= free.static.design.mse * (1 + 1e-6)


def test_one_descent_starts_from_the_best_codes_that_are_contained(several):
    mse = {(c.design.kind, c.design.slots): c.design.mse for c in several.surveyed}
    for slots in (2, 4):
        assert mse["free", slots] <= min(mse["one-hot", slots], mse["static", 1]) * (1 + 1e-6)


def test_the_share_that_is_done_counts_each_search_by_its_effort(examples):
    told = []
    survey, effort = Effort(1, 2, 0), Effort(1, 6, 0)
    advise(
        examples, SensorSheet(), slots=[2], kinds=["one-hot"], period=(4, 6), survey=survey, effort=effort,
        progress=lambda share, step: told.append((share, step)), bands=3,
    )  # fmt: skip
    shares = [share for share, _ in told]
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1)
    # a step of the burst, which is read twice, counts as four
    assert max(share for share, step in told if "survey" in step) == pytest.approx(12 / 48)
    assert max(share for share, step in told if step == "static") == pytest.approx(18 / 48)


def test_no_slot_that_fits_leaves_the_static_code(examples):
    sheet = SensorSheet(exposure=0.001, pattern_rate=1000)
    found = advise(examples, sheet, period=(4, 6), survey=SMALL, effort=SMALL, bands=3)
    assert (found.chosen, found.burst, found.multiplex) == (None, None, False)


@pytest.mark.slow
def test_codes_that_cannot_hold_the_light_are_left_out(examples):
    how = {"slots": [4, 2], "throughput": 0.9, "period": (4, 6), "survey": SMALL, "effort": SMALL, "bands": 3}
    found = advise(examples, SensorSheet(), kinds=["one-hot"], **how)
    assert found.chosen is None
    assert found.left_out == (("one-hot", 2), ("one-hot", 4))
    some = advise(examples, SensorSheet(), kinds=["one-hot", "free"], **{**how, "slots": [2]})
    assert {c.design.kind for c in some.surveyed} == {"static", "burst", "free"}
    assert some.left_out == (("one-hot", 2),)


@pytest.mark.filterwarnings("always::tmca.sensor.SensorWarning")
@pytest.mark.slow
def test_noise_beyond_the_signal_is_not_multiplexed(examples):
    sheet = SensorSheet(read_noise=30.0)
    found = advise(examples, sheet, slots=[4], kinds=["one-hot"], period=(4, 6), survey=SMALL, effort=SMALL, bands=3)
    assert not found.multiplex
    assert found.best is found.static


@pytest.mark.slow
def test_a_second_bucket_is_tried_beside_the_first_and_a_burst(examples):
    sheet = SensorSheet(read_noise=0.02, buckets=2)
    found = advise(examples, sheet, slots=[2, 4], period=(4, 6), survey=SMALL, effort=SMALL, bands=3)
    assert [c.design.kind for c in found.finals] == ["static", found.one.design.kind, "two-bucket", "burst"]
    tried = [(c.design.kind, c.design.slots) for c in found.surveyed]
    assert [k for kind, k in tried if kind == "two-bucket"] == [2, 4]
    assert [k for kind, k in tried if kind == "burst"] == [2]
    # codes of two buckets contain the burst, and those of fewer slots, and start from them
    mse = {each: c.design.mse for each, c in zip(tried, found.surveyed, strict=True)}
    assert mse["two-bucket", 4] <= mse["two-bucket", 2] * (1 + 1e-6) <= mse["burst", 2] * (1 + 2e-6)
    assert found.two.gain > found.one.gain
    assert found.chosen is found.best is found.two


def test_a_burst_is_the_rival_and_never_chosen(examples):
    how = {"slots": [2], "period": (4, 6), "survey": SMALL, "effort": SMALL, "bands": 3}
    found = advise(examples, SensorSheet(read_noise=0.02), kinds=["burst"], **how)
    assert (found.chosen, found.multiplex, found.best) == (None, False, found.static)
    assert found.burst.gain > 0
    assert found.burst.alike
    longer = advise(examples, SensorSheet(read_noise=1e-6), kinds=["burst"], **{**how, "slots": [4]})
    assert [(c.design.slots, c.design.camera.buckets) for c in longer.surveyed[1:]] == [(2, 2), (4, 4)]
    assert longer.surveyed[2].design.mse <= longer.surveyed[1].design.mse * (1 + 1e-6)
    with pytest.raises(SettingError, match="one bucket"):
        advise(examples, SensorSheet(read_noise=0.02), kinds=["two-bucket"], **how)


def test_every_bucket_has_its_own_read_noise_and_the_exposure_is_the_same(examples):
    """A static scene behind one aperture: two buckets hold half of the light each, each with the whole read noise."""
    camera = designed("two-bucket", 2, (4, 6))
    assert camera.white == designed("static", 1, (4, 6)).white
    both = camera.code_cube().detach().unflatten(0, (2, -1)).sum(0)
    assert float(both.mean()) == pytest.approx(camera.throughput(), rel=1e-5)
    burst = designable("burst", 2, (4, 6), bands=3)
    with torch.no_grad():
        burst.codes.aperture.latent.copy_(burst.codes.aperture.latent[:1].expand_as(burst.codes.aperture.latent))
        static = designable("static", 1, (4, 6), bands=3)
        static.codes.aperture.latent.copy_(burst.codes.aperture.latent[:1])
    shot = 3 / 10_000
    for read in (0.0, 0.02):
        one = examples.tile_mse(2**0.5 * read, shot).whole(static)  # the sum of both reads
        assert examples.tile_mse(read, shot).whole(burst) == pytest.approx(one, rel=1e-4)


def made(kind, slots, gain):
    return Made(design=Made(kind=kind, slots=slots), gain=gain)


def test_the_fewest_slots_near_the_best_are_taken():
    found = [made("free", 2, 0.85), made("free", 4, 1.9), made("free", 8, 2.05), made("burst", 2, 9.0)]
    assert _best(found, "one", 0.1).design.slots == 4
    assert _best(found, "one", 0.0).design.slots == 8
    low = [made("free", 2, 0.42), made("one-hot", 2, 0.45), made("free", 4, 0.5)]
    assert _best(low, "one", 0.0) is low[1]  # 0.1 dB count even where they are more than the share


def test_what_more_slots_gave_is_told_of_codes_with_as_many_buckets(several):
    own = replace(several, one=several.surveyed[1], two=None)
    surveyed = {(c.design.kind, c.design.slots): c.gain for c in several.surveyed}
    best = own.best.design
    if own.multiplex and best.slots == 2:
        most = max(surveyed["one-hot", 4], surveyed["free", 4])
        assert own.more_slots == {4: pytest.approx(most - surveyed[best.kind, 2])}
    else:
        assert 2 not in own.more_slots
