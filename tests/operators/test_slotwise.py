"""Slot by slot: the same camera when nothing blurs or moves, and the right one when something does."""

import numpy as np
import pytest
import torch
from scipy.signal import convolve2d

from tests.operators.references import DISPERSIONS, SIZES, planes, single_disperser_by_loops
from tmca.errors import ShapeError
from tmca.operators import SlotwiseDisperser, single_disperser
from tmca.optics import Dispersion, gaussian_spread

KAPPA = torch.tensor([1.0, 0.5, 0.8, 0.3], dtype=torch.float64)


@pytest.mark.parametrize("name", DISPERSIONS)
def test_without_blur_it_is_the_collapsed_camera(name):
    dispersion = Dispersion(DISPERSIONS[name])
    near, wide = planes(3, (5, 8), dispersion.spread)
    scene = torch.rand(2, 4, 5, 8, dtype=torch.float64)
    slotwise = SlotwiseDisperser(near, wide, dispersion, KAPPA)
    collapsed = single_disperser(near, wide, dispersion, KAPPA)
    assert torch.allclose(slotwise.A(scene), collapsed.A(scene))


def test_a_moving_scene_is_the_sum_of_its_slots():
    dispersion = Dispersion(DISPERSIONS["fractional"])
    near, wide = planes(3, (5, 8), dispersion.spread)
    scene = torch.rand(2, 3, 4, 5, 8, dtype=torch.float64)
    operator = SlotwiseDisperser(near, wide, dispersion, KAPPA, moving=True)
    truth = sum(
        single_disperser_by_loops(
            scene[:, k].numpy(),
            near[k : k + 1].numpy(),
            wide[k : k + 1].numpy(),
            DISPERSIONS["fractional"],
            KAPPA.numpy(),
            1 / 3,
        )
        for k in range(3)
    )
    np.testing.assert_allclose(operator.A(scene).numpy(), truth)
    still = scene[:, :1].expand(-1, 3, -1, -1, -1)
    assert torch.allclose(operator.A(still), SlotwiseDisperser(near, wide, dispersion, KAPPA).A(scene[:, 0]))


def test_relay_blur_is_a_convolution_between_mask_and_prism():
    """Eq. (18) with an asymmetric point spread: convolution, not correlation."""
    dispersion = Dispersion.linear(4)
    near, wide = planes(2, (6, 9), 3)
    blur = torch.rand(4, 3, 5, dtype=torch.float64)
    scene = torch.rand(1, 4, 6, 9, dtype=torch.float64)
    snapshot = SlotwiseDisperser(near, wide, dispersion, KAPPA, blur=blur).A(scene)
    truth = np.zeros((6, 12))
    for k in range(2):
        for l in range(4):
            light = convolve2d((near[k] * scene[0, l]).numpy(), blur[l].numpy(), mode="same")
            truth[:, l : l + 9] += 0.5 * KAPPA[l].item() * wide[k, :, l : l + 9].numpy() * light
    np.testing.assert_allclose(snapshot[0, 0].numpy(), truth)


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float32, 1e-5), (torch.float64, 1e-12)])
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("blurred", [False, True])
def test_adjoint_is_the_transpose(size, moving, blurred, dtype, tolerance):
    dispersion = Dispersion(DISPERSIONS["fractional backwards"])
    near, wide = planes(3, size, dispersion.spread, dtype)
    blur = torch.rand(4, 3, 5, dtype=dtype) if blurred else None
    operator = SlotwiseDisperser(near, wide, dispersion, KAPPA.to(dtype), blur=blur, moving=moving)
    x = torch.randn(2, *operator.scene_shape, dtype=dtype)
    y = torch.randn(2, *operator.snapshot_shape, dtype=dtype)
    left, right = (operator.A(x) * y).sum(), (x * operator.A_adjoint(y)).sum()
    assert abs(left - right) <= tolerance * operator.A(x).norm() * y.norm()


def test_dagger_explains_a_blurred_snapshot():
    dispersion = Dispersion.linear(4)
    near, wide = planes(3, (8, 9), 3)
    blur = gaussian_spread(0.6, 4).double()
    operator = SlotwiseDisperser(near, wide, dispersion, KAPPA, blur=blur)
    snapshot = operator.A(torch.rand(2, 4, 8, 9, dtype=torch.float64))
    assert (operator.A(operator.A_dagger(snapshot)) - snapshot).abs().max() < 1e-6


def test_gaussian_spread_has_unit_energy_and_the_width_asked():
    spread = gaussian_spread([0.0, 1.5], 2, radius=8).double()
    assert torch.allclose(spread.sum((1, 2)), torch.ones(2, dtype=torch.float64), atol=1e-6)
    assert spread[0, 8, 8] == 1
    axis = torch.arange(-8, 9, dtype=torch.float64)
    assert ((spread[1].sum(0) * axis**2).sum() ** 0.5).item() == pytest.approx(1.5, rel=1e-3)


def test_a_blur_of_even_size_is_refused():
    with pytest.raises(ShapeError, match="odd"):
        SlotwiseDisperser(torch.ones(1, 4, 4), torch.ones(1, 4, 7), Dispersion.linear(4), blur=torch.ones(4, 2, 3))
