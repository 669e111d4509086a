"""Delay-Doppler planes of a recovery as layers."""

from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest

from tmca.dbd import Units, delay_doppler_planes, save_recovery, simulate, solve
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
                if layer.name == "matched":
                    upright = 20 * np.log10(upright / upright.max())
                    assert (layer.unit, layer.span) == ("dB", (-30.0, 0.0))
                np.testing.assert_allclose(layer.plane(0), upright, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("carrier", [24e9, None])
def test_axes_have_units_and_paths_are_marked_where_the_plane_is_highest(tmp_path, carrier):
    problem = simulate(M=9, P=4, J=1, targets=1, paths=0, seed=1, basis="gaussian")
    save_recovery(solve(replace(problem, units=Units(3e-6, 2e4, carrier)), certify=False), tmp_path / "r.nc")
    with ExitStack() as stack:
        [item] = open_items(tmp_path / "r.nc", stack)
        assert "in doubt" not in item.facts
        layer = item.layers[0]
        [[across, down]] = layer.view["points"]
        rows, columns = layer.size
        row, column = np.unravel_index(np.argmax(layer.plane(0)), layer.size)
        assert abs(across * columns - column) <= 1
        assert abs(down * rows - (row + 1)) <= 1  # rows begin at the highest Doppler, which a cell is below
        (low, high), (top, bottom) = layer.view["extents"].values()
        assert (low, high) == pytest.approx((0, 3e-6 * 299_792_458 / 2))
        speed = 2e4 if carrier is None else 2e4 * 299_792_458 / 2 / carrier
        assert (top, bottom) == pytest.approx((speed / 2, -speed / 2))
        assert layer.view["ylabel"] == ("Doppler (Hz)" if carrier is None else "velocity (m/s)")


def test_a_doubt_is_shown(tmp_path):
    problem = simulate(M=9, P=4, J=1, targets=1, paths=0, seed=1, basis="gaussian")
    save_recovery(replace(solve(problem, certify=False), doubt="is the pulse right?"), tmp_path / "r.nc")
    with ExitStack() as stack:
        assert open_items(tmp_path / "r.nc", stack)[0].facts["in doubt"] == "is the pulse right?"
