"""`tmca.read`, `simulate`, `evaluate`, `design_codes` and `train`: what they take, and where they say what is wrong."""

import warnings
from pathlib import Path

import numpy as np
import pytest
import torch

import tmca
from tmca.data.in_memory import SceneWarning
from tmca.errors import TmcaError
from tmca.reports.cameras import _sheet

SIZE = (16, 18)
CUBE = tmca.read("coffee", size=SIZE, bands=4)
VIEWS = tmca.read("coffee", "light-field", size=SIZE, views=3)
DEPTH = tmca.read("coffee", "spectral-depth", size=(32, 34))
CAMERA = tmca.SpectralCamera(slots=2, shutter="one-hot")
LIGHT_FIELD = tmca.LightFieldCamera(slots=2, shutter="one-hot")
NAN = CUBE.where(CUBE.max() != CUBE)


def taken(scene=CUBE, camera=CAMERA, **how):
    return tmca.simulate(scene, camera, **how)


def estimated(batch=1):
    snapshot = taken()
    return tmca.reconstruct(tmca.Snapshot(snapshot.values.repeat(batch, 1, 1, 1), snapshot.camera), "tikhonov")


@pytest.mark.parametrize(
    ("call", "where"),
    [
        *((lambda scene=scene: taken(scene), "scene") for scene in (
            None, [], 3, CUBE.values[0], VIEWS, CUBE.assign_coords(wavelength=range(4)), np.array(["a"]),
        )),
        *((lambda scene=scene: taken(scene), "coffee") for scene in (NAN, CUBE - 1, (255 * CUBE).astype("uint8"))),
        (lambda: taken("nowhere"), "nowhere"), (lambda: taken(CUBE, LIGHT_FIELD), "scene"),
        (lambda: taken(torch.rand(2, 4, *SIZE)), "scene"), (lambda: taken(DEPTH["depth"]), "scene"),
        (lambda: taken(CUBE, tmca.SpectralDepthCamera()), "scene"),
        *((lambda camera=camera: taken(CUBE, camera), "camera") for camera in (None, "spectral", tmca.SpectralCamera)),
        *((lambda motion=motion: taken(motion=motion), "motion") for motion in (3, "x", (99, 0), (np.nan, 0))),
        *((lambda seed=seed: taken(seed=seed), "seed") for seed in ("x", -1, 1.5)),
        (lambda: taken(hardware="leakage=1"), "hardware"), (lambda: taken(bands=3), "bands"),
        *((lambda estimate=estimate: tmca.evaluate(estimate, CUBE), "estimate") for estimate in (None, 3)),
        (lambda: tmca.evaluate(taken(), CUBE), "estimate"), (lambda: tmca.evaluate(estimated(2), CUBE), "estimate"),
        *((lambda truth=truth: tmca.evaluate(estimated(), truth), "truth") for truth in (None, NAN, VIEWS)),
        (lambda: tmca.evaluate(estimated(), CUBE, bands=3), "bands"),
        *((lambda source=source: tmca.read(source), "source") for source in (None, 3)),
        *((lambda how=how: tmca.read("coffee", **how), next(iter(how))) for how in (
            {"size": 5}, {"bands": "x"}, {"colour": True}, {"kind": "x"}, {"scale": "x"},
        )),
        (lambda: tmca.read("coffee", "light-field", views="x"), "views"),
        (lambda: tmca.read("coffee", "spectral-depth", reduce=0.5), "reduce"),
        (lambda: tmca.design_codes(CAMERA, out="d"), "camera"), (lambda: tmca.train(CAMERA, out="d"), "camera"),
        (lambda: tmca.design_codes(out="d", sensor="x"), "sensor"), (lambda: tmca.design_codes(out=None), "out"),
        *((lambda kind=kind: tmca.design_codes(kind, out="d", colour=1), "colour") for kind in tmca.cameras.CAMERAS),
        (lambda: tmca.design_codes(out="d", sensor={"colour": 1}), "colour"),
        (lambda: tmca.design_codes(out="d", scenes="nowhere"), "nowhere"),
        (lambda: tmca.train(out="d", colour=1), "colour"), (lambda: tmca.train(out="d", scenes="nowhere"), "nowhere"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_said_in_one_line(call, where, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(TmcaError) as caught:
        call()
    assert caught.value.where == where, caught.value
    assert "\n" not in str(caught.value)
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("scene", "camera"),
    [
        (CUBE.values, taken().camera), (torch.from_numpy(CUBE.values[None]), taken().camera),
        (CUBE.to_dataset(name="cube"), CAMERA), (CUBE.transpose("y", "wavelength", "x"), CAMERA),
        (CUBE.astype("float64"), CAMERA), (VIEWS.values, LIGHT_FIELD), (VIEWS.transpose(..., "view_u"), LIGHT_FIELD),
    ],
)  # fmt: skip
def test_arrays_and_axes_in_another_order_are_the_same_scene(scene, camera):
    known = CUBE if camera.kind == "spectral" else VIEWS
    snapshot = taken(scene, camera)
    torch.testing.assert_close(snapshot.values, taken(known, camera).values)
    estimate = tmca.reconstruct(snapshot, "tikhonov")
    assert tmca.evaluate(estimate, scene) == pytest.approx(tmca.evaluate(estimate, known))


def test_bands_of_an_array_are_even_where_the_camera_has_none():
    with pytest.warns(SceneWarning, match="4 bands without wavelengths"):
        bound = taken(CUBE.values).camera
    assert bound.wavelengths == pytest.approx(tmca.SpectralCamera(4).wavelengths)


def test_a_file_of_few_bands_is_read_whole(tmp_path):
    file = tmp_path / "few.nc"
    CUBE.to_netcdf(file, engine="h5netcdf")
    assert tmca.read(file).sizes["wavelength"] == 4
    torch.testing.assert_close(taken(Path(file)).values, taken().values)
    with pytest.raises(TmcaError):
        tmca.read(file, bands=12)
    assert tmca.read("coffee", size=SIZE).sizes["wavelength"] == 12


def test_brighter_than_white_is_said():
    with pytest.warns(SceneWarning, match="white"):
        snapshot = taken(2 * CUBE / CUBE.max())
    assert float(snapshot.values.max()) > 0


def test_the_truth_of_another_scene_is_told(tmp_path):
    path = tmca.reconstruct(taken(), "tikhonov").save(tmp_path / "e.nc")
    CUBE.to_dataset(name="radiance").to_netcdf(tmp_path / "copy.nc", engine="h5netcdf")
    with pytest.warns(SceneWarning, match="truth: rocket is beside a snapshot of coffee") as told:
        tmca.evaluate(path, "rocket")
    assert len(told) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for truth in (CUBE, CUBE.values, "coffee", tmp_path / "copy.nc"):
            tmca.evaluate(path, truth)


def test_an_estimate_far_from_light_is_told():
    stored = estimated().to_xarray()
    values = stored["estimate"].values
    values[:] = 0.5
    share = values.size // 100
    values.reshape(-1)[: 2 * share] = [-0.6, 1.6] * share
    with pytest.warns(SceneWarning, match=r"estimate: 2% of the values are below -0\.5 or above 1\.5"):
        tmca.evaluate(stored, CUBE)
    values.reshape(-1)[share:] = 0.5
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tmca.evaluate(stored, CUBE)


def test_the_sheet_of_a_sensor_is_what_it_says():
    sensor = tmca.Sensor(full_well=1000, read_noise_electrons=2, bits=10)
    assert _sheet(sensor).sensor().settings() == sensor.settings()
