"""Calibrated deviations: features against slow loops, errors of uneven size, the file that comes with the package."""

import json

import numpy as np
import pytest
import torch
import xarray as xr

import tmca
from studies.uncertainty import fit
from studies.uncertainty.cases import KINDS, Case
from tests.decoders.conformance import camera_for, prior_for, values_for
from tmca.cameras import Snapshot
from tmca.decoders import Weights, decode, make_decoder
from tmca.decoders.certainty import CALIBRATION, FILE, Certainty, Features, calibrated, calibrations, change
from tmca.decoders.nets.tiles import CollapsedNetwork
from tmca.errors import DataError
from tmca.metrics import certainty
from tmca.operators import TapOperator

NAMES = fit.LIGHT


def drawn(*shape, seed=0):
    return torch.rand(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.double)


def uneven(seed, size=64):
    """A case whose errors are normal, large where there is texture, and predicted to be the same everywhere."""
    draw, textured = np.random.default_rng(seed), np.zeros((1, 4, size, size))
    textured[..., size // 2 :] = draw.uniform(0, 0.5, (1, 4, size, size // 2))
    values = torch.from_numpy(0.3 + textured)
    sigma = 0.01 + 0.2 * Features(values, values).activity
    errors = (sigma * torch.from_numpy(draw.standard_normal(sigma.shape))).abs()
    ones = torch.ones_like(values)
    return Case("spectral", "lmmse", "", "", f"{seed}", values, 0.05 * ones, errors, ones > 0)


@pytest.mark.parametrize("shape", [(2, 3, 7, 6), (1, 2, 2, 5, 4)])
def test_activity_and_edges_are_those_of_a_slow_loop(shape):
    values = drawn(*shape).numpy()
    found, grey = Features(torch.from_numpy(values), torch.from_numpy(values)), values
    for _ in shape[1:-2]:
        grey = grey.mean(1)
    np.testing.assert_allclose(found.activity, spread(values, 5), atol=1e-7)
    np.testing.assert_allclose(found.edges.numpy().reshape(grey.shape), spread(grey, 3), atol=1e-7)


def spread(values, side):
    """Standard deviation in the windows around all pixels, margins repeated."""
    half, found = side // 2, np.zeros_like(values)
    wide = np.pad(values, (*((0, 0),) * (values.ndim - 2), (half, half), (half, half)), mode="edge")
    for y in range(values.shape[-2]):
        for x in range(values.shape[-1]):
            found[..., y, x] = wide[..., y : y + side, x : x + side].std((-2, -1))
    return found


def test_the_slope_is_the_larger_difference_of_neighbouring_views():
    values = drawn(1, 3, 4, 6, 5)
    found = Features(values, values)
    smooth = found._smooth.numpy()
    for v in range(3):
        for u in range(4):
            down = smooth[:, min(v + 1, 2), u] - smooth[:, max(v - 1, 0), u]
            across = smooth[:, v, min(u + 1, 3)] - smooth[:, v, max(u - 1, 0)]
            np.testing.assert_allclose(found.slope[:, v, u], np.maximum(abs(down), abs(across)), atol=1e-12)


@pytest.mark.parametrize("shape", [(1, 1, 1, 1), (2, 3, 5, 7), (1, 2, 3, 4, 9), (1, 4, 2, 31)])
def test_the_deviation_is_positive_of_any_size_and_scales_with_the_scene(shape):
    values, deviation = drawn(*shape), 0.01 + drawn(*shape, seed=1)
    coefficients = dict.fromkeys(NAMES, 0.2)
    found = calibrated(values, deviation, coefficients)
    assert found.shape == shape
    assert (found > 0).all()
    torch.testing.assert_close(calibrated(3 * values, 3 * deviation, coefficients), 3 * found)
    one_by_one = [calibrated(*pair, coefficients) for pair in zip(values.split(1), deviation.split(1), strict=True)]
    torch.testing.assert_close(torch.cat(one_by_one), found)


def test_a_calibration_brings_uneven_errors_within_their_deviations():
    coefficients = fit.fitted([fit.sampled(uneven(seed), NAMES) for seed in range(2)], NAMES)
    new = uneven(7)
    before = certainty(new.errors, torch.zeros_like(new.errors), new.deviation)
    after = certainty(new.errors, torch.zeros_like(new.errors), calibrated(new.values, new.deviation, coefficients))
    assert abs(before["coverage_1s"] - 0.68) > 0.06
    assert after["coverage_1s"] == pytest.approx(0.68, abs=0.03)
    assert after["coverage_2s"] == pytest.approx(0.95, abs=0.02)
    assert after["rank_correlation"] > 0.4


def test_the_file_is_what_the_recipe_writes():
    for entry in json.loads(FILE.read_text()):
        kind = KINDS[entry["camera"]]
        assert set(entry) == set(Certainty.model_fields)
        assert tuple(entry["coefficients"]) == fit.NAMES[entry["camera"]]
        assert entry["coefficients"]["predicted"] > 0
        assert {*entry["cameras"]} <= {*kind.fitted}
    known = {(decoder, kind) for kind, what in KINDS.items() for decoder in what.decoders}
    assert set(calibrations()) == known


def test_no_scene_of_the_fit_is_measured():
    for kind in KINDS.values():
        assert not {*kind.scenes} & {*kind.tests}


@pytest.mark.parametrize("shape", [(2, 3, 7, 6), (1, 2, 2, 5, 4)])
def test_the_change_is_the_root_mean_square_of_a_slow_loop(shape):
    one, other = drawn(*shape), drawn(*shape, seed=1)
    square, found = (one - other).square().numpy(), change(one, other)
    wide = np.pad(square, (*((0, 0),) * (square.ndim - 2), (2, 2), (2, 2)), mode="edge")
    for y in range(shape[-2]):
        for x in range(shape[-1]):
            wanted = np.sqrt(wide[..., y : y + 5, x : x + 5].mean((-2, -1)))
            np.testing.assert_allclose(found[..., y, x], wanted, atol=1e-9)


@pytest.mark.parametrize(("kind", "slots"), [("spectral", 1), ("spectral", 8), ("light-field", 8)])
def test_networks_that_come_with_tmca_know_their_deviation(kind, slots):
    camera = Weights.find("default", slots, kind).camera_for((32, 40), sensor=tmca.Sensor(read_noise=0.01))
    taken = tmca.simulate("coffee", camera, progress=False)
    usual, plain = tmca.reconstruct(taken), tmca.reconstruct(taken, uncertainty=True, calibrated=False)
    known = calibrations()["network", kind]
    assert usual.decoder == plain.decoder == "network"
    torch.testing.assert_close(usual.deviation, calibrated(plain.values, plain.deviation, known.coefficients))
    assert usual.notes[CALIBRATION] == ", ".join(known.scenes)
    assert tmca.reconstruct(taken, uncertainty=False).deviation is None
    assert tmca.reconstruct(taken, "network", start="admm-tv-joint").deviation is None
    assert (usual.deviation > 0).all()


def test_the_deviation_of_a_network_is_that_of_every_snapshot_alone_and_without_tiles():
    weights = Weights.find("default", 1)
    camera = weights.camera_for((40, 48), sensor=tmca.Sensor(read_noise=0.01))
    values = torch.cat([tmca.simulate("coffee", camera, seed=seed, progress=False).values for seed in range(2)])
    both = decode(Snapshot(values, camera), "network")
    stream = make_decoder("network", "spectral").prepare(camera).stream(values)
    torch.testing.assert_close(torch.cat([one.deviation for one in stream]), both.deviation, rtol=1e-3, atol=1e-4)
    alone = (weights.network, TapOperator(camera.taps()), camera.noise, weights.load_prior(camera))
    whole, tiled = (CollapsedNetwork(*alone, tile=tile, changes=True)(values) for tile in (None, 16))
    torch.testing.assert_close(whole.deviation, tiled.deviation, rtol=1e-3, atol=1e-4)
    adapted = decode(Snapshot(values, camera), "network", adapt=1)
    assert adapted.deviation.shape == both.deviation.shape
    assert CALIBRATION in adapted.notes


def test_networks_of_ones_own_give_no_deviation_and_that_of_universal_is_its_own(tmp_path):
    given = Weights.find("default", 1)
    given.save(tmp_path / "mine.safetensors")
    camera = given.camera_for((32, 40), sensor=tmca.Sensor(read_noise=0.01))
    taken = tmca.simulate("coffee", camera, progress=False)
    assert tmca.reconstruct(taken, "network", weights=tmp_path / "mine.safetensors").deviation is None
    theirs = tmca.reconstruct(taken, "network", weights="universal")
    assert theirs.deviation is not None
    assert CALIBRATION not in theirs.notes
    assert tmca.reconstruct(taken, "network", weights="universal", uncertainty=False).deviation is None


CASES = [("lmmse", "spectral"), ("lmmse-adapted", "spectral"), ("mixture", "spectral"), ("lmmse", "light-field")]


@pytest.mark.parametrize(("name", "kind"), CASES)
def test_estimates_have_the_calibrated_deviation_unless_a_setting_says_no(name, kind):
    cls = type(make_decoder(name, kind))
    camera = camera_for(cls, kind)
    taken, how = Snapshot(values_for(camera), camera), {"prior": prior_for(cls.prior_kind, kind), "uncertainty": True}
    found, plain = decode(taken, name, **how), decode(taken, name, calibrated=False, **how)
    known = calibrations()[name, kind]
    assert torch.equal(found.values, plain.values)
    torch.testing.assert_close(found.deviation, calibrated(plain.values, plain.deviation, known.coefficients))
    assert found.to_xarray().attrs[CALIBRATION] == ", ".join(known.scenes)
    assert CALIBRATION not in plain.notes
    assert CALIBRATION not in decode(taken, name, prior=how["prior"]).notes


def test_depth_has_its_deviation_in_metres_and_evaluate_holds_it_against_the_truth(tmp_path):
    cls = type(make_decoder("likelihood", "spectral-depth"))
    camera = camera_for(cls, "spectral-depth")
    taken, prior = Snapshot(values_for(camera)[:1], camera), prior_for("gaussian", "spectral-depth")
    found, plain = decode(taken, "likelihood", prior=prior), decode(taken, "likelihood", prior=prior, calibrated=False)
    assert found.depth_deviation.shape == found.depth.shape == (1, 1, *camera.size)
    assert (found.depth_deviation > 0).all()
    known = calibrations()["likelihood", "spectral-depth"]
    expected = calibrated(plain.depth, plain.depth_deviation, known.coefficients)
    torch.testing.assert_close(found.depth_deviation, expected)
    depth = xr.DataArray(np.full(camera.size, float(camera.planes.metres[1]), np.float32), dims=("y", "x"))
    truth = xr.Dataset({"radiance": found.to_xarray()["radiance"], "depth": depth})
    metrics = tmca.evaluate(found.save(tmp_path / "e.nc"), truth)
    off = np.abs(found.depth[0, 0].numpy() - depth.values)
    assert metrics["depth_coverage_1s"] == pytest.approx(np.mean(off <= found.depth_deviation[0, 0].numpy()))
    assert metrics == pytest.approx(tmca.evaluate(found, truth), nan_ok=True)
    stored = found.to_xarray()
    with pytest.raises(DataError, match="below 0"):
        tmca.evaluate(stored.assign(depth_deviation=-stored["depth_deviation"]), truth)


def test_half_precision_is_calibrated_as_single_precision_is():
    values = 0.5 + 0.02 * torch.rand(1, 3, 9, 11, generator=torch.Generator().manual_seed(0))
    values, deviation = values.half(), torch.full_like(values, 0.01).half()
    coefficients = {"predicted": 0.2, "activity": 0.5, "edges": 0.3, "slope": 0.1}
    half = calibrated(values, deviation, coefficients)
    assert half.dtype == torch.half
    torch.testing.assert_close(
        half.float(), calibrated(values.float(), deviation.float(), coefficients), rtol=2e-3, atol=0
    )
