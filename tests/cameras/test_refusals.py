"""Cameras, faults and scenes that cannot be: the error says where."""

import pytest
import torch

from tests.cameras.test_hardware import light_field, spectral, spectral_depth, taken
from tests.cameras.test_spectral_depth import camera as depth_camera
from tests.cameras.test_spectral_depth import scene_of
from tmca.cameras import Hardware, LightFieldCamera, SpectralCamera, imperfect
from tmca.errors import SettingError, ShapeError, TmcaError
from tmca.optics import PhaseMaskBench

NAN = float("nan")
VIEWS = {"views": 5, "size": (8, 9)}
SETTINGS = {
    SpectralCamera: [
        ({"bands": 0}, "bands"), ({"bands": [550.0, 600.0]}, "bands"), ({"size": (0, 4)}, "size"),
        ({"exposure": "mean"}, "exposure"), ({"disperser": "triple"}, "disperser"),
        ({"shutter": "oneshot"}, "shutter"),
        ({"response": [1.0]}, "response"), ({"dispersion": [1.0, 2.0]}, "dispersion"),
        ({"bands": 3, "size": (6, 7), "coloured": torch.ones(4, 6, 7)}, "coloured"),
        *(({"bands": 4, "size": (6, 7), "coloured": torch.ones(4, 6, 7), **more}, "coloured")
          for more in ({"disperser": "dual"}, {"relay_blur": 1.0})),
    ],
    LightFieldCamera: [
        *(({**VIEWS, "views": views}, "views") for views in (4, 11)), ({**VIEWS, "slots": 0}, "slots"),
        *(({**VIEWS, "shear": shear}, "shear") for shear in (float("inf"), (1,), "a", (1, 2, 3), (1, None))),
        *(({**VIEWS, "vignetting": share}, "vignetting")
          for share in (torch.ones(3, 3), -torch.ones(5, 5), [[1.0], [1.0, 2.0]], "dark")),
        *(({**VIEWS, "mask_scale": scale}, "mask_scale") for scale in (-1.0, "wide")),
        ({**VIEWS, "aperture": torch.ones(8, 8, 9)}, "aperture"), ({**VIEWS, "shutter": "half"}, "shutter"),
        ({**VIEWS, "exposure": "long"}, "exposure"), ({**VIEWS, "learnable": "mask"}, "learnable"),
    ],
    depth_camera: [
        ({"mask": "wavy"}, "mask"), ({"mask": torch.zeros(2, 24, 24)}, "mask"),
        ({"shutter": torch.ones(2, 4, 4)}, "shutter"),
        ({"filters": torch.ones(4, 2)}, "filters"), ({"filters": 2 * torch.ones(4, 3)}, "filters"),
        ({"cells": torch.tensor([[0, 7], [1, 2]])}, "cells"), ({"channels": torch.ones(2, 5)}, "channels"),
        ({"channels": "cmyk"}, "channels"), ({"depth": (2.0, 0.4)}, "depth"), ({"learnable": "lens"}, "learnable"),
        ({"image_formation": "ray"}, "image_formation"), ({"shutter": "one-hot", "slots": 5, "period": 2}, "slots"),
        ({"bands": (250e-9, 550e-9), "bench": PhaseMaskBench(material="PMMA")}, "material"),
    ],
}  # fmt: skip


@pytest.mark.parametrize(
    ("make", "settings", "where"), [(make, *row) for make, rows in SETTINGS.items() for row in rows]
)
def test_impossible_cameras_are_refused(make, settings, where):
    with pytest.raises(TmcaError) as caught:
        make(**settings)
    assert caught.value.where == where


@pytest.mark.parametrize("make", [SpectralCamera, LightFieldCamera])
def test_unknown_presets_are_refused(make):
    with pytest.raises(SettingError) as caught:
        make.from_preset("tehsis")
    assert caught.value.where == "preset"


def test_depths_of_another_shape_are_refused():
    made = depth_camera()
    cube, depth = scene_of(made)
    for wrong, at, where in (
        (cube[:, :2], depth, "scene"), (cube[:, None], depth, "scene"), (cube, depth[:, 0], "depth"),
        (cube, depth[..., 1:], "depth"), (cube, depth[:, None].expand(-1, 3, -1, -1, -1), "depth"),
    ):  # fmt: skip
        with pytest.raises(ShapeError) as caught:
            made(wrong, at)
        assert caught.value.where == where


@pytest.mark.parametrize(
    ("faults", "where"),
    [
        ({"contrast_ratio": 0.5}, "contrast_ratio"), ({"contrast_ratio": 1}, "contrast_ratio"),
        ({"leakage": -0.1}, "leakage"), ({"delay": NAN}, "delay"), ({"misregistration": (1, 2, 3)}, "misregistration"),
        ({"rotation": "far"}, "rotation"), ({"wobble": 1}, "hardware"), ({"switching": 2}, "switching"),
        ({"hot_pixels": 0.7, "dead_pixels": 0.7}, "hot_pixels, dead_pixels"), ({"blur": "1:2"}, "blur"),
    ],
)  # fmt: skip
def test_impossible_faults_are_refused(faults, where):
    with pytest.raises(SettingError) as caught:
        Hardware.of(faults)
    assert caught.value.where == where


def dual():
    return spectral(disperser="dual")


def coloured():
    return SpectralCamera(bands=2, size=(4, 5), coloured=torch.rand(2, 4, 5))


@pytest.mark.parametrize(
    ("build", "fault"),
    [
        (spectral, "height_error"), (spectral, "shear_error"), (light_field, "height_error"),
        (light_field, "dispersion_error"), (spectral_depth, "shear_error"), (spectral_depth, "misregistration"),
        (dual, "dispersion_error"), (dual, "blur"), (coloured, "delay"), (coloured, "leakage"),
    ],
)  # fmt: skip
def test_a_fault_that_a_camera_cannot_have_is_refused_and_leaves_it_as_it_is(build, fault):
    camera = build()
    before = taken(camera)
    with pytest.raises(SettingError) as caught:
        imperfect(camera, Hardware.of({fault: 0.2}))
    assert caught.value.where == fault
    assert torch.equal(taken(camera), before)
