"""What a search advises, in a sentence."""

from types import SimpleNamespace as Made

import pytest

from tmca.reports.words import code_advice, mask_advice


def codes(gain=0.5, spread=0.2, **changes):
    best = Made(design=Made(slots=4, kind="free"), gain=gain, spread=spread)
    return Made(**{"chosen": best, "best": best, "multiplex": True, "left_out": (), "throughput": 0.9, **changes})


@pytest.mark.parametrize(
    ("advice", "said"),
    [
        (codes(), "Use 4 slots with free codes: +0.5 dB over the static code, ± 0.2 dB from scene to scene."),
        (codes(spread=0.7), ", no more than the spread."),
        (codes(spread=None), "one example scene"),
        (codes(multiplex=False), "Do not multiplex"),
        (codes(chosen=None), "One slot is all that was tried or fits the exposure: use the static code."),
        (codes(chosen=None, left_out=(("one-hot", 2), ("one-hot", 4))),
         "use the static code. Left out, as they cannot let through 90% of the light: one-hot, K = 2, 4."),
    ],
)  # fmt: skip
def test_codes_are_advised_with_their_gain(advice, said):
    assert said in code_advice(advice)


def masks(*expected, errors=None):
    candidates = tuple(Made(slots=k, expected=value, errors=errors) for k, value in enumerate(expected, 1))
    best = candidates[-1]
    return Made(candidates=candidates, static=candidates[0], best=best, multiplex=best.expected < 0.9 * expected[0],
                saved=lambda candidate: 1 - candidate.expected / expected[0])  # fmt: skip


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
