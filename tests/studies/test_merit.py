"""What is said of a reconstruction without its truth, where the truth is known after all."""

import numpy as np
import pytest
import torch

from studies.real.merit import (
    brightest_rows,
    neighbours_error,
    prediction_error,
    reprojection_error,
    withheld,
)
from tmca.cameras import Snapshot, SpectralCamera
from tmca.errors import SettingError

NM = np.linspace(450, 650, 6)


def taken(size=(30, 25)):
    torch.manual_seed(0)
    camera = SpectralCamera(bands=(NM * 1e-9).tolist(), size=size, slots=1, shutter="open", dispersion=1)
    rows = torch.linspace(0.1, 1, size[0])[:, None].expand(size)
    scene = rows * torch.rand(6)[:, None, None] * torch.ones(1, 6, *size)
    return Snapshot(camera.A(scene), camera), scene


def test_the_truth_explains_the_snapshot_and_its_withheld_pixels():
    snapshot, scene = taken()
    blind, hidden = withheld(snapshot, 0.2, seed=1)
    operator = snapshot.camera.operator()
    assert reprojection_error(operator, scene, snapshot.values) == 0
    assert prediction_error(operator, scene, snapshot.values, hidden) == 0
    assert prediction_error(operator, 0 * scene, snapshot.values, hidden) == pytest.approx(1)
    assert float(hidden.float().mean()) == pytest.approx(0.2, abs=0.05)
    assert not bool(blind.values[0, 0][hidden].any())
    torch.testing.assert_close(blind.camera.A(scene), blind.values)


def test_a_decoder_never_sees_withheld_pixels():
    snapshot, _ = taken()
    blind, hidden = withheld(snapshot)
    spoiled = Snapshot(torch.where(hidden, 99.0, snapshot.values), snapshot.camera)
    again, same = withheld(spoiled)
    torch.testing.assert_close(hidden, same)
    torch.testing.assert_close(again.values, blind.values)
    with pytest.raises(SettingError, match="share"):
        withheld(snapshot, 1.5)


def test_neighbours_predict_a_slope_and_not_a_checkerboard():
    hidden = torch.zeros(9, 9, dtype=torch.bool)
    hidden[4, 4] = hidden[2, 6] = True
    slope = torch.arange(81.0).view(1, 1, 9, 9)
    assert neighbours_error(slope, hidden) == pytest.approx(0, abs=1e-6)
    board = (torch.arange(81.0) % 2).view(1, 1, 9, 9)
    hidden[4, 5] = True
    assert neighbours_error(board, hidden) > 0.5


def test_the_brightest_rows_are_a_camera_of_their_own():
    snapshot, scene = taken()
    part = brightest_rows(snapshot, 10)
    assert part.camera.size == (10, 25)
    torch.testing.assert_close(part.camera.A(scene[:, :, 20:]), part.values)
