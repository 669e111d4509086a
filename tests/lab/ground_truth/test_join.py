"""Spectra and depth of one table as one scene: read back by what the spectral-depth camera reads."""

import numpy as np
import pytest
import xarray as xr

from tmca.data import label, label_depth, nm_to_metres, read_spectral_depth, write_dataset
from tmca.errors import DataError, SettingError
from tmca.lab.ground_truth.join import DEPTH, join_ground_truth, open_cube, open_part

NM = np.array([400.0, 430, 480, 500, 700])


def parts(size=(6, 7)):
    rng = np.random.default_rng(0)
    values = rng.uniform(0.05, 0.9, (5, *size)).astype(np.float32)
    values[2, 1, 1] = values[0, 2, 2] = values[1:3, 3, 3] = np.nan
    values[:, 4, 4], values[0, 0, 0], values[1, 0, 0] = np.nan, -0.02, 1.2
    cube = label(values, nm_to_metres(NM))
    flags = (cube.dims, np.isnan(values).astype(np.uint8))
    spectra = xr.Dataset({"reflectance": cube, "reflectance_std": cube * 0 + 0.01, "quality": flags})
    metres = rng.uniform(0.4, 1.6, size)
    metres[5, 5] = np.nan
    confidence = (("y", "x"), np.isnan(metres).astype(np.uint8))
    depth = xr.Dataset(
        {"depth": label_depth(metres, "d"), "depth_std": (("y", "x"), metres * 1e-3), "confidence": confidence}
    )
    return spectra, depth


def test_the_scene_is_read_back_as_it_was_joined(tmp_path):
    spectra, depth = parts()
    scene = join_ground_truth(spectra, depth)
    write_dataset(scene, tmp_path / "scene.nc")
    found = read_spectral_depth(tmp_path / "scene.nc")
    assert np.array_equal(found["radiance"].values, scene["radiance"].values)
    assert found["radiance"].values.min() >= 0
    assert found["radiance"].values.max() <= 1
    assert np.array_equal(found["depth"].values, scene["depth"].values, equal_nan=True)
    assert found.attrs["metric"]
    measured = scene["measured"].values.astype(bool)
    assert np.array_equal(found["radiance"].values[measured], spectra["reflectance"].values[measured])
    assert np.isnan(found["depth"].values)[[4, 5], [4, 5]].all()
    assert found["depth"].attrs["unknown_pixels"] == 2


def test_missing_bands_lie_between_their_neighbours():
    spectra, depth = parts()
    values, scene = spectra["reflectance"].values.astype(float), join_ground_truth(spectra, depth)
    found = scene["radiance"].values
    assert found[2, 1, 1] == pytest.approx(values[1, 1, 1] + (values[3, 1, 1] - values[1, 1, 1]) * 50 / 70, rel=1e-5)
    assert found[0, 2, 2] == pytest.approx(values[1, 2, 2])
    share = (NM[1:3] - 400) / 100
    assert np.allclose(found[1:3, 3, 3], values[0, 3, 3] * (1 - share) + values[3, 3, 3] * share)
    assert (found[:, 4, 4] == 0).all()
    assert (scene.attrs["interpolated"], scene.attrs["clipped"], scene.attrs["pixels_without_spectrum"]) == (4, 2, 1)


def test_a_cameras_bands_lie_on_the_lines_between_the_scans():
    spectra, depth = parts()
    asked = np.array([400.0, 405, 455, 480, 650, 700])
    found, own = join_ground_truth(spectra, depth, wavelengths=nm_to_metres(asked)), join_ground_truth(spectra, depth)
    for y in range(6):
        for x in range(7):
            line = np.interp(asked, NM, own["radiance"].values[:, y, x])
            assert np.allclose(found["radiance"].values[:, y, x], line, atol=1e-6)
    assert np.allclose(found["wavelength_nm"], asked)
    # band 2 (480 nm) is missing at 1,1: 455 and 480 nm lean on it
    assert found["measured"].values[:, 1, 1].tolist() == [1, 1, 0, 0, 1, 1]
    assert np.isfinite(found["radiance_std"].values[:, 5, 0]).all()
    with pytest.raises(DataError, match="found 400 to 700 nm, expected 390 to 500 nm"):
        join_ground_truth(spectra, depth, wavelengths=nm_to_metres([390.0, 500]))
    with pytest.raises(SettingError, match="ascending"):
        join_ground_truth(spectra, depth, wavelengths=nm_to_metres([500.0, 450]))


def test_parts_that_do_not_fit_are_refused(tmp_path):
    spectra, depth = parts()
    with pytest.raises(DataError, match="a depth map of 6×6 pixels, expected 6×7"):
        join_ground_truth(spectra, depth.isel(x=slice(6)))
    with pytest.raises(DataError, match="no pixel with a spectrum and a depth"):
        join_ground_truth(spectra * np.nan, depth)
    write_dataset(spectra, tmp_path / "s.nc")
    with pytest.raises(DataError, match=r"no depth .* a file of tmca scan depth"):
        open_part(tmp_path / "s.nc", DEPTH, "tmca scan depth")
    with pytest.raises(DataError, match="no such file"):
        open_part(tmp_path / "gone.nc", DEPTH, "tmca scan depth")
    assert np.isnan(open_cube(tmp_path / "s.nc").values).sum() == np.isnan(spectra["reflectance"].values).sum()
