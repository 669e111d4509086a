"""Cameras, faults and scenes that cannot be: the error says where."""

import pytest
import torch
from torch import nn

from tests.cameras.test_hardware import light_field, spectral, spectral_depth, taken
from tests.cameras.test_spectral_depth import camera as depth_camera
from tests.cameras.test_spectral_depth import scene_of
from tmca.cameras import Camera, Hardware, LightFieldCamera, SpectralCamera, SpectralDepthCamera, imperfect
from tmca.errors import SettingError, ShapeError, TmcaError
from tmca.optics import PhaseMaskBench
from tmca.sensor import Sensor

NAN = float("nan")
ANY = [  # of a wrong type or value in every camera
    *(({"size": size}, "size") for size in ("ab", (3.5, 4), (NAN, 4), (None, 4), 8, (8, 8, 8), ("8", "8"))),
    *(({"slots": slots}, "slots") for slots in (0, -1, 2.5, "2", None, True)),
    *(({"sensor": sensor}, "sensor") for sensor in ("x", {}, Sensor)),
    *(({"codes": codes}, "codes") for codes in ("random", {}, torch.ones(2))),
    *(({"period": period}, "period") for period in ("x", 2.7, 0)),
    *(({"seed": seed}, "seed") for seed in (-1, 1.5, "x")),
    *(({"exposure": name}, "exposure") for name in (None, [])),
    *(({"shutter": shutter}, "shutter") for shutter in ("x", None)),
    ({"colour": 1}, "colour"),
]
VIEWS = {"views": 5, "size": (8, 9)}
SETTINGS = {
    SpectralCamera: [
        *ANY, *(({"bands": bands}, "bands") for bands in ("x", 2.5, [NAN])), ({"duty": -1}, "duty"),
        *(({"dispersion": pixels}, "dispersion") for pixels in ("x", None, NAN)),
        ({"transmittance": 2}, "transmittance"), ({"codes": nn.Linear(1, 1)}, "codes"),
        *(({"beside": columns}, "beside") for columns in (3, (-1, 0), (0.5, 0), (200, 200))),
        *(({"relay_blur": blur}, "relay_blur") for blur in ("x", None, NAN, [1.0])),
        ({"bands": 0}, "bands"), ({"bands": [550.0, 600.0]}, "bands"), ({"size": (0, 4)}, "size"),
        ({"exposure": "mean"}, "exposure"), ({"disperser": "triple"}, "disperser"),
        ({"shutter": "oneshot"}, "shutter"),
        ({"response": [1.0]}, "response"), ({"dispersion": [1.0, 2.0]}, "dispersion"),
        *(({"bands": 2, "response": [1.0, share]}, "response") for share in (NAN, float("inf"), -0.1)),
        ({"bands": 2, "response": [0.0, 0.0]}, "response"),
        ({"bands": 3, "size": (6, 7), "coloured": torch.ones(4, 6, 7)}, "coloured"),
        *(({"bands": 4, "size": (6, 7), "coloured": torch.full((4, 6, 7), share)}, "coloured")
          for share in (NAN, float("inf"), -0.1, 1.1)),
        *(({"bands": 4, "size": (6, 7), "coloured": torch.ones(4, 6, 7), **more}, "coloured")
          for more in ({"disperser": "dual"}, {"relay_blur": 1.0})),
    ],
    LightFieldCamera: [
        *ANY, *(({**VIEWS, "views": views}, "views") for views in (4, 11, (3, 3, 3), "5", 5.5)),
        *(({**VIEWS, "shear": shear}, "shear") for shear in (float("inf"), (1,), "a", (1, 2, 3), (1, None))),
        *(({**VIEWS, "vignetting": share}, "vignetting")
          for share in (torch.ones(3, 3), -torch.ones(5, 5), [[1.0], [1.0, 2.0]], "dark")),
        *(({**VIEWS, "mask_scale": scale}, "mask_scale") for scale in (-1.0, "wide")),
        ({**VIEWS, "aperture": torch.ones(8, 8, 9)}, "aperture"), ({**VIEWS, "shutter": "half"}, "shutter"),
        ({**VIEWS, "exposure": "long"}, "exposure"), ({**VIEWS, "learnable": "mask"}, "learnable"),
    ],
    SpectralDepthCamera: [
        *ANY, *(({name: value}, name) for name, value in {
            "depth": 1, "planes": 2.5, "bench": "x", "mask": None, "rms": "x", "modes": 2.5, "stroke": 1.0,
            "filters": None, "cells": "x", "channels": None, "learnable": None, "image_formation": None,
        }.items()),
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


CODED = (SpectralCamera, LightFieldCamera)
SMALL = {
    SpectralCamera: {"bands": 3, "size": (6, 7), "slots": 2},
    LightFieldCamera: {"views": 3, "size": (6, 7), "slots": 2},
    SpectralDepthCamera: {"bands": 2, "size": (12, 13), "slots": 2, "filters": "gaussian", "planes": 2},
}


def from_file(made: Camera) -> Camera:
    return type(made).from_variables(made.variables(), "file", size=made.size)


@pytest.mark.parametrize(
    ("make", "part", "where"),
    [
        *((make, {"seed": 3}, "seed") for make in SMALL), *((make, {"colour": 3}, "colour") for make in SMALL),
        *((make, {name: 0.3}, name) for make in CODED for name in ("transmittance", "duty")),
        *((SpectralDepthCamera, {name: value}, name) for name, value in {"rms": 2e-7, "modes": 5}.items()),
        *((make, {"slots": 3}, "aperture") for make in CODED),
        (SpectralCamera, {"bands": 4}, "dispersion"), (SpectralDepthCamera, {"slots": 3}, "mask"),
        (SpectralDepthCamera, {"bands": 3}, "channels"),
    ],
)  # fmt: skip
def test_a_camera_of_a_file_refuses_what_would_change_nothing(make, part, where):
    camera = from_file(make(**SMALL[make]))
    with pytest.raises(TmcaError) as caught:
        camera.replace(**part)
    assert caught.value.where == where
    if where != "colour":
        assert "replace" in caught.value.remedy


def test_codes_of_a_file_are_drawn_anew_where_their_family_is_given_too():
    for make in (SpectralCamera, LightFieldCamera):
        drawn = from_file(make(**SMALL[make])).replace(aperture="random", shutter="random", seed=3)
        assert all(map(torch.equal, drawn.codes(), make(**SMALL[make], seed=3).codes()))
    settings = SMALL[SpectralDepthCamera]
    drawn = from_file(SpectralDepthCamera(**settings)).replace(mask="zernike", shutter="one-hot", seed=3)
    assert all(map(torch.equal, drawn.codes(), SpectralDepthCamera(**settings, seed=3).codes()))


def test_new_filters_come_with_their_own_cells_and_measured_ones_keep_theirs():
    clear = SpectralDepthCamera(**{**SMALL[SpectralDepthCamera], "filters": "clear"})
    gaussian = from_file(clear).replace(filters="gaussian").filters
    assert gaussian.cells().unique().tolist() == [0, 1, 2, 3]
    known = from_file(SpectralDepthCamera(**SMALL[SpectralDepthCamera], seed=7))
    measured = known.replace(filters=0.9 * known.filters.filters)
    assert torch.equal(measured.filters.cells(), known.filters.cells())
    torch.testing.assert_close(measured.filters(), 0.9 * known.filters())


def test_parts_of_codes_that_are_a_module_are_not_replaced_one_by_one():
    known = SpectralDepthCamera(**SMALL[SpectralDepthCamera])
    bench = imperfect(known, Hardware(height_error=0.1))
    with pytest.raises(SettingError) as caught:
        bench.replace(mask="flat")
    assert caught.value.where == "mask"


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
