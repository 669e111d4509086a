"""Figures of merit of scenes that move, frame by frame."""

import numpy as np
import pytest
import torch
from PIL import Image

import tmca
from tests.small_scenes import smooth_scene
from tmca.applications.evaluating import evaluation_of
from tmca.applications.moving import frames_of, moved_by
from tmca.applications.pictures import estimate_files, estimate_pictures
from tmca.applications.refocusing import light_field_of
from tmca.cameras import moving_object, moving_scene
from tmca.data.cubes import label
from tmca.errors import DataError, SettingError
from tmca.metrics import psnr
from tmca.priors import GaussianPrior

WAVES = np.array([450e-9, 550e-9, 650e-9])


@pytest.fixture(scope="module")
def scene():
    return label(smooth_scene(20, 22, seed=3).float().clamp(0, 1).numpy(), WAVES)


@pytest.fixture(scope="module")
def snapshot(scene):
    camera = tmca.SpectralCamera(slots=4, shutter="balanced", buckets=2, sensor=tmca.Sensor(read_noise=0.01))
    return tmca.simulate(scene, camera, motion=(2.0, -1.0))


def test_frames_are_compared_with_the_scene_of_their_time(scene, snapshot, tmp_path):
    prior = GaussianPrior.learn([smooth_scene(40, 44, seed=seed) for seed in range(3)], (10, 12))
    estimate = tmca.reconstruct(snapshot, "space-time-lmmse", prior=prior, motion=2.0)
    truths = moving_scene(torch.from_numpy(scene.values), (2.0, -1.0), 4).numpy()
    expected = np.mean([psnr(one, true) for one, true in zip(estimate.values[0].numpy(), truths, strict=True)])
    assert tmca.evaluate(estimate, scene)["psnr"] == pytest.approx(expected)
    stored = estimate.save(tmp_path / "e.nc")
    assert tmca.evaluate(stored, scene)["psnr"] == pytest.approx(expected)
    with pytest.raises(SettingError, match="frames: found 3, expected 4"):
        tmca.evaluate(estimate, scene, frames=3)


def test_a_still_estimate_is_compared_with_every_frame_where_that_is_asked_for(scene, snapshot):
    estimate = tmca.reconstruct(snapshot, "dagger")
    truths = moving_scene(torch.from_numpy(scene.values), (2.0, -1.0), 2).numpy()
    expected = np.mean([psnr(estimate.values[0].numpy(), true) for true in truths])
    assert tmca.evaluate(estimate, scene, frames=2)["psnr"] == pytest.approx(expected)
    still = psnr(estimate.values[0].numpy(), scene.values)
    assert tmca.evaluate(estimate, scene)["psnr"] == pytest.approx(still)


def test_an_object_moves_before_the_rest(scene):
    values = torch.from_numpy(scene.values)
    frames = moving_object(values, (0.0, 4.0), 8)
    assert torch.equal(frames[:, :, 0], values[:, 0].expand(8, -1, -1))  # above the disc
    disc = frames[0] - values
    assert float(disc.abs().max()) > 0
    torch.testing.assert_close(moving_object(values, (0.0, 0.0), 2), values.expand(2, -1, -1, -1))
    even = torch.full_like(values, 0.3)
    torch.testing.assert_close(moving_object(even, (3.0, 1.5), 3), even.expand(3, -1, -1, -1))
    assert len(frames_of(scene, (1.0, 1.0), 3, whole=False)) == 3


@pytest.mark.parametrize("noted", ["fast", [1.0], [float("nan"), 0.0], [1e9, 0.0], None])
def test_a_damaged_note_of_motion_is_refused(noted):
    with pytest.raises(DataError, match="motion_pixels"):
        moved_by({"motion_pixels": noted})


def test_an_estimate_in_frames_is_drawn_beside_the_truth_and_animated(scene, snapshot, tmp_path):
    estimate = tmca.reconstruct(snapshot, "space-time-dct", iterations=2)
    target = tmp_path / "e.nc"
    files = estimate_pictures(estimate, target, truth=scene)
    assert [target, *files] == estimate_files(target, "spectral", moving=True)
    assert Image.open(tmp_path / "e_frames.gif").n_frames == 6  # to and fro


@pytest.fixture(scope="module")
def views():
    return smooth_scene(24, 26, 9, 1).unflatten(0, (3, 3)).float().clamp(0, 1).numpy()


def moved_views(views, slots=2):
    camera = tmca.LightFieldCamera(views=3, slots=slots, shutter="burst", buckets=2)
    return tmca.simulate(views, camera, motion=(1.0, 1.0))


@pytest.fixture(scope="module")
def light_field(views):
    """An estimate in frames, and the truth."""
    snapshot = moved_views(views)
    prior = GaussianPrior.learn([smooth_scene(30, 30, 9)], (7, 7), views=(3, 3))
    estimate = tmca.reconstruct(snapshot, "space-time-lmmse", prior=prior, motion=2.0)
    return estimate, snapshot.camera.label(torch.from_numpy(views)[None])


def test_a_light_field_in_frames_is_drawn(light_field, tmp_path):
    estimate, truth = light_field
    files = estimate_pictures(estimate, tmp_path / "e.nc", truth=truth)
    assert all(file.stat().st_size > 1000 for file in files)
    assert tmca.evaluate(estimate, truth)["psnr"] > 20
    titles = [axis.get_title() for axis in estimate.plot(truth).axes]
    assert "space-time-lmmse, mean of 2 frames\nagainst the scene at rest" in titles
    assert "space-time-lmmse, mean of 2 frames" in [axis.get_title() for axis in estimate.plot().axes]


def test_a_file_of_a_light_field_in_frames_is_evaluated_frame_by_frame(light_field, tmp_path):
    estimate, truth = light_field
    stored = estimate.save(tmp_path / "e.nc")
    assert tmca.evaluate(stored, truth) == pytest.approx(tmca.evaluate(estimate, truth))
    with pytest.raises(SettingError, match="frames: found 3, expected 2"):
        tmca.evaluate(stored, truth, frames=3)
    assert evaluation_of(stored, truth).figure("e").axes
    with pytest.raises(DataError, match="no light field"):
        tmca.read(stored, "light-field", views=3)
    for use in (tmca.view, light_field_of):
        with pytest.raises(DataError, match="an estimate in frames, expected one frame"):
            use(str(stored))


@pytest.mark.parametrize("colours", [1, 3])
def test_a_file_of_a_still_light_field_knows_how_its_scene_moved(views, colours, tmp_path):
    coloured = np.stack([views, views / 2, views / 3])[:colours].squeeze()
    estimate = tmca.reconstruct(moved_views(coloured), "dagger")
    stored = estimate.save(tmp_path / "e.nc")
    assert tmca.evaluate(stored, coloured, frames=2) == pytest.approx(tmca.evaluate(estimate, coloured, frames=2))
    assert tmca.evaluate(stored, coloured, frames=2)["psnr"] != pytest.approx(tmca.evaluate(stored, coloured)["psnr"])


def test_colours_in_frames_are_evaluated_from_their_file(views, tmp_path):
    snapshot = moved_views(np.stack([views, views / 2, views / 3]))
    prior = GaussianPrior.learn([smooth_scene(30, 30, 9)], (5, 5), views=(3, 3))
    estimate = tmca.reconstruct(snapshot, "space-time-lmmse", prior=prior, motion=2.0, frames=1)
    truth = snapshot.camera.label(torch.from_numpy(np.stack([views, views / 2, views / 3])))
    stored = estimate.save(tmp_path / "e.nc")
    assert tmca.evaluate(stored, truth) == pytest.approx(tmca.evaluate(estimate, truth))
