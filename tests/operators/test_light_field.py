"""The coded mask against slow loops, its matrix, and what it must be in the limits."""

from itertools import product

import numpy as np
import pytest
import torch

from tmca.errors import ShapeError
from tmca.operators import code_through_mask, coded_mask, mask_code, sparse_matrix
from tmca.optics import ViewShear, view_coordinates

SHEARS = {
    "thesis": ViewShear((3, 3)),
    "one row of views": ViewShear((1, 5), (1.0, 2.0)),
    "backwards": ViewShear((3, 5), (-1.0, 1.0)),
    "no shear": ViewShear((3, 3), (0.0, 0.0)),
    "fractional": ViewShear((3, 3), (0.5, 1.3)),
    "fractional along x": ViewShear((5, 3), (2.0, -0.25)),
    "mask of the sensor's pitch": ViewShear((3, 3), (1.0, 1.0), 0.9),
    "larger mask": ViewShear((1, 3), (0.6, 1.0), 1.15),
}
SIZES = [(5, 7), (6, 4), (1, 9), (3, 1)]


def planes(shear, size, slots):
    return tuple(torch.rand(slots, *each).round().double() for each in (shear.mask_size(size), size))


def interpolated(plane, y, x):
    """The mask between its pixels, bilinear, one value."""
    top, left = int(np.floor(y + 1e-9)), int(np.floor(x + 1e-9))
    total = 0.0
    for row, column in product((top, top + 1), (left, left + 1)):
        weight = max(0.0, 1 - abs(y - row)) * max(0.0, 1 - abs(x - column))
        if 0 <= row < plane.shape[0] and 0 <= column < plane.shape[1]:
            total += weight * float(plane[row, column])
    return total


def by_loops(aperture, shutter, shear):
    """Errata (12): Σ_k S^k_m T^k_{m + shear·ℓ}."""
    slots, rows, columns = shutter.shape
    border = shear.border((rows, columns))
    code = np.zeros((*shear.views, rows, columns))
    for (i, v), (j, u) in product(*(enumerate(view_coordinates(n)) for n in shear.views)):
        for m, n, k in product(range(rows), range(columns), range(slots)):
            y, x = (
                shear.scale * (p - (size - 1) / 2) + (size - 1) / 2 + edge + step * view
                for p, size, edge, step, view in zip((m, n), (rows, columns), border, shear.step, (v, u), strict=True)
            )
            code[i, j, m, n] += float(shutter[k, m, n]) * interpolated(aperture[k].numpy(), y, x)
    return code


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", SHEARS)
def test_the_code_is_what_slow_loops_give(name, size):
    aperture, shutter = planes(SHEARS[name], size, 3)
    found = mask_code(aperture, shutter, SHEARS[name])
    np.testing.assert_allclose(found.numpy(), by_loops(aperture, shutter, SHEARS[name]), atol=1e-9)


@pytest.mark.parametrize("name", ["thesis", "fractional", "mask of the sensor's pitch"])
def test_derivatives_of_the_code_are_exact(name):
    shear = SHEARS[name]
    aperture, shutter = (torch.rand_like(p).requires_grad_() for p in planes(shear, (1, 2), 2))
    torch.autograd.gradcheck(lambda a, s: mask_code(a, s, shear), (aperture, shutter))
    torch.autograd.gradgradcheck(lambda a, s: mask_code(a, s, shear), (aperture, shutter))


def test_an_open_shutter_gives_the_sheared_mask_of_marwah():
    """Thesis (6): the views, each with its share of light, behind the mask shifted by its own shear."""
    shear = ViewShear((3, 5))
    aperture, _ = planes(shear, (6, 7), 1)
    scene, share = torch.rand(1, 3, 5, 6, 7, dtype=torch.float64), torch.rand(3, 5, dtype=torch.float64)
    expected = sum(
        share[1 + v, 2 + u] * aperture[0, 1 + v : 7 + v, 2 + u : 9 + u] * scene[0, 1 + v, 2 + u]
        for v in view_coordinates(3)
        for u in view_coordinates(5)
    )
    operator = coded_mask(aperture.expand(4, -1, -1), torch.ones(4, 6, 7, dtype=torch.float64), shear, share)
    torch.testing.assert_close(operator.A(scene.flatten(1, 2))[0, 0], expected)


def test_seen_from_the_mask_the_code_is_the_same_ray_by_ray():
    """Eq. (10): mask pixel n and view ℓ meet at sensor pixel n - ℓ, beyond which there is no light."""
    shear, size = ViewShear((3, 5), (1.0, -2.0)), (5, 6)
    aperture, shutter = planes(shear, size, 3)
    code = mask_code(aperture, shutter, shear) / 3
    seen = code_through_mask(aperture, shutter, shear)
    top, left = shear.border(size)
    for (i, v), (j, u) in product(enumerate(view_coordinates(3)), enumerate(view_coordinates(5))):
        rows, columns = slice(top + v, top + v + size[0]), slice(left - 2 * u, left - 2 * u + size[1])
        torch.testing.assert_close(seen[i, j, rows, columns], code[i, j])
        outside = seen[i, j].clone()
        outside[rows, columns] = 0
        assert outside.eq(0).all()


def test_a_mask_too_small_for_the_shear_is_refused():
    shear = ViewShear((5, 5))
    with pytest.raises(ShapeError):
        mask_code(torch.ones(2, 8, 6), torch.ones(2, 8, 6), shear)


@pytest.mark.parametrize("name", SHEARS)
def test_every_sensor_pixel_sees_only_its_own_place_and_is_inverted_alone(name):
    operator = coded_mask(*planes(SHEARS[name], (3, 4), 4), SHEARS[name])
    matrix = sparse_matrix(operator).toarray()
    gram = matrix @ matrix.T
    assert np.abs(gram - np.diag(np.diag(gram))).max() == 0
    snapshot = torch.rand(2, 1, 3, 4, dtype=torch.float64)
    least = snapshot.flatten(1).numpy() @ np.linalg.pinv(matrix).T
    np.testing.assert_allclose(operator.A_dagger(snapshot).flatten(1), least, atol=1e-12)
