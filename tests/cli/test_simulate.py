"""Options of `tmca simulate`: faults of a bench, in sweeps too, a bench in metres, learned codes."""

import json

import pytest
import torch
import xarray as xr

from tests.cli.calls import answer
from tmca.cameras import Snapshot
from tmca.cli import main
from tmca.decoders import find_weights

SMALL = {
    "spectral": ["coffee", "--crop", "24x28", "--slots", "2", "--bands", "3", "--no-figures"],
    "light-field": ["coffee", "--crop", "24x28", "--slots", "2", "--views", "3", "--no-figures"],
    "spectral-depth": ["coffee", "--crop", "32x32", "--reduce", "4", "--no-figures"],
}


def taken(camera, name, *options):
    main(["simulate", camera, *SMALL[camera], "--out", name, *options])
    return Snapshot.load(name)


@pytest.mark.parametrize("camera", SMALL)
def test_the_file_keeps_the_camera_that_is_known(camera):
    perfect, faulty = taken(camera, "a.nc"), taken(camera, "b.nc", "--hardware", "delay=0.3,leakage=0.05")
    assert not torch.equal(perfect.values, faulty.values)
    for known, same in zip(perfect.camera.codes(), faulty.camera.codes(), strict=True):
        assert torch.equal(known, same)
    assert faulty.notes["hardware"] == "leakage = 0.05, delay = 0.3"
    assert "hardware" not in perfect.notes


@pytest.mark.parametrize("camera", SMALL)
def test_the_noise_and_the_bands_that_are_left_out_are_said(camera, capsys):
    taken(camera, "a.nc")
    silent = capsys.readouterr().out
    assert "; no noise (--full-well, --read-noise)\n" in silent
    assert ("3 of 31 bands (--all-bands for all)" in silent) == (camera == "spectral")
    snapshot = taken(camera, "b.nc", "--read-noise", "0.002")
    assert "; noise: read σ = 0.002\n" in capsys.readouterr().out
    assert "noise: read σ = 0.002\n" in str(snapshot)
    assert str(snapshot).endswith("scene: coffee, 3 of 31 bands") == (camera == "spectral")


@pytest.mark.parametrize("camera", SMALL)
def test_a_sensors_file_is_that_of_a_design_and_options_replace_its_values(tmp_path, camera):
    sheet = "full_well: 5000\nread_noise_electrons: 3\nbits: 12\nexposure: 0.01\npattern_rate: 1000\n"
    (tmp_path / "cam.yaml").write_text(sheet)
    filed = taken(camera, "a.nc", "--sensor", str(tmp_path / "cam.yaml"), "--bits", "10")
    typed = taken(camera, "b.nc", "--full-well", "5000", "--read-noise-electrons", "3", "--bits", "10")
    assert torch.equal(filed.values, typed.values)
    assert filed.camera.sensor.settings() == typed.camera.sensor.settings()


def test_a_scene_whose_bands_are_all_taken_says_nothing_of_them(capsys):
    main(["simulate", "spectral", "coffee", "--crop", "24x28", "--all-bands", "--no-figures", "--out", "a.nc"])
    assert " 31 bands, K" in capsys.readouterr().out
    assert "source_bands" not in Snapshot.load("a.nc").notes


def test_faults_come_from_a_file_too(tmp_path):
    (tmp_path / "bench.yaml").write_text("misregistration: [0.5, -1]\ncontrast_ratio: 40\n")
    one = taken("spectral", "a.nc", "--hardware", "bench.yaml")
    other = taken("spectral", "b.nc", "--hardware", "misregistration=0.5:-1,contrast_ratio=40")
    assert torch.equal(one.values, other.values)


@pytest.mark.parametrize("camera", ["spectral", "light-field"])
def test_a_scene_that_moves_is_a_fault_as_well(camera):
    one, other = taken(camera, "a.nc", "--hardware", "motion=2:1"), taken(camera, "b.nc", "--motion", "2,1")
    assert torch.equal(one.values, other.values)
    assert list(other.notes["motion_pixels"]) == [2.0, 1.0]


@pytest.mark.parametrize("camera", ["spectral", "light-field"])
def test_every_slot_may_see_a_scene_of_its_own(camera):
    alone, alike = taken(camera, "a.nc"), taken(camera, "b.nc", "coffee")
    torch.testing.assert_close(alike.values, alone.values)
    assert not torch.allclose(taken(camera, "c.nc", "chelsea").values, alone.values)


def test_a_sweep_decodes_what_a_faulty_bench_took_with_the_camera_that_is_known(capsys):
    sweep = ("sweep", "spectral", "coffee", "--crop", "24x24", "--bands", "4", "--decoder", "admm-tv", "--out", "s")
    how = ("--set", "slots=2", "--set", "motion=0:0.5", "--vary", "misregistration=0,0:1,1:0,1")
    rows = answer(capsys, *sweep, *how)["rows"]
    assert [row["misregistration"] for row in rows] == [0.0, "0:1", "1:0", 1.0]
    assert len({row["psnr"] for row in rows}) == 4
    assert rows[0]["psnr"] > rows[-1]["psnr"] + 0.5


BENCH = ["--aperture-distance", "0.05", "--aperture-width", "0.012", "--pixel-pitch", "6e-6"]
VIEWS = ["simulate", "light-field", "coffee:1", "--crop", "24x32", "--views", "3", "--slots", "2", "--no-figures"]


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
    main([*VIEWS, *BENCH, *options, "--out", str(out)])
    assert "mm from the sensor" in capsys.readouterr().err
    with xr.open_dataset(out, engine="h5netcdf") as found:
        assert json.loads(found.attrs["shear"]) == pytest.approx([step, step], rel=1e-6)
        assert float(found.attrs["mask_scale"]) == pytest.approx(scale, rel=1e-9)


SCENE = ["coffee", "--crop", "40x48", "--no-figures", "--out", "s.nc"]


@pytest.mark.parametrize(("options", "slots"), [([], 8), (["--slots", "1"], 1)])
def test_default_weights_take_and_decode_a_snapshot(tmp_path, options, slots):
    main(["simulate", "spectral", *SCENE, "--weights", "default", *options, "--read-noise", "0.01"])
    camera = Snapshot.load(tmp_path / "s.nc").camera
    weights = find_weights("default", slots)
    assert camera.slots == slots
    aperture, _ = camera.codes()
    assert (aperture[:, :32, :32] == weights.codes["aperture"]).all()
    main(["reconstruct", "s.nc", "--weights", "default", "--no-figures"])
    assert (tmp_path / "s_network.nc").exists()


def test_behind_shipped_codes_their_network_decodes_unless_something_else_is_asked(tmp_path, capsys):
    main(["simulate", "spectral", *SCENE, "--weights", "default", "--read-noise", "0.01"])
    for options, decoder in (([], "network"), (["--set", "adapt=1"], "network"), (["--no-uncertainty"], "network"),
                             (["--uncertainty"], "network"), (["--set", "fast=true"], "lmmse")):  # fmt: skip
        capsys.readouterr()
        main(["reconstruct", "s.nc", "--no-figures", "--overwrite", *options])
        told = capsys.readouterr().out
        assert f"s_{decoder}.nc" in told
        assert ("it comes with tmca for these codes" in told) == (decoder == "network")
    main(["reconstruct", "s.nc", "--no-figures", "--overwrite", "--decoder", "network"])
    assert "it comes with tmca" not in capsys.readouterr().out


def test_a_light_field_camera_comes_with_tmca(tmp_path, capsys):
    main(["simulate", "light-field", "coffee:1", "--crop", "40x48", "--weights", "default", "--no-figures",
          "--read-noise", "0.01", "--out", "f_snapshot.nc"])  # fmt: skip
    found = {}
    for decoder in ([], ["--decoder", "lmmse"]):
        capsys.readouterr()
        main(["reconstruct", "f_snapshot.nc", "--truth", "coffee:1", "--no-figures", "--json", *decoder])
        said = json.loads(capsys.readouterr().out)
        found[said["decoder"]] = said["metrics"]["psnr"]
    assert found["network"] > found["lmmse"] + 0.3
