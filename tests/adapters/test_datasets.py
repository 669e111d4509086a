"""Data sets: every entry is a function of seed, epoch and index, in this process and in a worker."""

import pickle

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

import tmca
from tmca.adapters import SceneDataset, SnapshotDataset
from tmca.data import write_dataset
from tmca.errors import DataError, SettingError


@pytest.fixture(scope="module")
def cube(tmp_path_factory):
    """A cube whose values say where they are."""
    band, row, column = np.meshgrid(np.arange(4), np.arange(20), np.arange(30), indexing="ij")
    values = (band * 600 + row * 30 + column).astype(np.float32) / 2400
    scene = tmca.data.label(values, np.linspace(450e-9, 650e-9, 4))
    return write_dataset(scene.to_dataset(name="cube"), tmp_path_factory.mktemp("scenes") / "cube.nc")


@pytest.fixture
def scenes(cube, tmp_path):
    return SceneDataset([str(cube)], crop=6, length=8, seed=3, folder=tmp_path / "arrays")


def test_entries_are_parts_of_the_scene(scenes):
    assert len(scenes) == 8
    assert scenes[0].shape == (4, 6, 6)
    places = (scenes[0] * 2400).round() % 600
    assert all(torch.equal(places[0], band) for band in places)
    assert len({tuple(scenes[index].flatten().tolist()) for index in range(8)}) > 4
    assert scenes.wavelengths == pytest.approx(np.linspace(450e-9, 650e-9, 4))


def test_an_entry_depends_on_seed_epoch_and_index_alone(cube, scenes, tmp_path):
    first = [scenes[index] for index in range(8)]
    again = SceneDataset([str(cube)], crop=6, length=8, seed=3, folder=tmp_path / "others")
    assert all(torch.equal(again[index], first[index]) for index in reversed(range(8)))
    again.set_epoch(1)
    assert not torch.equal(again[0], first[0])
    other = SceneDataset([str(cube)], crop=6, length=8, seed=4, folder=tmp_path / "others")
    assert not torch.equal(other[0], first[0])


def test_a_loader_with_a_worker_gives_the_same(scenes):
    camera = tmca.SpectralCamera(slots=2, sensor=tmca.Sensor(read_noise=0.01))
    pairs = SnapshotDataset(scenes, camera)
    alone = [torch.stack(parts) for parts in zip(*(pairs[index] for index in range(8)), strict=True)]
    (batch,) = DataLoader(pairs, batch_size=8, num_workers=1)
    assert all(torch.equal(part, same) for part, same in zip(batch, alone, strict=True))


def test_pairs_are_snapshots_of_their_scenes_with_noise_of_their_own(scenes):
    sensor = tmca.Sensor(read_noise=0.01)
    pairs = SnapshotDataset(scenes, tmca.SpectralCamera(slots=2, sensor=sensor), seed=1)
    assert pairs.camera.wavelengths == pytest.approx(scenes.wavelengths)
    residuals = torch.stack([snapshot - pairs.camera.A(scene)[0] for snapshot, scene in pairs])
    assert float(residuals.std()) == pytest.approx(0.01, rel=0.15)
    assert len({float(one.flatten()[0]) for one in residuals}) == 8
    other = SnapshotDataset(scenes, pairs.camera, seed=2)
    assert not torch.equal(other[0][0], pairs[0][0])
    assert torch.equal(pickle.loads(pickle.dumps(pairs))[5][0], pairs[5][0])


def test_light_fields_keep_their_views(tmp_path):
    views = tmca.data.label_light_field(np.random.default_rng(0).random((3, 3, 12, 14)))
    file = write_dataset(views.to_dataset(name="views"), tmp_path / "views.nc")
    scenes = SceneDataset([str(file)], kind="light-field", views=3, crop=8, length=2, folder=tmp_path / "arrays")
    pairs = SnapshotDataset(scenes, tmca.LightFieldCamera(slots=2))
    assert [part.shape for part in pairs[0]] == [(1, 8, 8), (3, 3, 8, 8)]


def test_what_cannot_be_is_refused(cube, tmp_path):
    for wrong in ({"kind": "spectral-depth"}, {"crop": 0}, {"length": -1}):
        with pytest.raises(SettingError) as refused:
            SceneDataset([str(cube)], **wrong)
        assert refused.value.where in wrong
    with pytest.raises(DataError, match="at least 50×50"):
        SceneDataset([str(cube)], crop=50, folder=tmp_path)[0]
    with pytest.raises(IndexError):
        SceneDataset([str(cube)], length=3, folder=tmp_path)[3]
