"""Masks that are searched with equal effort, and the advice that follows from them."""

from dataclasses import replace

import pytest
import torch

from tests.operators.test_window_moments import BENCH, prior_of
from tmca.cameras import SpectralDepthCamera
from tmca.cameras.phase_codes import read_phase_codes, write_phase_codes
from tmca.design import MaskAdvice, MaskEffort, MaskTask, search_masks
from tmca.design.spectral_depth import confusion, drawn_error
from tmca.errors import SettingError, ShapeError
from tmca.operators.window_moments import needed_block
from tmca.optics import Stroke
from tmca.sensor import Sensor

CAMERA = {"bands": (450e-9, 600e-9), "planes": 3, "period": 2, "sensor": Sensor(read_noise=0.01)}
TASK = MaskTask(BENCH, CAMERA, window=4)
PRIOR = prior_of(needed_block(4, BENCH.window))


@pytest.fixture(scope="module")
def advice():
    return search_masks(TASK, PRIOR, [2], MaskEffort(2, 3))


def test_every_design_is_better_than_its_start_and_than_random_masks(advice):
    for own in advice.candidates:
        assert own.confusion < 0.95 * float(confusion(own.random_covariance))
        assert own.confusion < 0.99 * own.history[0]
        assert own.confusion == pytest.approx(min(own.history), rel=1e-4)
    assert [own.slots for own in advice.candidates] == [1, 2]


def test_slots_are_never_worse_than_the_static_mask_in_all_of_them(advice):
    repeated = TASK.camera_of(2, 0)
    heights = advice.static.camera.codes()[0].detach()
    with torch.no_grad():
        repeated.point_spread.heights.coefficients.copy_(
            advice.static.camera.point_spread.heights.coefficients.expand(2, -1)
        )
    torch.testing.assert_close(repeated.codes()[0], heights.expand(2, -1, -1))
    alike = float(confusion(TASK.covariance(repeated, PRIOR)))
    assert advice.candidates[1].confusion <= alike * (1 + 1e-6)


@pytest.fixture(scope="module")
def of_two_buckets():
    return search_masks(TASK, PRIOR, [2, 4], MaskEffort(1, 3), buckets=2)


def test_two_buckets_are_searched_beside_one_and_the_burst_with_the_same_effort(of_two_buckets):
    found, alone = of_two_buckets, search_masks(TASK, PRIOR, [2, 4], MaskEffort(1, 3))
    assert [(own.slots, own.buckets) for own in found.finals] == [(1, 1), (2, 1), (4, 1), (2, 2), (4, 2), (2, 2)]
    assert [own.confusion for own in found.candidates[:3]] == [own.confusion for own in alone.candidates]
    assert {len(own.history) for own in found.finals} == {3}
    assert all(own.confusion < float(confusion(own.random_covariance)) for own in found.finals)
    assert alone.burst is None
    assert search_masks(TASK, PRIOR, [1], MaskEffort(1, 1), buckets=2).finals[1:] == ()  # one mask fits


def test_two_slots_of_two_buckets_read_what_the_burst_reads(of_two_buckets):
    burst, two = of_two_buckets.burst, of_two_buckets.candidates[3]
    orders = [own.camera.tile()[1] for own in (burst, two)]
    assert not torch.equal(*orders)
    assert two.alike
    assert not of_two_buckets.candidates[4].alike
    assert two.confusion == pytest.approx(burst.confusion, rel=1e-9)  # of windows that are worked out for each
    scene, depth = torch.rand(1, 2, *two.camera.size), torch.full((1, 1, *two.camera.size), 0.8)
    read = [own.camera.exact(scene, depth).detach() for own in (burst, two)]
    torch.testing.assert_close(*(one.sort(1).values for one in read))


def test_searched_shutters_of_two_buckets_are_no_worse_than_the_burst():
    found = search_masks(replace(TASK, learn=("mask", "shutter")), PRIOR, [2], MaskEffort(1, 2), buckets=2)
    two = found.candidates[-1]
    assert two.confusion <= found.burst.confusion * (1 + 1e-9)
    assert two.start in ("masks of the burst", "near the masks of the burst")
    assert two.camera.shutter.learnable
    assert not found.burst.camera.shutter.learnable


def test_the_answer_may_be_a_static_mask(advice):
    static, more = advice.candidates
    assert not MaskAdvice((static, static)).multiplex
    assert not MaskAdvice((static,)).multiplex
    clear = replace(more, covariance=more.covariance * torch.tensor([1.0, 1e3, 1e6]).double()[:, None, None])
    told = MaskAdvice((static, clear))
    assert told.multiplex
    assert told.best is clear


def test_a_device_shows_only_its_stroke_and_levels():
    stroke = Stroke(-0.1e-6, 0.1e-6, levels=5)
    found = search_masks(replace(TASK, stroke=stroke), PRIOR, [1], MaskEffort(1, 2))
    steps = found.best.camera.codes()[0].detach() / 0.05e-6
    torch.testing.assert_close(steps, steps.round(), atol=1e-3, rtol=0)
    assert float(steps.abs().max()) <= 2 + 1e-3
    with pytest.raises(SettingError, match="stroke"):
        replace(TASK, stroke=stroke, rms=1e-6).camera_of(1, 0)


def test_shutter_and_filters_are_searched_too():
    task = replace(TASK, camera={**CAMERA, "filters": "gaussian"}, learn=("shutter", "filters"))
    found = search_masks(task, PRIOR, [2], MaskEffort(1, 15)).candidates[1]
    start, shutter = task.camera_of(2, 0), found.camera.tile()[1]
    assert set(shutter.unique().tolist()) <= {0.0, 1.0}
    assert not torch.equal(shutter, start.tile()[1])
    assert not torch.equal(found.camera.filters.cells(), start.filters.cells())


def test_the_drawn_error_is_that_of_windows_that_are_told_apart():
    same = torch.eye(4, dtype=torch.float64).expand(3, -1, -1)
    far = torch.stack([10.0**d * torch.eye(40, dtype=torch.float64) for d in (0, 3, 6)])
    assert drawn_error(same) == pytest.approx(1.0)  # all ties: the first of three planes
    assert drawn_error(far) == 0


def test_a_judge_chooses_among_descents_and_random_masks():
    drawn = {slots: TASK.camera_of(slots, 0).codes()[0].detach() for slots in (1, 2)}

    def likes_random(camera):
        return 5.0 * float((camera.codes()[0].detach() - drawn[camera.slots]).abs().max()) * 1e6 + camera.slots

    shares = []
    found = search_masks(TASK, PRIOR, [2], MaskEffort(2, 2), lambda share, _: shares.append(share), likes_random)
    judging = [share for share in shares if share > 0.5 + 0.7 / 2 + 1e-9]
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1)
    assert len(judging) == 4  # two descents, the static mask in all slots, random masks
    for own in found.candidates:
        assert own.start == "random, as drawn"
        assert own.errors == pytest.approx((own.slots, own.slots), abs=1e-6)
        assert own.confusion == pytest.approx(float(confusion(own.random_covariance)))
        assert own.expected == own.errors[0]
    assert not found.multiplex  # twice as wrong, says the judge


@pytest.mark.parametrize(
    ("made", "error"),
    [
        (lambda: replace(TASK, learn=()), SettingError), (lambda: replace(TASK, family="lens"), SettingError),
        (lambda: replace(TASK, window=0), SettingError), (lambda: MaskEffort(0, 1), SettingError),
        (lambda: replace(TASK, camera={**CAMERA, "planes": 2}), SettingError),
        (lambda: search_masks(TASK, PRIOR, [0]), SettingError),
        (lambda: search_masks(replace(TASK, learn=("shutter",)), PRIOR, [1], MaskEffort(1, 1)), SettingError),
        (lambda: search_masks(TASK, PRIOR, [2], MaskEffort(1, 1), buckets=3), SettingError),
        (lambda: search_masks(TASK.with_two_buckets(), PRIOR, [2], MaskEffort(1, 1), buckets=2), SettingError),
        (lambda: search_masks(TASK, prior_of((6, 6)), [1], MaskEffort(1, 1)), ShapeError),
    ],
)  # fmt: skip
def test_what_cannot_be_searched_is_refused(made, error):
    with pytest.raises(error):
        made()


@pytest.mark.parametrize("shutter", ["balanced", "burst"])
def test_masks_are_searched_for_two_buckets_that_lose_no_light(shutter, tmp_path):
    task = replace(TASK, camera={**TASK.camera, "buckets": 2}, shutter=shutter)
    static, two = search_masks(task, PRIOR, [2], MaskEffort(1, 3)).candidates
    assert two.confusion < float(confusion(two.random_covariance))
    assert static.camera.buckets == two.camera.buckets == 2
    file = write_phase_codes(two.camera, tmp_path / "codes.nc", "clear", "monochrome")
    again = SpectralDepthCamera(bands=CAMERA["bands"], size=(8, 8), **read_phase_codes(file))
    for own, read in zip(two.camera.tile(), again.tile(), strict=True):
        torch.testing.assert_close(own, read)
