"""What is said of a reconstruction without its truth, where the truth is known after all."""

import numpy as np
import pytest
import torch

from tests.lab.real_captures.bench import captured, mask_of, smooth_scene
from tmca.cameras import Snapshot, SpectralCamera
from tmca.errors import SettingError
from tmca.experiments.real.colour import linear_srgb, srgb_picture
from tmca.experiments.real.decoding import check_real_decoders, decode_real
from tmca.experiments.real.figures import upright, upright_place
from tmca.experiments.real.geometry import light_by_offset, mask_evidence
from tmca.experiments.real.kept import kept_estimate
from tmca.experiments.real.merit import (
    agreement,
    brightest_rows,
    foretelling_error,
    neighbours_error,
    reprojection_error,
    withheld,
)

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
    assert foretelling_error(operator, scene, snapshot.values, hidden) == 0
    assert foretelling_error(operator, 0 * scene, snapshot.values, hidden) == pytest.approx(1)
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


def test_neighbours_foretell_a_slope_and_not_a_checkerboard():
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


def test_agreement_is_the_known_error():
    one = np.random.default_rng(0).uniform(0.2, 1, (5, 40, 41))
    one[0, 0, 0] = 1
    other = one + 0.01
    found = agreement(one, other)
    assert found["psnr"] == pytest.approx(40, abs=0.1)
    assert agreement(one, 2 * one)["sam"] == pytest.approx(0, abs=1e-3)


def test_an_even_spectrum_is_white_and_a_long_one_red():
    cube = np.zeros((28, 2, 2))
    nm = np.linspace(450, 650, 28)
    cube[:, 0, 0], cube[nm > 600, 0, 1], cube[(nm > 510) & (nm < 560), 1, 0], cube[nm < 480, 1, 1] = 1, 1, 1, 1
    linear = linear_srgb(cube, nm * 1e-9)
    np.testing.assert_allclose(linear[:, 0, 0], 1, atol=1e-9)
    assert [int(linear[:, y, x].argmax()) for y, x in ((0, 1), (1, 0), (1, 1))] == [0, 1, 2]
    lamp = np.linspace(0.2, 1, 28)
    np.testing.assert_allclose(linear_srgb(lamp[:, None, None], nm * 1e-9, lamp)[:, 0, 0], 1)
    picture = srgb_picture(cube, nm * 1e-9)
    assert picture.shape == (2, 2, 3)
    assert picture.min() >= 0
    assert picture.max() <= 1


@pytest.mark.parametrize("degrees", [0, 90, 180, 270])
def test_a_place_turns_with_its_picture(degrees):
    picture = np.arange(12).reshape(3, 4)
    row, column = upright_place((2, 1), (3, 4), degrees)
    assert upright(picture, degrees)[row, column] == picture[2, 1]


def test_captures_say_how_their_mask_lies_and_where_light_falls():
    mask = mask_of(160, 150)
    capture = captured(smooth_scene(4, 160, 150), mask)
    shares = mask_evidence([capture], mask, range(0, 8, 2), 0.0)
    assert shares["as it is"] > 0.8
    assert max(share for way, share in shares.items() if way != "as it is") < 0.3
    light = light_by_offset([capture], mask, [-4, -2, 0, 2, 4, 6, 8, 10], 0.0)
    assert min(light[2:6]) > 0.7
    assert max(abs(light[[0, 1, 6, 7]])) < 0.1


def test_the_plug_and_play_decoder_explains_a_snapshot():
    snapshot, scene = taken((24, 26))
    found = decode_real(snapshot, "pnp").estimate
    assert reprojection_error(snapshot.camera.operator(), found, snapshot.values) < 0.05
    assert float((found - scene).norm() / scene.norm()) < 0.3


def test_decoders_are_known_and_a_network_has_weights():
    with pytest.raises(SettingError, match="--decoders"):
        check_real_decoders(["magic"], None)
    with pytest.raises(SettingError, match="--weights: found none"):
        check_real_decoders(["network"], None)
    with pytest.raises(SettingError, match="decoder"):
        decode_real(taken()[0], "magic")


def test_an_estimate_is_computed_once_for_the_same_input_alone(tmp_path, monkeypatch):
    asked = []

    def counted(*given):
        asked.append(given)
        return decode_real(*given)

    monkeypatch.setattr("tmca.experiments.real.kept.decode_real", counted)
    snapshot, _ = taken((12, 10))
    dimmer = Snapshot(0.5 * snapshot.values, snapshot.camera)
    first, seconds = kept_estimate(tmp_path, "scene", snapshot, "admm-tv")
    again, told = kept_estimate(tmp_path, "scene", snapshot, "admm-tv")
    torch.testing.assert_close(again, first, rtol=0, atol=0)
    assert told == seconds
    assert len(asked) == 1
    other, _ = kept_estimate(tmp_path, "scene", dimmer, "admm-tv")
    assert len(asked) == 2
    assert float((other - first).abs().max()) > 1e-3


@pytest.mark.parametrize("left", [0, 100])
def test_a_kept_estimate_that_is_cut_short_is_computed_again(tmp_path, left):
    snapshot, _ = taken((12, 10))
    first, _ = kept_estimate(tmp_path, "scene", snapshot, "admm-tv")
    (file,) = tmp_path.iterdir()
    whole = file.read_bytes()
    file.write_bytes(whole[:left])
    again, _ = kept_estimate(tmp_path, "scene", snapshot, "admm-tv")
    torch.testing.assert_close(again, first)
    assert len(file.read_bytes()) == len(whole)
