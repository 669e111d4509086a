"""Delay-Doppler planes of a recovery as layers."""

from contextlib import ExitStack

import numpy as np
import pytest

from tmca.dbd import delay_doppler_planes, save_recovery, simulate, solve
from tmca.viewer.opening import open_items


@pytest.mark.parametrize("messages", ["shared", "block"])
def test_every_source_has_its_matched_filter_and_its_polynomial(tmp_path, messages):
    problem = simulate(M=9, P=4, J=1, targets=1, paths=1, seed=1, messages=messages, basis="gaussian")
    recovery = solve(problem, certify=False)
    save_recovery(recovery, tmp_path / "r.nc")
    planes = delay_doppler_planes(recovery)
    with ExitStack() as stack:
        items = open_items(tmp_path / "r.nc", stack)
        assert [item.title for item in items] == ["r.nc: radar", "r.nc: communications"]
        for item in items:
            assert [layer.name for layer in item.layers] == ["matched", "polynomial"]
            assert len({layer.size for layer in item.layers}) == 1
            for layer, one in zip(item.layers, planes[item.facts["source"]].values(), strict=True):
                upright = np.broadcast_to(np.atleast_2d(one.values.T)[::-1], layer.size)
                np.testing.assert_allclose(layer.plane(0), upright, rtol=1e-6, atol=1e-6)
