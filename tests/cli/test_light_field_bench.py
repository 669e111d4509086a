"""A bench in metres gives the shear that similar triangles give."""

import json

import pytest
import xarray as xr

from tests.cli.refusals import refused
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


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (BENCH[:4], "--pixel-pitch"),
        ([*BENCH, "--mask-distance", "0.06"], "--mask-distance"),
        ([*BENCH, "--mask-pitch", "7e-6"], "--mask-pitch"),
        ([*BENCH, "--mask-scale", "1"], "--mask-scale"),
        ([*BENCH, "--mask-distance", "1e-4", "--shear", "1"], "--shear"),
        ([*BENCH, "--shear", "1,2"], "--shear"),
        (["--mask-distance", "1e-4"], "--aperture-distance"),
    ],
)
def test_an_impossible_bench_is_one_line(tmp_path, capsys, options, named):
    out = tmp_path / "snapshot.nc"
    assert refused(capsys, *SCENE, *options, "--out", out).startswith(f"tmca: {named}: ")
    assert not list(tmp_path.iterdir())
