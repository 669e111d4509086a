"""Layers as napari takes them: data, settings, kind."""

import numpy as np
import pytest
import torch

import tmca
from tmca.adapters import to_napari
from tmca.decoders import Estimate
from tmca.errors import SettingError


def by_name(thing):
    layers = to_napari(thing)
    assert all(kind == "image" for _, _, kind in layers)
    return {about["name"]: (data, about) for data, about, _ in layers}


def test_an_estimate_is_a_cube_its_colours_and_its_deviation():
    camera = tmca.SpectralCamera(bands=[400e-9, 500e-9, 600e-9], size=(4, 5), slots=2)
    values = torch.rand(1, 3, 4, 5)
    layers = by_name(Estimate(values, camera, "lmmse", deviation=values / 10))
    data, about = layers["estimate"]
    np.testing.assert_array_equal(data, values[0])
    assert about["metadata"]["wavelengths_nm"] == pytest.approx([400, 500, 600])
    for band, nanometres in enumerate((400, 500, 600)):
        assert about["translate"][0] + band * about["scale"][0] == pytest.approx(nanometres)
    picture, how = layers["estimate, colours"]
    assert picture.shape == (4, 5, 3)
    assert how["rgb"] is True
    assert layers["deviation"][1]["visible"] is False


def test_uneven_bands_have_no_scale():
    camera = tmca.SpectralCamera(bands=[400e-9, 450e-9, 600e-9], size=(4, 5), slots=2)
    about = by_name(Estimate(torch.rand(1, 3, 4, 5), camera, "lmmse"))["estimate"][1]
    assert "scale" not in about


def test_depth_snapshots_light_fields_and_scenes_are_layers():
    depths = tmca.SpectralDepthCamera.from_preset("quick", size=(32, 32))
    plane = torch.ones(1, 1, 32, 32)
    layers = by_name(Estimate(torch.rand(1, *depths.scene_shape), depths, "likelihood", depth=plane, confidence=plane))
    assert {"radiance", "radiance, colours", "depth", "confidence"} == set(layers)
    camera = tmca.SpectralCamera(bands=3, size=(4, 5), slots=2)
    snapshot = tmca.Snapshot(torch.rand(1, 1, 4, 7), camera)
    assert by_name(snapshot)["snapshot"][0].shape == (4, 7)
    views = tmca.LightFieldCamera(views=3, size=(4, 5), slots=2)
    ((shape, _),) = [(data.shape, about) for data, about, _ in to_napari(views.label(torch.rand(1, 3, 3, 4, 5)))]
    assert shape == (3, 3, 4, 5)


def test_something_else_is_refused():
    with pytest.raises(SettingError):
        to_napari(3)
