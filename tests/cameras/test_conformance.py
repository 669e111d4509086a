"""What every camera promises, whichever it is: a new one is one row of ``CAMERAS_UNDER_TEST``."""

from pathlib import Path

import pytest
import torch

from tmca.cameras import CAMERAS, LightFieldCamera, Snapshot, SpectralCamera, SpectralDepthCamera
from tmca.optics import PhaseMaskBench, Undersampled
from tmca.testing.cameras import CHECKS, case_of

BENCH = PhaseMaskBench(window=(5, 7), mask_pixels=12, diameter=1e-3)
DEPTH = {"bands": 3, "size": (9, 12), "slots": 2, "planes": 3, "bench": BENCH}
CAMERAS_UNDER_TEST = {
    "single disperser": (SpectralCamera, {"bands": 3, "size": (7, 10), "slots": 4}),
    "fractional": (
        SpectralCamera,
        {"bands": 3, "size": (8, 9), "slots": 2, "dispersion": [0.3, -1.2, 2.0], "response": [1, 2, 0.5]},
    ),
    "dual disperser": (SpectralCamera, {"bands": 4, "size": (7, 10), "slots": 3, "disperser": "dual", "period": 3}),
    "relay blur": (SpectralCamera, {"bands": 3, "size": (9, 8), "slots": 2, "relay_blur": 0.6}),
    "light field": (LightFieldCamera, {"views": 3, "size": (7, 10), "slots": 4}),
    "sheared light field": (
        LightFieldCamera,
        {"views": (3, 5), "size": (8, 9), "slots": 2, "shear": 0.4, "exposure": "per-slot", "period": 4},
    ),
    "two buckets": (SpectralCamera, {"bands": 3, "size": (7, 10), "slots": 4, "shutter": "balanced", "buckets": 2}),
    "burst": (
        SpectralCamera, {"bands": 3, "size": (7, 10), "slots": 3, "shutter": "burst", "buckets": 3, "period": 4},
    ),
    "light field, two buckets": (LightFieldCamera, {"views": 3, "size": (7, 10), "slots": 4, "buckets": 2}),
    "spectral-depth, two buckets": (SpectralDepthCamera, {**DEPTH, "channels": "rgb", "buckets": 2}),
    "spectral-depth": (SpectralDepthCamera, {**DEPTH, "filters": "gaussian"}),
}  # fmt: skip
each_camera = pytest.mark.parametrize("name", CAMERAS_UNDER_TEST)


def made(name, **changes):
    kind, settings = CAMERAS_UNDER_TEST[name]
    return kind(**{**settings, **changes})


def inputs(camera, batch=2, dtype=torch.float32):
    """A scene, and its depth where the camera images it."""
    return tuple(part.to(dtype) for part in case_of(camera).given(batch=batch))


def test_every_kind_of_camera_is_here():
    assert {kind.kind for kind, _ in CAMERAS_UNDER_TEST.values()} == set(CAMERAS)


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
@each_camera
def test_every_camera_conforms(name, check):
    check(case_of(made(name)))


@each_camera
def test_a_snapshot_is_drawn(name):
    camera = made(name)
    assert "data:image/png;base64," in Snapshot(camera(*inputs(camera, batch=1)), camera)._repr_html_()


@each_camera
def test_a_change_of_precision_keeps_complex_fields_whole(name):
    one, other = (made(name) for _ in range(2))
    given = inputs(one, dtype=torch.float64)
    torch.testing.assert_close(one.to(torch.float64)(*given), other.double()(*given))
    assert {n for n, t in one.named_buffers() if t.is_complex()} == {
        n for n, t in other.named_buffers() if t.is_complex()
    }


@each_camera
def test_a_scene_that_stands_still_is_the_same_slot_by_slot(name):
    camera = made(name)
    if camera.kind == "spectral" and camera.disperser == "dual":
        pytest.skip("a dual disperser images no moving scenes")
    scene, *depth = inputs(camera)
    moving = scene[:, None].expand(-1, camera.slots, *([-1] * (scene.ndim - 1)))
    torch.testing.assert_close(camera.exact(moving, *depth), camera.exact(scene, *depth), atol=1e-5, rtol=1e-5)


@each_camera
def test_another_size_is_taken_with_the_same_seed(name):
    camera, bigger = made(name), made(name, size=(12, 13))
    given = inputs(bigger)
    torch.testing.assert_close(camera.replace(size=(12, 13))(*given), bigger(*given), atol=1e-6, rtol=1e-5)


@each_camera
def test_a_camera_without_size_is_bound_to_its_scene(name):
    free, bound = made(name, size=None), made(name, size=(11, 14))
    assert free.unbound == {"size"}
    assert not bound.unbound
    given = inputs(bound)
    torch.testing.assert_close(free.bound_to(size=(11, 14), bands=7)(*given), bound(*given), atol=1e-6, rtol=1e-5)
    assert bound.bound_to(size=(20, 20)) is bound


@each_camera
def test_the_operator_is_cached_until_a_tensor_of_the_camera_changes(name):
    camera = made(name)
    depth = inputs(camera)[1:]
    part = (lambda: camera.transfer()) if depth else camera.operator
    first = part()
    assert part() is first
    next(iter(camera.buffers())).mul_(1.0)
    for buffer in camera.buffers():
        if buffer.is_floating_point():
            buffer.mul_(1.0)
    assert part() is not first


@each_camera
def test_the_model_of_its_attributes_names_all_that_it_writes(name):
    camera = made(name)
    written = {*camera.variables().attrs, *camera.variables(tiled=True).attrs}
    assert written - {*camera.attributes.model_fields} == {"camera", "tmca_version"}


@each_camera
def test_variables_of_one_tile_make_the_camera_at_another_size(name):
    drawn = {} if name == "burst" else {"shutter": "random"}
    camera, bigger = made(name, period=3, **drawn), made(name, period=3, size=(12, 13), **drawn)
    given = inputs(bigger)
    again = type(camera).from_variables(camera.variables(tiled=True), "a file", size=(12, 13))
    torch.testing.assert_close(again.exact(*given), bigger.exact(*given), atol=1e-5, rtol=1e-5)
    assert again.size == (12, 13)


@pytest.mark.parametrize(("kind", "preset"), [(kind, preset) for kind in CAMERAS.values() for preset in kind.presets])
def test_every_preset_takes_a_snapshot_of_its_size_without_a_warning(kind, preset, recwarn):
    camera = kind.from_preset(preset, size=(64, 64))
    snapshot = camera(*inputs(camera, batch=1))
    assert snapshot.shape == (1, *camera.snapshot_shape)
    assert not [told for told in recwarn if issubclass(told.category, Undersampled)]


@pytest.mark.parametrize("kind", CAMERAS)
def test_files_of_version_0_1_open(kind):
    snapshot = Snapshot.load(Path(__file__).parent / "files" / f"{kind}-0.1.nc")
    assert snapshot.camera.kind == kind
    assert snapshot.notes == {"scene": "random", "noise_seed": 7}
    assert tuple(snapshot.values.shape[1:]) == snapshot.camera.snapshot_shape
    assert len(snapshot.values) == (3 if kind == "light-field" else 1)
    assert snapshot.camera.noise.read > 0
