"""What a search advises, in a sentence."""

from types import SimpleNamespace as Made

import pytest

from tmca.design import MaskAdvice
from tmca.design.advised import advice_lines, code_advice
from tmca.design.mask_advised import mask_advice
from tmca.reports.codes import columns_of


def design(kind="free", gain=0.5, spread=0.2, alike=False, slots=4):
    return Made(design=Made(slots=slots, kind=kind), gain=gain, spread=spread, psnr=30 + gain, alike=alike)


def codes(gain=0.5, spread=0.2, one=None, two=None, burst=None, frames=2, **changes):
    best = two or one or design(gain=gain, spread=spread)
    rival = None if burst is None else design("burst", burst, slots=frames)
    told = {"static": design("static", 0.0), "one": one, "two": two, "burst": rival, "chosen": best, "best": best}
    usual = {"multiplex": True, "left_out": (), "throughput": 0.9, "more_slots": {}, "within": 0.1}
    return Made(**told | usual | changes)


@pytest.mark.parametrize(
    ("advice", "said"),
    [
        (codes(), "Use 4 slots with free codes: +0.5 dB over the static code, ± 0.2 dB from scene to scene."),
        (codes(spread=0.7), ", no more than the spread: it may not be better."),
        (codes(more_slots={8: 0.04, 16: -0.1}),
         "These are the fewest slots within 0.1 dB or 10% of the best; more gave in the survey: K = 8 +0.0 dB, K = 16 "
         "-0.1 dB."),
        (codes(more_slots={8: 0.04}, within=0.0), "the fewest slots within 0.1 dB of the best; more gave"),
        (codes(spread=None), "one example scene"),
        (codes(multiplex=False), "Do not multiplex"),
        (codes(chosen=None), "One slot is all that was tried or fits the exposure: use the static code."),
        (codes(chosen=None, left_out=(("one-hot", 2), ("one-hot", 4))),
         "use the static code. Left out, as they cannot let through 90% of the light: one-hot, K = 2, 4."),
    ],
)  # fmt: skip
def test_codes_are_advised_with_their_gain(advice, said):
    assert said in code_advice(advice)


@pytest.mark.parametrize(
    ("advice", "said"),
    [
        (codes(one=design(), two=design("two-bucket", 2.5), burst=1.5),
         "The codes gain 1.0 dB over the burst. "
         "This sensor with two buckets: 32.5 dB (two-bucket, K = 4); with one bucket: 30.5 dB (free, K = 4); "
         "static: 30.0 dB; a burst of two frames: 31.5 dB. "
         "The second bucket gains 2.0 dB, as the light of closed slots is read too. "
         "Trust differences to within ± 0.2 dB"),
        (codes(one=design(), two=design("two-bucket", 2.5, alike=True), burst=2.5), "codes are a burst themselves"),
        (codes(one=design(), burst=1.5), "The burst is 1.0 dB better: prefer it if the scene stands still"),
        (codes(one=design(), burst=1.5, frames=4), "the sensor can be read 4 times in this time. This sensor"),
        (codes(one=design(), burst=1.5, frames=4), "a burst of four frames: 31.5 dB"),
        (codes(one=design(), burst=0.45), "The burst is as good where the scene stands still; take the codes"),
        (codes(one=design(), two=design("two-bucket", 0.5), chosen=None, multiplex=False, burst=0.0),
         "The second bucket is not worth it (+0.0 dB)."),
    ],
)  # fmt: skip
def test_codes_are_compared_with_their_rivals(advice, said):
    assert said in code_advice(advice)


def test_a_better_burst_is_the_second_line_and_names_two_buckets_where_none_were_tried():
    said = advice_lines(codes(one=design(), burst=1.5, more_slots={8: 0.1}))
    assert [line.split()[0] for line in said] == ["Use", "The", "This", "These", "Trust"]
    assert said[1].startswith("The burst is 1.0 dB better")
    assert said[1].endswith("add --buckets 2.")
    both = advice_lines(codes(one=design(), two=design("two-bucket", 0.9), burst=1.5))
    assert "--buckets" not in " ".join(both)


def masks(*expected, errors=None, two=(), burst=None, alike=False):
    def made(slots, buckets, value):
        return Made(slots=slots, buckets=buckets, expected=value, errors=errors, alike=alike and buckets == 2)

    candidates = [made(k, 1, value) for k, value in enumerate(expected, 1)]
    candidates += [made(k, 2, value) for k, value in enumerate(two, 2)]
    return MaskAdvice(tuple(candidates), None if burst is None else made(2, 2, burst))


@pytest.mark.parametrize(
    ("advice", "said"),
    [
        (masks(1.0, 0.5), "Use 2 slots: the predicted depth confusion is 50% below the best static mask's (1 bins)."),
        (masks(1.0, 2.0, errors=(1.0, 2.0)), "A static mask is enough: the depth error on the example scenes of K = 2"),
        (masks(1.0, 2.0), "100% above"),
        (masks(1.0), "take the static mask"),
    ],
)
def test_masks_are_advised_with_what_they_save(advice, said):
    assert said in mask_advice(advice)


@pytest.mark.parametrize(
    ("advice", "said"),
    [
        (masks(1.0, 0.8, two=(0.7, 0.4), burst=0.7),
         "Use 3 slots with two buckets: the predicted depth confusion is 60% below the best static mask's (1 bins). "
         "A burst of two frames is 30% below it. "
         "Two buckets leave 0.4 bins (K = 3), one 0.8 bins (K = 2): the second bucket saves 40% of the static "
         "mask's error, worth it."),
        (masks(1.0, 0.8, two=(0.4,), burst=0.4, alike=True), "These masks are a burst themselves"),
        (masks(1.0, 0.5, two=(0.45,), burst=0.45),
         "Use 2 slots: the predicted depth confusion is 50% below the best static mask's (1 bins). A burst of two "
         "frames is 55% below it: as good where the scene stands still; take the masks if it moves. Two buckets leave "
         "0.45 bins (K = 2), one 0.5 bins (K = 2): the second bucket saves 5% of the static mask's error, not "
         "worth it."),
        (masks(1.0, 0.5, two=(0.6,), burst=0.6), "the second bucket saves nothing."),
        (masks(1.0, 0.8, two=(0.7,), burst=0.5), "50% below it: prefer it if the scene stands still"),
        (masks(1.0, 1.2, two=(0.95,), burst=0.95), "confusion of K = 2, two buckets, the best with more slots"),
        (masks(1.0, 1.2, two=(0.95,), burst=0.95), "take the static mask if it moves"),
    ],
)  # fmt: skip
def test_masks_of_two_buckets_are_compared_with_one_bucket_and_with_the_burst(advice, said):
    assert said in mask_advice(advice)


def test_one_scene_has_no_columns_of_the_others():
    named = [[name for name, *_ in columns_of({"scenes": scenes})] for scenes in (["a"], ["a", "b"])]
    assert {*named[1]} - {*named[0]} == {"held_out_psnr", "spread"}
    assert "gain" in named[0]


def test_advice_about_masks_is_shown_by_its_sentences_and_as_a_table():
    found = masks(1.0, 0.5)
    assert repr(found) == f"MaskAdvice\n  advice: {mask_advice(found)}\n  masks: K = 2"
    rows = {"slots": [1, 2], "buckets": [1, 1], "expected": [1.0, 0.5], "saved": [0.0, 0.5]}
    assert found.to_pandas().to_dict("list") == rows
    assert repr(masks(1.0, 0.8, two=(0.5,), burst=0.5)).endswith("masks: K = 2, two buckets")
