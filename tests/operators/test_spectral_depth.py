"""Layered image formation against plain convolutions and brute force."""

import pytest
import torch
from scipy.signal import convolve2d

from tmca.errors import ShapeError
from tmca.operators.spectral_depth import (
    coded_exposure,
    composited,
    equivalent_psf,
    framed,
    layered,
    transfer_functions,
)

SLOTS, DEPTHS, BANDS, CHANNELS = 3, 4, 2, 2


def parts(size=(13, 16), psf=(5, 6)):
    spread = torch.rand(SLOTS, DEPTHS, BANDS, *psf, dtype=torch.float64)
    spread = spread / spread.sum((-2, -1), keepdim=True)
    scene, chosen = torch.rand(2, BANDS, *size, dtype=torch.float64), torch.randint(0, DEPTHS, (2, *size))
    weights = torch.nn.functional.one_hot(chosen, DEPTHS).permute(0, 3, 1, 2).double()
    return spread, scene, weights, framed(size, psf)


def same(image, kernel):
    """Plain convolution, dark around, the kernel's pixel (h//2, w//2) in its middle."""
    h, w = kernel.shape
    whole = convolve2d(image.numpy(), kernel.numpy())
    return torch.from_numpy(whole)[h // 2 : h // 2 + image.shape[0], w // 2 : w // 2 + image.shape[1]]


@pytest.mark.parametrize(("size", "psf"), [((13, 16), (5, 6)), ((12, 11), (6, 3)), ((9, 9), (9, 9))])
def test_layers_are_plain_convolutions(size, psf):
    spread, scene, weights, frame = parts(size, psf)
    found = layered(scene, weights, transfer_functions(spread, frame), frame)
    for b, k, band in ((0, 0, 0), (1, 2, 1)):
        slow = sum(same(scene[b, band] * weights[b, d], spread[k, d, band]) for d in range(DEPTHS))
        torch.testing.assert_close(found[b, k, band], slow)


def test_a_constant_depth_is_one_convolution_and_no_flipped_kernel():
    spread, scene, _, frame = parts()
    weights = torch.zeros(2, DEPTHS, 13, 16, dtype=torch.float64)
    weights[:, 2] = 1
    transfer = transfer_functions(spread, frame)
    for model in (layered, composited):
        found = model(scene, weights, transfer, frame)
        expected = same(scene[0, 1], spread[1, 2, 1])
        if model is composited:  # it divides by the blurred frame: the dark around is no part of the layer
            expected = expected / same(torch.ones(13, 16, dtype=torch.float64), spread[1, 2, 1])
        torch.testing.assert_close(found[0, 1, 1], expected)


def test_brute_force_with_the_equivalent_psf_is_the_fast_path():
    """Eq. (34): every point of the scene adds its own spatially variant P̃."""
    size, psf = (9, 10), (5, 4)
    spread, scene, weights, frame = parts(size, psf)
    colour, shutter = torch.rand(CHANNELS, BANDS, *size).double(), (torch.rand(SLOTS, *size) > 0.5).double()
    fast = coded_exposure(layered(scene, weights, transfer_functions(spread, frame), frame), colour, shutter[None])
    slow = torch.zeros(CHANNELS, size[0] + 2 * psf[0], size[1] + 2 * psf[1], dtype=torch.float64)
    for i in range(size[0]):
        for j in range(size[1]):
            own = equivalent_psf(spread, colour, shutter, (i, j), int(weights[0, :, i, j].argmax()))
            top, left = i - psf[0] // 2 + psf[0], j - psf[1] // 2 + psf[1]
            slow[:, top : top + psf[0], left : left + psf[1]] += torch.einsum("clhw,l->chw", own, scene[0, :, i, j])
    torch.testing.assert_close(fast[0], slow[:, psf[0] : -psf[0], psf[1] : -psf[1]], atol=1e-10, rtol=1e-10)


def test_a_scene_may_change_from_slot_to_slot():
    spread, scene, weights, frame = parts()
    transfer = transfer_functions(spread, frame)
    moving = torch.stack([scene * (k + 1) for k in range(SLOTS)], 1)
    found, still = layered(moving, weights, transfer, frame), layered(scene, weights, transfer, frame)
    torch.testing.assert_close(found, still * torch.arange(1, SLOTS + 1).double()[None, :, None, None, None])


def test_near_layers_hide_far_ones():
    """Light of a far layer does not pass a near one: behind a wide opaque plane nothing of it is left."""
    size, psf = (24, 24), (7, 7)
    spread = torch.zeros(1, 2, 1, *psf, dtype=torch.float64)
    spread[0, 0, 0], spread[0, 1, 0, 3, 3] = 1 / 49, 1.0  # the far plane is blurred, the near one sharp
    weights = torch.zeros(1, 2, *size, dtype=torch.float64)
    weights[:, 1, :, :12], weights[:, 0, :, 12:] = 1, 1
    scene = weights[:, :1].clone()  # the far plane shines, the near one is black
    frame = framed(size, psf)
    transfer = transfer_functions(spread, frame)
    linear, hidden = layered(scene, weights, transfer, frame), composited(scene, weights, transfer, frame)
    assert float(linear[..., 5:-5, 10].min()) > 0.1
    assert float(hidden[..., :12].abs().max()) < 1e-9
    torch.testing.assert_close(hidden[..., 5:-5, 12:], torch.ones(1, 1, 1, 14, 12, dtype=torch.float64))


def test_periodic_scenes_go_round():
    spread, scene, weights, _ = parts((16, 16), (5, 5))
    found = layered(scene, weights, transfer_functions(spread, (16, 16)), (16, 16))
    rolled = layered(scene.roll(3, -1), weights.roll(3, -1), transfer_functions(spread, (16, 16)), (16, 16))
    torch.testing.assert_close(rolled, found.roll(3, -1))


def test_gradients_reach_scene_weights_and_psfs():
    spread, scene, weights, frame = parts((2, 3), (2, 2))
    inputs = [part.clone().requires_grad_() for part in (scene[:1], weights[:1], spread)]
    for model in (layered, composited):
        assert torch.autograd.gradcheck(
            lambda s, w, p, model=model: model(s, w, transfer_functions(p, frame), frame), inputs
        )


@pytest.mark.parametrize("model", [layered, composited])
def test_empty_layers_change_nothing(model):
    spread, scene, weights, frame = parts()
    weights[:, 2] += weights[:, 1]
    weights[:, 1] = weights[:, 3] = 0
    transfer = transfer_functions(spread, frame)
    skipped = model(scene, weights[:, [0, 2]], transfer[:, [0, 2]], frame)
    torch.testing.assert_close(model(scene, weights, transfer, frame), skipped)
    whole = model(scene, weights.clone().requires_grad_(), transfer, frame).detach()
    torch.testing.assert_close(whole, skipped)
    assert not model(scene, torch.zeros_like(weights), transfer, frame).any()


def imaged(spread, scene, weights, frame, first=0):
    return layered(scene, weights, transfer_functions(spread, frame)[..., first:], frame)


@pytest.mark.parametrize(
    ("call", "where"),
    [
        (lambda spread, scene, weights, frame: transfer_functions(spread, (4, 16)), "psf"),
        (lambda spread, scene, weights, frame: equivalent_psf(spread, scene, scene[0], (13, 0), 0), "pixel"),
        (lambda spread, scene, weights, frame: imaged(spread, scene[:, :1], weights, frame), "scene"),
        (lambda spread, scene, weights, frame: imaged(spread, scene, weights[:, :1], frame), "weights"),
        (lambda *given: imaged(*given, first=1), "transfer functions"),
    ],
)
def test_what_does_not_fit_is_refused(call, where):
    with pytest.raises(ShapeError) as caught:
        call(*parts())
    assert caught.value.where == where
