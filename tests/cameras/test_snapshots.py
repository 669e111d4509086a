"""A snapshot file carries everything that is needed to reconstruct it."""

import h5py
import numpy as np
import pytest
import torch
import xarray as xr

from tests.cameras.test_conformance import CAMERAS_UNDER_TEST, DEPTH, inputs
from tmca.cameras import LightFieldCamera, Snapshot, SpectralCamera, SpectralDepthCamera
from tmca.decoders import decode
from tmca.errors import DataError, ShapeError, TmcaError
from tmca.sensor import Sensor

CAMERAS = {
    **CAMERAS_UNDER_TEST,
    "backwards": (
        SpectralCamera, {"bands": 5, "size": (7, 8), "slots": 2, "dispersion": -0.7, "exposure": "per-slot"},
    ),
    "uneven bands, tiled": (SpectralCamera, {
        "bands": [430e-9, 520e-9, 650e-9], "size": (9, 10), "slots": 2, "period": 4, "dispersion": [0.0, 3.0, 1.0],
        "sensor": Sensor(read_noise=0.01, full_well=1e4, read_noise_electrons=3, bits=12),
    }),
    "a measured mask": (SpectralCamera, {"bands": 3, "size": (4, 5), "slots": 1, "shutter": "open",
                                         "aperture": torch.rand(4, 5)}),
    "blurred": (SpectralCamera, {"bands": 3, "size": (9, 10), "slots": 2, "relay_blur": [0.5, 0.6, 0.7]}),
    "some light beside the sensor": (SpectralCamera, {"bands": 4, "size": (6, 9), "slots": 2, "beside": (2, 1)}),
    "a coloured aperture": (SpectralCamera, {"bands": 4, "size": (6, 7), "coloured": torch.rand(4, 6, 7)}),
    "numpy's numbers": (SpectralCamera, {
        "bands": np.int64(4), "size": np.array([6, 9]), "slots": np.int64(2), "period": np.int64(3),
        "relay_blur": np.full(4, 0.5), "response": np.array([1, 0.5, 0.2, 0.9]),
    }),
    "views per slot, vignetted, drifting": (LightFieldCamera, {
        "views": 3, "size": (7, 8), "slots": 2, "exposure": "per-slot", "mask_scale": 0.9,
        "vignetting": [[0.5, 1, 0.5], [1, 1, 1], [0.5, 1, 0.25]], "sensor": Sensor(full_well=1e4, bits=12),
    }),
    "a shutter that does not repeat": (SpectralDepthCamera, {**DEPTH, "shutter": torch.rand(2, 9, 12).round()}),
}  # fmt: skip


@pytest.fixture(scope="module", params=sorted(CAMERAS))
def taken(request):
    kind, settings = CAMERAS[request.param]
    camera = kind(**settings, seed=4)
    given = inputs(camera, 3 if kind is LightFieldCamera else 1)
    return Snapshot(camera(*given, generator=1), camera, {"scene": "random"}), given


def test_the_camera_comes_back_whole(taken, tmp_path):
    snapshot, given = taken
    camera = snapshot.camera
    back = Snapshot.load(snapshot.save(tmp_path / "s.nc"))
    assert torch.equal(back.values, snapshot.values)
    assert back.notes == {"scene": "random"}
    assert type(back.camera) is type(camera)
    xr.testing.assert_allclose(back.camera.variables(), camera.variables(), rtol=1e-6, atol=1e-12)
    assert back.camera.variables().attrs == camera.variables().attrs
    torch.testing.assert_close(back.camera.exact(*given), camera.exact(*given), atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("batch", [2, 4])
def test_several_snapshots_are_no_file_and_their_estimates_are_drawn(batch, tmp_path):
    for kind, settings in (CAMERAS["single disperser"], CAMERAS["light field"]):
        camera = kind(**settings)
        several = Snapshot(torch.rand(batch, *camera.snapshot_shape).numpy(), camera)
        with pytest.raises(ShapeError) as caught:
            several.save(tmp_path / "s.nc")
        assert caught.value.where == "values"
        assert not any(tmp_path.iterdir())
        estimate = decode(several, "tikhonov")
        assert estimate.to_xarray().sizes["snapshot"] == batch
        assert "<img" in estimate._repr_html_()


def test_notes_come_back_as_they_were(tmp_path):
    camera = SpectralCamera(bands=3, size=(4, 5), slots=2)
    notes = {
        "none": None,
        "list": [1, 2],
        "names": {"x": [1.5]},
        "yes": True,
        "text": '{"x": 1}',
        "number": 1.5,
        "no": "",
    }
    snapshot = Snapshot(torch.rand(1, *camera.snapshot_shape), camera, notes)
    back = Snapshot.load(snapshot.save(tmp_path / "s.nc"))
    assert back.notes == notes
    assert back.notes["yes"] is True
    assert back != snapshot


@pytest.mark.parametrize(
    ("call", "where"),
    [
        (lambda camera: Snapshot("x", camera), "values"), (lambda camera: Snapshot.load(None), "path"),
        (lambda camera: Snapshot(torch.ones(1, 1, 4, 7), None), "camera"),
        (lambda camera: Snapshot(torch.ones(1, 1, 4, 7), camera).save(None), "path"),
        (lambda camera: Snapshot(torch.ones(1, 1, 4, 6), camera).to_xarray(), "values"),
        (lambda camera: Snapshot(torch.full((1, 1, 4, 7), torch.nan), camera).save("s.nc"), "values"),
    ],
)  # fmt: skip
def test_what_is_no_snapshot_is_refused(call, where):
    with pytest.raises(TmcaError) as caught:
        call(SpectralCamera(bands=4, size=(4, 4), slots=2))
    assert caught.value.where == where


def test_the_file_opens_in_other_tools(taken, tmp_path):
    snapshot, _ = taken
    path = snapshot.save(tmp_path / "s.nc")
    with xr.open_dataset(path) as dataset:
        if snapshot.camera.kind == "spectral":
            assert dataset["wavelength"].attrs["units"] == "m"
            assert dataset.attrs["origin"] == snapshot.camera.dispersion.origin + snapshot.camera.beside[0]
        assert dataset[snapshot.camera.plane_names[0]].shape == tuple(snapshot.camera.codes()[0].shape)
    with h5py.File(path) as file:
        np.testing.assert_array_equal(file["snapshot"][()].ravel(), snapshot.values.flatten().numpy())


SPECTRAL, VIEWS = SpectralCamera(bands=3, size=(4, 5), slots=2), LightFieldCamera(3, (6, 9), 2)


@pytest.mark.parametrize(
    ("camera", "change", "words"),
    [
        *((SPECTRAL, *row) for row in (
            (lambda d: d.drop_vars(["aperture", "shutter"]), "no aperture, shutter"),
            (lambda d: d.drop_vars("displacement"), "no displacement"),
            (lambda d: d.isel(slot=[0]).assign(shutter=d["shutter"].rename(slot="other")), "codes that make no camera"),
            (lambda d: d.isel(x_sensor=slice(1, None)), "shutter"),
            (lambda d: d.assign(snapshot=d["snapshot"] * np.nan), "snapshot with values that are not finite"),
            (lambda d: d.assign_coords(x_sensor=d["x_sensor"] + 7), "origin 7"),
            (lambda d: d.assign(aperture=d["aperture"] + 3), "aperture"),
        )),
        *((SPECTRAL, lambda d, name=name, value=value: d.assign_attrs({name: value}), words) for name, value, words in (
            ("sensor", "{", "attribute sensor"), ("sensor", '{"read_noise": 1e308}', "read_noise"),
            ("sensor", '{"full_well": NaN}', "full_well"), ("note", np.inf, "attribute note"),
            ("exposure", "mean", "exposure"), ("disperser", "triple", "disperser"),
            ("dispersion_axis", "y", "dispersion_axis"), ("origin", 7, "origin 7"), ("origin", "x", "attribute origin"),
            ("full_scale", np.nan, "attribute full_scale"), ("full_scale", "x", "attribute full_scale"),
            ("relay_blur", '"x"', "relay_blur"),
        )),
        (VIEWS, lambda d: d.isel(y_mask=slice(1, None)), "7×11 pixels, expected 8×11"),
    ],
)  # fmt: skip
def test_a_file_that_cannot_be_used_is_named_in_one_line(tmp_path, camera, change, words):
    whole = Snapshot(torch.rand(1, *camera.snapshot_shape), camera).to_xarray()
    change(whole).to_netcdf(tmp_path / "changed.nc", engine="h5netcdf")
    with pytest.raises(DataError, match=words) as caught:
        Snapshot.load(tmp_path / "changed.nc")
    assert "changed.nc" in str(caught.value)
    assert "\n" not in str(caught.value)
