"""Small files that commands read."""

import numpy as np
import scipy.io
import torch
import xarray as xr

from tmca.cameras import Snapshot, SpectralCamera


def cube(name, values, **variables):
    scipy.io.savemat(name, {"cube": np.asarray(values), **variables})


def labelled(name, values, nanometres):
    coords = {"wavelength": ("wavelength", nanometres, {"units": "nm"})}
    xr.DataArray(values, dims=("y", "x", "wavelength"), coords=coords, name="cube").to_netcdf(name)


def good():
    """(12, 14, 31) y, x, wavelength."""
    return np.random.default_rng(0).random((12, 14, 31))


def small_snapshot(name="s_snapshot.nc"):
    camera = SpectralCamera(bands=12, size=(8, 20), slots=2)
    return Snapshot(torch.rand(1, *camera.snapshot_shape), camera).save(name)
