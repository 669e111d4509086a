"""A bench in metres gives the shear that similar triangles give."""

import json

import pytest
import xarray as xr

from tmca.cli import main

BENCH = ["--aperture-distance", "0.05", "--aperture-width", "0.012", "--pixel-pitch", "6e-6"]
SCENE = ["simulate", "light-field", "coffee:1", "--crop", "24x32", "--views", "3", "--slots", "2", "--no-figures"]


@pytest.mark.filterwarnings("default::tmca.cameras.CodesWarning")
@pytest.mark.parametrize(
    ("options", "step", "scale"),
    [
        (["--mask-distance", "1e-4"], 1e-4 * 4e-3 / (0.0499 * 6e-6), 1.0),
        (["--mask-distance", "1e-4", "--mask-pitch", "6e-6"], 1e-4 * 4e-3 / (0.05 * 6e-6), 0.998),
        (["--shear", "2"], 2.0, 1.0),
        ([], 1.0, 1.0),
        (["--mask-pitch", "5.988e-6"], 1e-4 * 4e-3 / (0.0499 * 6e-6), 1.0),
    ],
)
def test_rays_of_a_bench_meet_the_mask_where_similar_triangles_say(tmp_path, capsys, options, step, scale):
    out = tmp_path / "snapshot.nc"
    main([*SCENE, *BENCH, *options, "--out", str(out)])
    assert "mm from the sensor" in capsys.readouterr().err
    with xr.open_dataset(out, engine="h5netcdf") as found:
        assert json.loads(found.attrs["shear"]) == pytest.approx([step, step], rel=1e-6)
        assert float(found.attrs["mask_scale"]) == pytest.approx(scale, rel=1e-9)
