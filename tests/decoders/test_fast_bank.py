"""A smaller bank says of frames what the whole one says, but for a little."""

from dataclasses import replace

import pytest
import torch

from tests.small_scenes import smooth_scene
from tmca.cameras import LightFieldCamera, Snapshot, SpectralCamera
from tmca.decoders import decode, make_decoder
from tmca.decoders.fast_bank import LEFT_OUT, _core, computable, halved, rounded, smaller
from tmca.decoders.lmmse import PatchEstimator
from tmca.errors import DataError
from tmca.operators.taps import TapOperator
from tmca.priors import GaussianPrior
from tmca.sensor import Sensor

SENSOR = Sensor(read_noise=0.03)
TAKEN = {
    "spectral": SpectralCamera(3, (37, 60), slots=4, shutter="random", period=(4, 6), sensor=SENSOR),
    "two buckets": SpectralCamera(3, (36, 61), slots=4, shutter="balanced", buckets=2, period=(4, 6), sensor=SENSOR),
    "light field": LightFieldCamera(3, (37, 40), slots=2, shutter="random", period=6, sensor=SENSOR),
}


def prepared(name):
    """An estimator with the whole bank, the frames that it decodes, and the snapshot that its prior expects."""
    camera = TAKEN[name]
    taps = camera.taps()
    channels = taps.scene_shape[0]
    prior = GaussianPrior.learn([smooth_scene(60, 90, channels, seed=1)], (8, 20))
    scenes = smooth_scene(*camera.size, channels, seed=2).float()[None]
    frames = camera(scenes.reshape(1, *camera.scene_shape), generator=0)
    estimator = PatchEstimator(prior, taps, camera.noise).precompute()
    mean = prior.mean[:, 0, 0].float()[None, :, None, None].expand(1, *taps.scene_shape)
    return estimator, frames, TapOperator(taps).A(mean), scenes


@pytest.mark.parametrize("name", TAKEN)
def test_frames_are_nearly_those_of_the_whole_bank(name):
    estimator, frames, expected, scenes = prepared(name)
    whole, less = estimator.bank, smaller(estimator.bank, expected)
    torch.testing.assert_close(less.estimate(expected), whole.estimate(expected), rtol=0, atol=1e-5)
    assert torch.equal(less.deviation, whole.deviation)
    assert sum(cell.matrix.numel() for cell in less.cells) < 0.9 * sum(cell.matrix.numel() for cell in whole.cells)
    errors = [float((bank.estimate(frames) - scenes).square().mean()) for bank in (whole, less)]
    assert 0 < abs(errors[1] - errors[0]) < 0.05 * errors[0]


@pytest.mark.parametrize("name", TAKEN)
def test_no_more_is_left_out_than_is_allowed(name):
    estimator, _, expected, _ = prepared(name)
    whole, less = estimator.bank, smaller(estimator.bank, expected)
    squares = [sum(float(c.matrix.square().sum()) * len(c.pixels) for c in bank.cells) for bank in (whole, less)]
    assert 0 < squares[0] - squares[1] <= LEFT_OUT * float(whole.deviation.square().sum())


@pytest.mark.parametrize("name", TAKEN)
def test_half_precision_rounds_as_much_as_is_predicted(name):
    estimator, frames, expected, _ = prepared(name)
    whole, half = estimator.bank, halved(estimator.bank, expected)
    assert {cell.matrix.dtype for cell in half.cells} == {torch.bfloat16}
    torch.testing.assert_close(half.estimate(expected), whole.estimate(expected), rtol=0, atol=1e-5)
    half = replace(half, offset=whole.offset)  # which makes up for what the expected snapshot loses
    actual = float((half.estimate(frames) - whole.estimate(frames)).square().sum())
    assert 0.7 < actual / rounded(whole, frames) < 1.4


def test_half_precision_is_left_out_where_it_would_matter():
    camera, prior = TAKEN["spectral"], GaussianPrior.learn([smooth_scene(60, 90, seed=1)], (8, 20))
    noises = camera.noise, camera.replace(sensor=Sensor(read_noise=0.0005)).noise
    taken = [PatchEstimator(prior, camera.taps(), noise).precompute() for noise in noises]
    expected = torch.full((1, *camera.snapshot_shape), 1.5)
    loud, quiet = (halved(one.bank, expected) for one in taken)
    assert loud is not taken[0].bank
    assert quiet is taken[1].bank


@pytest.mark.parametrize("computes", [True, False])
def test_the_processor_decides_whether_half_precision_is_used(tmp_path, monkeypatch, computes):
    camera, path = TAKEN["spectral"], tmp_path / "b.safetensors"
    prior = GaussianPrior.learn([smooth_scene(60, 90, seed=1)], (8, 20))
    decoder = make_decoder("lmmse", "spectral", {"fast": True})

    def types(bank=None):
        cells = decoder.prepare(camera, prior, bank=bank).state.bank.cells
        return {cell.matrix.dtype for cell in cells}

    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"avx512_bf16": computes})
    chosen, other = (torch.bfloat16, torch.float32) if computes else (torch.float32, torch.bfloat16)
    assert types() == types(path) == types(path) == {chosen}
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"avx512_bf16": not computes})
    assert types(path) == {other}  # a file of another machine


def test_half_precision_of_another_machine_says_the_same(monkeypatch):
    estimator, frames, expected, _ = prepared("spectral")
    half = halved(estimator.bank, expected)
    monkeypatch.setattr(torch.cpu, "get_capabilities", dict)
    here = computable(half, expected)
    assert {cell.matrix.dtype for cell in here.cells} == {torch.float32}
    torch.testing.assert_close(here.estimate(frames), half.estimate(frames), rtol=0, atol=0.02)


@pytest.mark.parametrize("share", [0.0, 0.05, 0.3, 1.0])
def test_the_core_of_a_table_is_what_is_left_without_its_weakest_edges(share):
    table = torch.outer(torch.tensor([0.0, 0.1, 1, 3, 2, 0.2]), torch.tensor([0.01, 1, 4, 5, 0.5, 0.0, 0.0]))
    top, bottom, left, right = _core(table, share)
    left_out = float(table.sum() - table[top:bottom, left:right].sum())
    assert 0 <= left_out <= share * float(table.sum()) + 1e-6
    assert (top, bottom, left, right)[0] >= 1  # what is zero goes for nothing
    assert right <= 5
    assert bottom > top
    assert right > left


def test_of_a_shutter_that_is_never_open_nothing_is_left_out():
    camera = TAKEN["spectral"].replace(shutter=torch.zeros(4, 4, 6))
    prior = GaussianPrior.learn([smooth_scene(60, 90, seed=1)], (8, 20))
    fast = make_decoder("lmmse", "spectral", {"fast": True}).prepare(camera, prior)
    assert bool(fast(torch.zeros(1, *camera.snapshot_shape)).values.isfinite().all())


def test_it_is_a_setting_of_the_decoder_whose_bank_is_its_own(tmp_path):
    camera, path = TAKEN["spectral"], tmp_path / "b.safetensors"
    prior = GaussianPrior.learn([smooth_scene(60, 90, seed=1)], (8, 20))
    snapshot = Snapshot(camera(smooth_scene(*camera.size, seed=2).float()[None], generator=0), camera)
    fast = make_decoder("lmmse", "spectral", {"fast": True}).prepare(camera, prior, bank=path)
    again = make_decoder("lmmse", "spectral", {"fast": True}).prepare(camera, prior, bank=path)
    assert torch.equal(fast(snapshot).values, again(snapshot).values)
    alone = decode(snapshot, "lmmse", prior=prior)
    assert 0 < float((fast(snapshot).values - alone.values).abs().max()) < 0.05
    with pytest.raises(DataError, match="prior or setting"):
        make_decoder("lmmse", "spectral").prepare(camera, prior, bank=path)
    one_frame = decode(snapshot, "lmmse", prior=prior, fast=True)  # nothing is prepared
    assert torch.equal(one_frame.values, alone.values)
