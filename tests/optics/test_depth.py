"""Depth planes: evenly spaced in inverse depth, weights that sum to one, unknown pixels found."""

import pytest
import torch

from tmca.errors import SettingError
from tmca.optics import DepthPlanes


def test_planes_are_even_in_inverse_depth_from_far_to_near():
    planes = DepthPlanes(0.4, 2.0, 8)
    assert float(planes.metres[0]) == pytest.approx(2.0)
    assert float(planes.metres[-1]) == pytest.approx(0.4)
    torch.testing.assert_close(planes.inverse.diff(), torch.full((7,), planes.step, dtype=torch.float64))
    assert float(DepthPlanes(0.5, float("inf"), 2).inverse[0]) == 0


def test_every_pixel_is_in_one_plane_the_nearest():
    planes = DepthPlanes(0.4, 2.0, 8)
    depth = 0.4 + 1.6 * torch.rand(2, 1, 9, 7)
    weights = planes.weights(depth)
    torch.testing.assert_close(weights.sum(1), torch.ones(2, 9, 7))
    slow = (1 / depth - planes.inverse[None, :, None, None]).abs().argmin(1)
    assert (weights.argmax(1) == slow).all()
    assert (planes.weights(planes.metres[None, :, None, None].permute(1, 0, 2, 3))[:, :, 0, 0] == torch.eye(8)).all()


def test_unknown_depth_is_found_never_clamped():
    planes = DepthPlanes(0.4, 2.0, 8)
    depth = torch.tensor([0.0, float("nan"), -1.0, float("inf"), 0.3, 5.0, 0.4, 2.0, 0.39, 2.6])
    assert planes.within(depth).tolist() == [False] * 6 + [True] * 2 + [False] * 2
    assert planes.nearest(depth).tolist() == [0, 0, 0, 0, 7, 0, 7, 0, 7, 0]


@pytest.mark.parametrize("count", [1, 2, 3, 8])
@pytest.mark.parametrize(("near", "far"), [(0.4, 2.0), (1.37, 1.43), (0.3, float("inf"))])
def test_the_range_itself_is_known_however_few_planes(near, far, count):
    planes = DepthPlanes(near, far, count)
    inside = planes.depth_of(torch.linspace(0, 1, 1001)[1:])  # single precision, both ends apart from infinity
    assert bool(planes.within(inside).all())
    assert bool(planes.within(planes.metres[torch.isfinite(planes.metres)]).all())
    beyond = torch.tensor([near * 0.999, 9999.0 if far == float("inf") else far * 1.001])
    assert planes.within(beyond).tolist() == [False, far == float("inf")]
    slow = (1 / inside.double()[:, None] - planes.inverse).abs()
    place = planes.nearest(inside)
    torch.testing.assert_close(slow[torch.arange(len(inside)), place], slow.amin(1), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("planes", [(0.0, 1.0, 2), (2.0, 1.0, 2), (0.5, 1.0, 0)])
def test_impossible_planes_are_refused(planes):
    with pytest.raises(SettingError):
        DepthPlanes(*planes)
