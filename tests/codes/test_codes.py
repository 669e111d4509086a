"""What the devices show: zeros and ones, of the family that was asked for; balanced choices."""

import numpy as np
import pytest
import torch

from tmca.cameras import SpectralDepthCamera
from tmca.codes import (
    FAMILIES,
    CodePlane,
    Codes,
    balanced_choice,
    hard_threshold,
    one_hot_planes,
    one_hot_slots,
    pattern,
)
from tmca.errors import SettingError, ShapeError

DRAWN = torch.rand(1, 4, 4, generator=torch.Generator().manual_seed(0)).round()


@pytest.mark.parametrize("family", sorted(FAMILIES))
@pytest.mark.parametrize("slots", [1, 4, 5])
@pytest.mark.parametrize("period", [None, (7, 6)])
@pytest.mark.parametrize("learnable", [False, True])
def test_every_family_is_binary_and_of_the_size_asked(family, slots, period, learnable):
    plane = CodePlane(family, slots, (19, 24), period=period, seed=3, learnable=learnable)
    values = plane()
    assert values.shape == (slots, 19, 24)
    assert set(values.unique().tolist()) <= {0.0, 1.0}
    if period:
        assert torch.equal(values[:, :12], values[:, 7:])
        assert torch.equal(values[..., :18], values[..., 6:])


def test_families_are_what_their_names_say():
    size = (40, 41)
    assert pattern("open", 3, size).eq(1).all()
    static = pattern("static", 3, size)
    assert torch.equal(static[0], static[2])
    assert 0 < static.mean() < 1
    assert pattern("one-hot", 4, size).sum(0).eq(1).all()
    pairs = pattern("complementary", 4, size)
    assert (pairs[0] + pairs[1]).eq(1).all()
    assert not torch.equal(pairs[0], pairs[2])
    assert abs(pattern("random", 8, (100, 100), density=0.3).mean() - 0.3) < 0.01


def test_learned_families_keep_their_structure_when_the_logits_move():
    torch.manual_seed(0)
    for family, holds in (
        ("one-hot", lambda v: v.sum(0).eq(1).all()),
        ("static", lambda v: v.eq(v[:1]).all()),
        ("complementary", lambda v: (v[0] + v[1]).eq(1).all()),
    ):
        plane = CodePlane(family, 4, (9, 8), learnable=True)
        before = plane().detach().clone()
        with torch.no_grad():
            plane.latent.copy_(torch.randn_like(plane.latent))
        assert holds(plane())
        assert not torch.equal(plane(), before)


def test_same_seed_same_codes_and_planes_draw_from_different_streams():
    a, b = (Codes(seed=5).planes(4, (20, 20), (20, 20))() for _ in range(2))
    assert torch.equal(a[0], b[0])
    assert not torch.equal(a[0], a[1])
    assert not torch.equal(a[0], Codes(seed=6).planes(4, (20, 20), (20, 20))()[0])


@pytest.mark.parametrize("density", [0.25, 0.5])
def test_blue_noise_has_less_energy_at_low_frequency_than_white_noise(density):
    size = 96
    radius = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.fftfreq(size)[None])
    low = (radius > 0) & (radius < 0.12)

    def low_energy(values):
        centred = values - values.mean()
        return (np.abs(np.fft.fft2(centred)) ** 2)[low].mean() / centred.size / centred.var()

    blue = pattern("blue-noise", 1, (size, size), density)[0].numpy()
    white = pattern("random", 1, (size, size), density)[0].numpy()
    assert abs(blue.mean() - density) < 0.02
    assert low_energy(blue) < 0.1 * low_energy(white)


def test_threshold_has_the_derivative_of_the_sigmoid():
    logits = torch.linspace(-2, 2, 41, dtype=torch.float64, requires_grad=True)
    weight = torch.randn(41, dtype=torch.float64)
    (hard_threshold(logits, 3.0) * weight).sum().backward()
    smooth = logits.detach().clone().requires_grad_()
    (torch.sigmoid(3.0 * smooth) * weight).sum().backward()
    assert torch.allclose(logits.grad, smooth.grad)
    steep = torch.tensor([0.01], requires_grad=True)
    hard_threshold(steep, 40.0).backward()
    assert steep.grad > 5


def test_one_hot_has_the_derivative_of_the_softmax():
    logits = torch.randn(5, 3, 4, dtype=torch.float64, requires_grad=True)
    weight = torch.randn(5, 3, 4, dtype=torch.float64)
    (one_hot_slots(logits, 2.0) * weight).sum().backward()
    smooth = logits.detach().clone().requires_grad_()
    (torch.softmax(2 * smooth, 0) * weight).sum().backward()
    assert torch.allclose(logits.grad, smooth.grad)


def test_own_patterns_binary_or_measured():
    mine = torch.randint(2, (3, 6, 7)).float()
    assert torch.equal(CodePlane(mine, 3, (6, 7))(), mine)
    assert torch.equal(CodePlane(mine, 3, (6, 7), learnable=True)(), mine)
    grey = torch.rand(6, 7)
    assert torch.equal(CodePlane(grey, 2, (6, 7))(), grey.expand(2, -1, -1))
    tiled = torch.randint(2, (3, 4, 5)).float()
    full = tiled.repeat(1, 2, 2)[:, :6, :7]
    assert torch.equal(CodePlane(full, 3, (6, 7), period=(4, 5))(), full)


@pytest.mark.parametrize(
    ("given", "settings", "error"),
    [
        (("radnom", 2), {}, SettingError), (("random", 0), {}, SettingError),
        (("random", 2), {"density": 1.5}, SettingError), (("random", 2), {"period": 0}, SettingError),
        ((torch.rand(2, 4, 4), 2), {"learnable": True}, SettingError), ((2 * torch.ones(2, 4, 4), 2), {}, SettingError),
        ((torch.full((2, 4, 4), torch.nan), 2), {}, SettingError), ((DRAWN, 1), {"period": 3}, SettingError),
        ((torch.ones(3, 5, 4), 3), {}, ShapeError), ((torch.ones(2, 4, 4), 3), {}, ShapeError),
    ],
)  # fmt: skip
def test_impossible_codes_are_refused_in_one_line(given, settings, error):
    with pytest.raises(error) as caught:
        CodePlane(*given, (4, 4), **settings)
    assert "\n" not in str(caught.value)


def test_a_burst_is_among_the_shutters_that_there_are():
    with pytest.raises(SettingError, match=r"^shutter: found 'foo', expected one of .*, burst$"):
        Codes(shutter="foo").planes(2, (4, 4), (4, 4))


@pytest.mark.parametrize(("count", "size"), [(4, (4, 4)), (3, (5, 4)), (5, (3, 3)), (1, (2, 3))])
def test_every_choice_is_made_as_often(count, size):
    found = balanced_choice(count, size, 3)
    often = torch.bincount(found.flatten(), minlength=count)
    assert int(often.max() - often.min()) <= 1
    assert torch.equal(found, balanced_choice(count, size, 3))
    planes = one_hot_planes(found, count)
    assert torch.equal(planes.sum(0), torch.ones(size))
    assert torch.equal(planes.argmax(0), found)


def test_seeds_differ_and_nothing_to_choose_is_refused():
    assert not torch.equal(balanced_choice(4, (6, 6), 0), balanced_choice(4, (6, 6), 1))
    with pytest.raises(SettingError, match="choices"):
        balanced_choice(0, (2, 2))


@pytest.mark.parametrize("seed", range(4))
def test_small_tiles_of_shutter_and_filters_leave_no_slot_and_no_filter_out(seed):
    made = SpectralDepthCamera.from_preset("quick", size=(32, 32), shutter="one-hot", seed=seed)
    torch.testing.assert_close(made.shutter().mean((1, 2)), torch.full((4,), 0.25))
    assert torch.bincount(made.filters.cells().flatten(), minlength=4).tolist() == [4] * 4
