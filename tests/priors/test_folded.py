"""Factors in half of their room against whole ones."""

import pytest
import torch

from tmca.priors.folded import FoldedFactors


@pytest.mark.parametrize("side", [1, 2, 7, 12])
def test_folded_factors_are_whole_again_and_solve(side):
    roots = torch.randn(3, side, 2 * side, generator=torch.Generator().manual_seed(side), dtype=torch.float64)
    factors = torch.linalg.cholesky(roots @ roots.mT)
    room = FoldedFactors.room(5, side)
    part = room.part(slice(2, 5))
    part.fill(factors)
    assert len(part.triangles) == len(part.across) == 3
    assert part.triangles.data_ptr() == room.triangles[2].data_ptr()
    values = torch.arange(2 * side, dtype=torch.float64).reshape(2, side)
    for one in range(3):
        assert torch.equal(part.whole(one), factors[one])
        expected = torch.linalg.solve(factors[one] @ factors[one].mT, values.mT).mT
        torch.testing.assert_close(part.solve(one, values), expected, atol=1e-9, rtol=1e-9)


@pytest.mark.parametrize("side", [1, 2, 7, 12])
def test_bytes_are_what_the_room_takes(side):
    room = FoldedFactors.room(5, side)
    assert FoldedFactors.bytes_of(5, side) == room.triangles.nbytes + room.across.nbytes
