"""Masks that lie elsewhere are found from the snapshot alone, by evidence that is held against dense matrices."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.ndimage import affine_transform
from scipy.stats import multivariate_normal

import tmca
from tests.small_scenes import smooth_scene
from tmca.codes import Codes
from tmca.errors import DataError, SettingError
from tmca.optics import Dispersion
from tmca.optics.spectral import on_columns
from tmca.priors import GaussianMixturePrior, GaussianPrior
from tmca.registration import MaskPlacement, NotRegistered, dispersion, register
from tmca.registration.evidence import MaskEvidence
from tmca.registration.placement import SmoothPlanes, seen_from
from tmca.registration.search import ELSEWHERE, LAST, Climbed, climb, judged, search

SIZE, SENSOR = (72, 84), tmca.Sensor(read_noise=0.005)
PRIOR = GaussianPrior.learn([smooth_scene(72, 96, 4, seed=s) for s in (1, 2)], (6, 20))
DISPERSED = {"dispersion": 3.0}
MOVED = np.array([1.3, -0.8, 0.7, -0.5, 0.2, -0.3, 0.0, 0.3])


def camera(**changes):
    return tmca.SpectralCamera(4, SIZE, **{"slots": 1, "shutter": "open", "sensor": SENSOR, "seed": 3} | changes)


def elsewhere(shown, vector, factor=1.0):
    """A camera whose mask and bands lie elsewhere, and its snapshot on the columns of the one that was drawn."""
    aperture, shutter = shown.codes()
    planes = SmoothPlanes(aperture)(*seen_from(torch.as_tensor(vector, dtype=torch.float32), aperture.shape[-2:]))
    drawn = shown.dispersion
    middle = sum(drawn.displacement[:: len(drawn.displacement) - 1]) / 2
    bands = Dispersion(tuple(middle + factor * (one - middle) for one in drawn.displacement))
    first, width = drawn.origin - bands.origin, SIZE[1] + bands.extent
    moved = shown.replace(codes=Codes(planes, on_columns(shutter, first, width)), dispersion=bands)
    values = moved(smooth_scene(*SIZE, 4, seed=5).float()[None], generator=0)
    return moved, tmca.Snapshot(on_columns(values, -first, shown.snapshot_shape[-1]), shown)


@pytest.mark.parametrize("size", [(21, 30), (24, 17)])
def test_a_mask_is_moved_as_splines_are_elsewhere(size):
    mask = np.random.default_rng(0).random(size)
    vector = torch.tensor([0.7, -1.2, 0.5, -0.4, 0.2, 0.3, 0.0, 0.0], dtype=torch.float64)
    found = SmoothPlanes(torch.from_numpy(mask)[None])(*seen_from(vector, size))[0].numpy()
    placed = MaskPlacement.of(vector.numpy(), size)
    inverse, middle = np.linalg.inv(placed.matrix), (np.array(size) - 1) / 2
    offset = middle - inverse @ (middle + np.array(placed.shift))
    expected = affine_transform(mask, inverse, offset, order=3, mode="nearest").clip(0, 1)
    np.testing.assert_allclose(found[3:-3, 3:-3], expected[3:-3, 3:-3], atol=2e-3)


def test_a_placement_says_how_the_mask_was_turned_and_stretched():
    size, middle = (100, 80), np.array([49.5, 39.5])
    vector = np.array([1, 2, 50 * math.radians(0.3), 0.5, 0, 0, 0, 0])
    placed = MaskPlacement.of(vector, size)
    assert placed.rotation == pytest.approx(0.3, rel=0.02)
    np.testing.assert_allclose(placed.strain, np.eye(2) * 1.01, atol=2e-4)
    rows, columns = seen_from(torch.from_numpy(vector), size)
    for pixel in ((0, 0), (60, 70), (99, 3)):
        back = np.linalg.inv(placed.matrix) @ (pixel - middle - placed.shift) + middle
        np.testing.assert_allclose((rows[pixel], columns[pixel]), back, atol=1e-9)


def test_splines_have_their_derivatives():
    planes = SmoothPlanes(0.2 + 0.6 * torch.rand(2, 9, 11, dtype=torch.float64))
    places = [torch.rand(5, dtype=torch.float64) * 6 + 1 for _ in range(2)]
    assert torch.autograd.gradcheck(planes, [one.requires_grad_() for one in places])


@pytest.mark.parametrize(
    "changes", [{}, {"slots": 3, "shutter": "random"}, {"slots": 2, "shutter": "balanced", "buckets": 2}]
)
def test_the_evidence_is_that_of_dense_gaussians(changes):
    shown = camera(**changes)
    _, snapshot = elsewhere(shown, 0 * MOVED)
    evidence = MaskEvidence(shown, snapshot.values, PRIOR)
    blocks = evidence.among(100, 2)
    code = shown.taps().code.double().numpy()
    model, (h, w) = evidence.solver.model, PRIOR.block[1:]
    expected = 0.0
    for top, left in blocks:
        part = code[:, top : top + h, left : left + w]
        rows = []
        for bucket in range(model.buckets):
            for y in range(h):
                for x in range(model.span, w):
                    row = np.zeros(PRIOR.block)
                    for t, (channel, offset) in enumerate(zip(model.channels, model.offsets, strict=True)):
                        row[channel, y, x - offset] += part[bucket * len(model.offsets) + t, y, x - offset]
                    rows.append(row.ravel())
        rows = np.array(rows)
        covariance = rows @ PRIOR.covariance.double().numpy() @ rows.T + 0.005**2 * np.eye(len(rows))
        seen = snapshot.values[0, :, top : top + h, left + model.span : left + w].double().numpy().ravel()
        density = multivariate_normal(rows @ PRIOR.mean.double().numpy().ravel(), covariance)
        expected += density.logpdf(seen) + len(rows) / 2 * math.log(2 * math.pi)
    assert evidence.value(0 * MOVED, blocks) == pytest.approx(expected, rel=2e-3)


def test_the_evidence_has_its_slope():
    shown = camera()
    _, snapshot = elsewhere(shown, MOVED)
    evidence = MaskEvidence(shown, snapshot.values, PRIOR)
    blocks = evidence.among(100, 2)
    _, slope = evidence.slope(MOVED, blocks, 0.05)
    for at in range(len(MOVED)):
        step = np.eye(len(MOVED))[at] * 0.005
        ahead, behind = (evidence.value(MOVED + sign * step, blocks, 0.05) for sign in (1, -1))
        assert slope[at] == pytest.approx((ahead - behind) / 0.01, rel=0.03, abs=0.5)


@pytest.mark.parametrize(
    ("changes", "factor"),
    [({}, 1.0), ({"slots": 3, "shutter": "random"}, 1.0), (DISPERSED | {"shutter": "open"}, 1.01)],
)
def test_a_mask_is_found_and_the_scene_with_it(changes, factor):
    shown = camera(**changes)
    _, snapshot = elsewhere(shown, MOVED, factor)
    found = register(snapshot, PRIOR)
    true = MaskPlacement.of(MOVED, SIZE)
    assert found.converged
    assert found.placement.shift == pytest.approx(true.shift, abs=0.08)
    assert found.placement.rotation == pytest.approx(true.rotation, abs=0.1)
    np.testing.assert_allclose(found.placement.strain, true.strain, atol=3e-3)
    assert ("dispersion" in found.std) == (found.dispersion != 1)
    scene = smooth_scene(*SIZE, 4, seed=5)
    errors = [
        (tmca.reconstruct(one, "lmmse", prior=PRIOR).values - scene).square().mean()
        for one in (found.snapshot, snapshot)
    ]
    assert errors[0] < 0.3 * errors[1]


@pytest.mark.parametrize("factor", [1.01, 0.99])
def test_a_dispersion_is_as_sure_as_its_evidence_is_curved(factor, monkeypatch):
    _, snapshot = elsewhere(camera(**DISPERSED, shutter="open"), MOVED, factor)
    errors = np.sign(factor - 1) * np.arange(0.007, 0.0135, 0.0005)
    others = [dispersion.scaled(snapshot, PRIOR, 1 + error) for error in errors]
    blocks = others[0].among(100, 4)
    count = others[0].solver.model.measurements
    values = [count * one.value(MOVED, blocks) / one.solver.model.measurements for one in others]
    best = errors[np.argmax(values)]
    curve = np.polyfit(errors - best, values, 4)
    std = dispersion.dispersion_std(snapshot, PRIOR, MOVED, blocks, best)
    assert std == pytest.approx((-2 * curve[2]) ** -0.5, rel=0.2)
    assert abs(best - factor + 1) < max(5 * std, 0.0005)
    monkeypatch.setattr(dispersion, "scaled", lambda *_: others[0])  # the same, whatever the dispersion
    assert math.isnan(dispersion.dispersion_std(snapshot, PRIOR, MOVED, blocks, best))


@pytest.mark.parametrize(
    ("name", "other"),
    [
        ("_stretched", lambda *given: (1.0, given[4] * dispersion.MOST_DISPERSION)),
        ("judged", lambda evidence, vector, blocks: Climbed(vector + 9, False)),
    ],
)
def test_a_dispersion_at_its_limit_or_without_a_place_stays_and_the_mask_is_found(monkeypatch, name, other):
    monkeypatch.setattr(dispersion, name, other)
    _, snapshot = elsewhere(camera(**DISPERSED), MOVED)
    found = register(snapshot, PRIOR)
    assert found.converged
    assert found.dispersion == 1
    assert "dispersion" not in found.std
    np.testing.assert_allclose(found.placement.shift, MOVED[:2], atol=0.2)


class TwoMaxima:
    """Evidence with two maxima: a mask that is not turned is more probable at the lower one."""

    size, right, wrong = (100, 100), np.array([-0.8, -0.8, 1.0, 0, 0, 0, 0, 0]), np.array([-0.8, 0.4, 0, 0, 0, 0, 0, 0])
    widths = torch.tensor([0.3, 0.3, 0.8, 1, 1, 1, 1, 1], dtype=torch.float64)

    def among(self, radius, cells):
        return [(0, at) for at in range(cells**2)]

    def density(self, vector):
        peaks = ((1000, self.right), (700, self.wrong))
        away = ((height, (vector - torch.from_numpy(place)) / self.widths) for height, place in peaks)
        return sum(height * (-one.square().sum() / 2).exp() for height, one in away)

    def each(self, vector, blocks, noise=0.0):
        return np.full(len(blocks), float(self.density(torch.from_numpy(vector))))

    def value(self, vector, blocks, noise=0.0):
        return self.each(vector, blocks).sum()

    def slope(self, vector, blocks, noise=0.0):
        place = torch.tensor(vector, dtype=torch.float64, requires_grad=True)
        (slope,) = torch.autograd.grad(self.density(place), place)
        return self.value(vector, blocks), len(blocks) * slope.numpy()


def test_of_two_maxima_the_higher_one_is_found():
    evidence = TwoMaxima()
    drawn = [evidence.value(place * (np.arange(8) < 2), [(0, 0)]) for place in (evidence.right, evidence.wrong)]
    assert drawn[0] < drawn[1]
    found = search(evidence)
    assert found.converged
    np.testing.assert_allclose(found.vector, evidence.right, atol=0.01)


class Ridge(TwoMaxima):
    """Evidence whose coordinates say much alone and little together."""

    top = np.array([0.1, -0.1, 0.9, 0.6, -0.4, 0.5, 0.8, 0.7])

    def density(self, vector):
        away = vector - torch.from_numpy(self.top)
        return 500 - 40 * (away.diff().square().sum() + 0.02 * away.square().sum())


def test_the_last_climb_ends_at_the_top():
    ended = climb(Ridge(), np.zeros(8), [(0, at) for at in range(36)], LAST)
    np.testing.assert_allclose(ended, Ridge.top, atol=0.1)


def test_a_place_at_its_limit_is_none():
    evidence, blocks = TwoMaxima(), [(0, at) for at in range(36)]
    assert judged(evidence, evidence.right, blocks).converged
    assert not judged(evidence, np.where(np.arange(8) == 3, 2.0, evidence.right), blocks).converged


class Elsewhere(TwoMaxima):
    """Evidence of which every block has more at another place elsewhere than where the search ended."""

    def each(self, vector, blocks, noise=0.0):
        at = [np.allclose(vector[:2] - self.right[:2], away) for away in ELSEWHERE]
        return np.array([2.0 * at[number % len(at)] if any(at) else 1.0 for number in range(len(blocks))])


def test_a_place_is_held_against_the_best_one_elsewhere_of_every_block():
    assert not judged(Elsewhere(), Elsewhere.right, [(0, at) for at in range(36)]).converged


def test_noise_in_a_small_frame_is_no_mask():
    shown = tmca.SpectralCamera(4, (32, 56), slots=1, shutter="open", sensor=SENSOR, seed=3)
    noise = torch.rand(1, *shown.snapshot_shape, generator=torch.Generator().manual_seed(12))
    with pytest.warns(NotRegistered, match="no place of the mask stands out"):
        assert not register(tmca.Snapshot(noise, shown), PRIOR).converged


def test_how_sure_a_place_is_comes_in_words_and_numbers():
    _, snapshot = elsewhere(camera(**DISPERSED), MOVED)
    found = register(snapshot, PRIOR)
    found = replace(found, std=found.std | {"dispersion": 0.00123})
    place, exact = found.lines()
    assert place == str(found)
    assert f"{found.std['right']:.3f} px" in exact
    assert exact.endswith("0.00123 of dispersion")
    unsure = replace(found, std=dict.fromkeys(found.std, math.nan))
    assert unsure.lines()[1] == "  ± not known: the evidence has no maximum there"
    assert unsure.described()["std"] == dict.fromkeys(found.std)
    assert json.loads(json.dumps(found.described()))["light"] == pytest.approx(found.placement.light)


def test_a_light_fields_mask_is_found():
    shown = tmca.LightFieldCamera(3, SIZE, slots=2, shutter="random", sensor=SENSOR)
    prior = GaussianPrior.learn([smooth_scene(72, 96, 9, seed=s) for s in (1, 2)], (5, 12))
    aperture, shutter = shown.codes()
    vector = torch.tensor([0.9, -0.6, 0.4, 0, 0, 0, 0, 0])
    moved = shown.replace(codes=Codes(SmoothPlanes(aperture)(*seen_from(vector, aperture.shape[-2:])), shutter))
    scene = smooth_scene(*SIZE, 9, seed=5).float().reshape(1, *shown.scene_shape)
    found = register(tmca.Snapshot(moved(scene, generator=0), shown), prior)
    assert found.placement.shift == pytest.approx((0.9, -0.6), abs=0.08)
    assert found.dispersion == 1


def test_where_nothing_stands_out_the_mask_stays():
    dark = tmca.Snapshot(torch.zeros(1, 1, *camera().snapshot_shape[1:]), camera())
    with pytest.warns(NotRegistered, match="it stays where it was drawn"):
        found = register(dark, PRIOR)
    assert found.snapshot is dark
    assert not found.converged


def test_the_mask_of_another_camera_stays():
    _, snapshot = elsewhere(camera(), MOVED)
    other = tmca.Snapshot(snapshot.values, camera(seed=4))
    with pytest.warns(NotRegistered, match="no place of the mask stands out"):
        assert register(other, PRIOR).snapshot is other


def test_other_cameras_and_priors_are_refused():
    depth = tmca.SpectralDepthCamera.from_preset("thesis", size=(16, 16))
    taken = tmca.Snapshot(torch.zeros(1, *depth.snapshot_shape), depth)
    with pytest.raises(SettingError, match=r"snapshot: found .*expected one of a camera behind masks of pixels"):
        register(taken)
    _, snapshot = elsewhere(camera(), 0 * MOVED)
    with pytest.raises(SettingError, match="prior"):
        register(snapshot, GaussianMixturePrior.of(PRIOR))


@pytest.mark.parametrize("fault", ["few blocks", "dark"])
def test_frames_that_say_nothing_are_left_as_they_are(fault):
    size = (16, 26) if fault == "few blocks" else SIZE
    shown = tmca.SpectralCamera(4, size, slots=1, shutter="open", sensor=SENSOR)
    values = torch.full((1, *shown.snapshot_shape), -0.002 if fault == "dark" else 0.3)
    snapshot = tmca.Snapshot(values, shown)
    with pytest.warns(NotRegistered, match="stays where it was drawn"):
        registered = register(snapshot, PRIOR)
    assert registered.snapshot is snapshot
    assert (registered.placement.shift, registered.placement.rotation) == ((0, 0), 0)


def test_pixels_that_are_not_finite_are_refused():
    values = torch.zeros(1, *camera().snapshot_shape)
    values[..., 3, 4] = torch.nan
    with pytest.raises(DataError, match="NaN or infinite"):
        register(tmca.Snapshot(values, camera()), PRIOR)
