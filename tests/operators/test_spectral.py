"""Dispersers, collapsed and slot by slot, against slow loops, their matrix and their pseudo-inverse."""

import numpy as np
import pytest
import torch
from scipy.signal import convolve2d

from tmca.errors import SettingError, ShapeError
from tmca.operators import (
    SlotwiseDisperser,
    TapOperator,
    coloured_code,
    conditioning,
    dual_disperser,
    single_disperser,
    sparse_matrix,
)
from tmca.optics import Dispersion

DISPERSIONS = {
    "one pixel per band": (0.0, 1.0, 2.0, 3.0),
    "two pixels per band": (0.0, 2.0, 4.0, 6.0),
    "backwards": (0.0, -1.0, -2.0, -3.0),
    "not monotone": (2.0, -1.0, 0.0, 2.0),
    "away from the origin": (3.0, 4.0, 6.0, 5.0),
    "fractional": (0.0, 0.7, 1.4, 2.1),
    "fractional backwards": (0.25, -0.5, -1.9, 0.0),
    "none": (0.0, 0.0, 0.0, 0.0),
}
SIZES = [(5, 7), (6, 8), (1, 9), (4, 1)]


def planes(slots, size, wide, dtype=torch.float64, seed=0):
    generator = torch.Generator().manual_seed(seed)
    near = (torch.rand(slots, *size, generator=generator) < 0.5).to(dtype)
    far = (torch.rand(slots, size[0], size[1] + wide, generator=generator) < 0.5).to(dtype)
    return near, far


def single_disperser_by_loops(scene, aperture, shutter, displacement, response, slot_weight):
    """Thesis eqs (4), (18): light falls on the two nearest sensor columns, each with its own shutter."""
    batch, bands, rows, columns = scene.shape
    origin = int(np.floor(min(displacement)))
    snapshot = np.zeros((batch, 1, rows, columns + int(np.ceil(max(displacement))) - origin))
    for k in range(aperture.shape[0]):
        for l in range(bands):
            for m in range(rows):
                for j in range(columns):
                    light = response[l] * aperture[k, m, j] * scene[:, l, m, j] * slot_weight
                    left = int(np.floor(displacement[l]))
                    part = displacement[l] - left
                    n = j + left - origin
                    snapshot[:, 0, m, n] += (1 - part) * shutter[k, m, n] * light
                    if part > 0:
                        snapshot[:, 0, m, n + 1] += part * shutter[k, m, n + 1] * light
    return snapshot


def dual_disperser_by_loops(scene, aperture, shutter, displacement, response, slot_weight):
    """Errata: e_{m,n} = Σ_k S^k_{m,n} Σ_ℓ κ_ℓ T^k_{m,n-d_ℓ} f_{m,n,ℓ}, the mask read between its pixels linearly."""
    batch, bands, rows, columns = scene.shape
    start = int(np.floor(min(-np.array(displacement))))
    snapshot = np.zeros((batch, 1, rows, columns))
    for k in range(aperture.shape[0]):
        for l in range(bands):
            for m in range(rows):
                for n in range(columns):
                    place = n - displacement[l] - start
                    left, part = int(np.floor(place)), place - np.floor(place)
                    mask = (1 - part) * aperture[k, m, left] + (part * aperture[k, m, left + 1] if part > 0 else 0)
                    snapshot[:, 0, m, n] += slot_weight * shutter[k, m, n] * response[l] * mask * scene[:, l, m, n]
    return snapshot


KAPPA = torch.tensor([1.0, 0.5, 0.8, 0.3], dtype=torch.float64)
BUILDERS = {
    "single": (single_disperser, single_disperser_by_loops),
    "dual": (lambda near, wide, *rest: dual_disperser(wide, near, *rest), dual_disperser_by_loops),
}


def build(kind, displacement, size, slots=3, dtype=torch.float64, exposure="equal", seed=0):
    dispersion = Dispersion(displacement)
    near, wide = planes(slots, size, dispersion.extent, dtype, seed)
    operator = BUILDERS[kind][0](near, wide, dispersion, KAPPA.to(dtype), exposure)
    return operator, near, wide


@pytest.mark.parametrize("exposure", ["equal", "per-slot"])
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", DISPERSIONS)
@pytest.mark.parametrize("kind", BUILDERS)
def test_dispersers_equal_the_loops_of_thesis_and_errata(kind, name, size, exposure):
    operator, near, wide = build(kind, DISPERSIONS[name], size, exposure=exposure)
    scene = torch.rand(2, *operator.scene_shape, dtype=torch.float64)
    aperture, shutter = (near, wide) if kind == "single" else (wide, near)
    weight = 1 / 3 if exposure == "equal" else 1.0
    given = (part.numpy() for part in (scene, aperture, shutter))
    truth = BUILDERS[kind][1](*given, DISPERSIONS[name], KAPPA.numpy(), weight)
    assert truth.shape == (2, *operator.snapshot_shape)
    np.testing.assert_allclose(operator.A(scene).numpy(), truth, atol=1e-12)


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float32, 2e-5), (torch.float64, 1e-9)])
@pytest.mark.parametrize("name", DISPERSIONS)
@pytest.mark.parametrize("kind", BUILDERS)
def test_dagger_explains_every_snapshot_in_the_range(kind, name, dtype, tolerance):
    operator, *_ = build(kind, DISPERSIONS[name], (7, 31), dtype=dtype)
    snapshot = operator.A(torch.rand(2, *operator.scene_shape, dtype=dtype))
    assert (operator.A(operator.A_dagger(snapshot)) - snapshot).abs().max() < tolerance


def test_a_lone_fractional_band_is_singular_and_still_inverted():
    code = torch.ones(1, 3, 10, dtype=torch.float64)
    operator = coloured_code(code, Dispersion((0.5,)))
    scene = torch.rand(1, 1, 3, 10, dtype=torch.float64)
    assert (operator.A_dagger(operator.A(scene)) - scene).abs().max() < 1e-6


def test_closed_pixels_give_zero():
    operator = coloured_code(torch.zeros(2, 4, 5), Dispersion((0.0, 1.0)))
    assert operator.A_dagger(torch.ones(1, 1, 4, 6)).eq(0).all()


@pytest.mark.parametrize("name", DISPERSIONS)
@pytest.mark.parametrize("kind", BUILDERS)
def test_every_sensor_pixel_may_have_a_noise_variance_of_its_own(kind, name):
    operator, *_ = build(kind, DISPERSIONS[name], (3, 6))
    matrix = sparse_matrix(operator).toarray()
    snapshot = torch.randn(2, *operator.snapshot_shape, dtype=torch.float64)
    variance = 0.01 + torch.rand(2, *operator.snapshot_shape, dtype=torch.float64)
    pairs = zip(snapshot.reshape(2, -1).numpy(), variance.reshape(2, -1).numpy(), strict=True)
    truth = [np.linalg.solve(matrix @ matrix.T + np.diag(r), y) for y, r in pairs]
    np.testing.assert_allclose(operator.gram_solve(snapshot, variance).reshape(2, -1).numpy(), truth, atol=1e-10)


@pytest.mark.parametrize("name", DISPERSIONS)
@pytest.mark.parametrize("kind", BUILDERS)
def test_a_window_is_the_camera_of_a_scene_that_is_dark_around_it(kind, name):
    operator, *_ = build(kind, DISPERSIONS[name], (7, 9))
    top, left, height, width = 2, 3, 4, 5
    part = TapOperator(operator.taps.window(top, left, height, width))
    scene = torch.zeros(1, *operator.scene_shape, dtype=operator.code.dtype)
    inside = torch.rand(1, operator.scene_shape[0], height, width, dtype=operator.code.dtype)
    scene[:, :, top : top + height, left : left + width] = inside
    whole = operator.A(scene)[:, :, top : top + height, left : left + part.snapshot_shape[2]]
    torch.testing.assert_close(part.A(inside), whole)


@pytest.mark.parametrize("name", ["one pixel per band", "fractional", "not monotone"])
@pytest.mark.parametrize("kind", BUILDERS)
def test_gradients_to_scene_codes_and_response(kind, name):
    dispersion = Dispersion(DISPERSIONS[name])
    near, wide = (
        p.requires_grad_() for p in (torch.rand(2, 1, 3).double(), torch.rand(2, 1, 3 + dispersion.extent).double())
    )
    scene = torch.rand(2, 4, 1, 3, dtype=torch.float64, requires_grad=True)
    kappa = KAPPA.clone().requires_grad_()

    def snapshot(scene, near, wide, kappa):
        return BUILDERS[kind][0](near, wide, dispersion, kappa).A(scene)

    def estimate(scene, near, wide, kappa):
        operator = BUILDERS[kind][0](near, wide, dispersion, kappa)
        return operator.A_adjoint(operator.A(scene))

    assert torch.autograd.gradcheck(snapshot, (scene, near, wide, kappa))
    assert torch.autograd.gradcheck(estimate, (scene, near, wide, kappa))
    assert torch.autograd.gradgradcheck(snapshot, (scene, near, wide, kappa))


def test_rank_condition_and_coherence_of_known_matrices():
    report = conditioning(np.array([[3.0, 0, 3.0, 0], [0, 1.0, 0, 0]]))
    assert report.rank == 2
    assert report.condition == pytest.approx(3 * np.sqrt(2))
    assert report.coherence == pytest.approx(1.0)
    assert report.dark_columns == 1


@pytest.mark.parametrize("name", DISPERSIONS)
def test_without_blur_it_is_the_collapsed_camera(name):
    dispersion = Dispersion(DISPERSIONS[name])
    near, wide = planes(3, (5, 8), dispersion.extent)
    scene = torch.rand(2, 4, 5, 8, dtype=torch.float64)
    slotwise = SlotwiseDisperser(near, wide, dispersion, KAPPA)
    collapsed = single_disperser(near, wide, dispersion, KAPPA)
    assert torch.allclose(slotwise.A(scene), collapsed.A(scene))


def test_a_moving_scene_is_the_sum_of_its_slots():
    dispersion = Dispersion(DISPERSIONS["fractional"])
    near, wide = planes(3, (5, 8), dispersion.extent)
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


LINEAR = Dispersion.linear(4)
FITTING = (torch.ones(2, 5, 7), torch.ones(2, 5, 10), LINEAR)


@pytest.mark.parametrize(
    ("call", "error", "where"),
    [
        (lambda: single_disperser(torch.ones(2, 5, 7), torch.ones(2, 5, 7), LINEAR), ShapeError, "shutter"),
        (lambda: single_disperser(*FITTING).A(torch.ones(1, 3, 5, 7)), ShapeError, "scene"),
        (lambda: single_disperser(*FITTING).A(torch.ones(4, 5, 7)), ShapeError, "scene"),
        (lambda: single_disperser(*FITTING, exposure="mean"), SettingError, "exposure"),
        (lambda: Dispersion.of((1.0, 2.0), 4), SettingError, "dispersion"),
        (lambda: sparse_matrix(coloured_code(torch.ones(4, 80, 80), LINEAR)), SettingError, "explicit matrix"),
        (lambda: SlotwiseDisperser(*FITTING, blur=torch.ones(4, 2, 3)), ShapeError, "relay blur"),
        *((lambda window=window: single_disperser(*FITTING).taps.window(*window), ShapeError, "window")
          for window in ((-1, 0, 3, 3), (0, 5, 3, 3), (4, 0, 3, 3), (0, 0, 0, 3))),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused(call, error, where):
    with pytest.raises(error) as caught:
        call()
    assert caught.value.where == where


@pytest.mark.parametrize("slots", [1, 3, 8])
def test_the_code_takes_the_levels_j_over_k(slots):
    near, wide = planes(slots, (20, 21), 3)
    levels = (single_disperser(near, wide, Dispersion.linear(4)).taps.code * slots).unique()
    assert torch.allclose(levels, levels.round())
    assert levels.min() >= 0
    assert levels.max() <= slots
    assert len(levels) > min(slots, 3)
