"""How a light field is read stays the same from the snapshot to its truth, and can be said in every command."""

import json

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter

from tests.cli.refusals import refused
from tmca.cli import main
from tmca.data import write_dataset
from tmca.data.light_field_scenes import load_light_field

TAKE = ["--views", "3", "--slots", "2", "--period", "6", "--no-figures", "--out", "s.nc"]


def smooth_views(side=3, size=(48, 56)):
    values = gaussian_filter(np.random.default_rng(0).random((side, side, *size, 3)), (0, 0, 2, 2, 0))
    values -= values.min()
    return np.rint(255 * values / values.max()).astype(np.uint8)


def write_views(folder, name, side=3):
    folder.mkdir()
    views = smooth_views(side)
    for v, u in np.ndindex(side, side):
        Image.fromarray(views[v, u]).save(folder / name(v, u))
    return folder


@pytest.fixture
def plain(tmp_path):
    return write_views(tmp_path / "plain", lambda v, u: f"{v}_{u}.png")


def said(capsys, *arguments):
    main([*map(str, arguments), "--json"])
    captured = capsys.readouterr()
    return json.loads(captured.out), captured.err


def decoded(capsys, *arguments):
    return said(
        capsys, "reconstruct", "s.nc", "-d", "dagger", "--no-figures", "--overwrite", "--out", "e.nc", *arguments
    )


def test_the_truth_is_averaged_as_the_scene_of_the_snapshot_was(plain, capsys):
    main(["simulate", "light-field", "plain", "--scale", "2", *TAKE])
    capsys.readouterr()
    found, err = decoded(capsys, "--truth", "plain")
    assert err == ""
    assert found["metrics"]["psnr"] == pytest.approx(
        decoded(capsys, "--truth", "plain", "--scale", 2)[0]["metrics"]["psnr"]
    )
    assert said(capsys, "evaluate", "e.nc", "plain")[0]["psnr"] == pytest.approx(found["metrics"]["psnr"], abs=1e-4)
    for command in (["reconstruct", "s.nc", "-d", "dagger", "--out", "f.nc", "--truth"], ["evaluate", "e.nc"]):
        line = refused(capsys, *command, "plain", "--scale", "1")
        assert "--scale: found 1, expected 2, as the snapshot's scene was read" in line


@pytest.mark.filterwarnings("default::tmca.data.scene_names.SceneWarning")
def test_another_truth_is_read_at_the_scale_of_the_snapshot_and_that_is_said(plain, capsys):
    main(["simulate", "light-field", "plain", "--scale", "2", *TAKE])
    capsys.readouterr()
    known = decoded(capsys, "--truth", "plain")[0]["metrics"]["psnr"]
    other = write_views(plain.with_name("copy"), lambda v, u: f"view_{v}_{u}.png")
    found, err = decoded(capsys, "--truth", other)
    assert found["metrics"]["psnr"] == pytest.approx(known)
    assert "copy is beside a snapshot of plain" in err
    reduced = load_light_field("plain", views=3, scale=2)
    write_dataset(reduced, plain.with_name("reduced.nc"))
    line = refused(capsys, "evaluate", "e.nc", "reduced.nc", "--scale", "2", lines=2)
    assert "reduced.nc: found 24×28" in line
    assert said(capsys, "evaluate", "e.nc", "reduced.nc", "--scale", "1")[0]["psnr"] == pytest.approx(known, abs=1e-4)


def test_a_grid_without_a_centre_view_is_told(tmp_path, capsys):
    write_views(tmp_path / "even", lambda v, u: f"{v}_{u}.png", side=4)
    main(["simulate", "light-field", "even", *TAKE])
    assert "even: 4×4 views have no centre one; taken are rows 1 to 3 and columns 1 to 3" in capsys.readouterr().err


def test_no_weights_come_with_the_package_for_light_fields(plain, capsys):
    main(["simulate", "light-field", "plain", *TAKE])
    capsys.readouterr()
    line = refused(capsys, "reconstruct", "s.nc", "--weights", "default", "--out", "e.nc")
    assert "--weights: found 'default', of which none come with tmca for a light-field camera" in line


@pytest.mark.parametrize("scene", ["odd", "lens.png"])
def test_an_unknown_naming_or_lens_grid_is_read_everywhere(tmp_path, capsys, scene):
    write_views(tmp_path / "odd", lambda v, u: f"r{v}c{u}end.png")
    Image.fromarray(smooth_views()[..., 0].transpose(2, 0, 3, 1).reshape(144, 168)).save("lens.png")
    reading = ["--pattern", "r{row}c{column}end.png"] if scene == "odd" else ["--lens", "3x3"]
    assert scene != "odd" or "--pattern" in refused(capsys, "inspect", "odd")
    assert scene != "odd" or "--pattern" in refused(capsys, "simulate", "light-field", "odd")
    about, _ = said(capsys, "inspect", scene, *reading, "--figure", "scene.png")
    assert about["light_field"]["views"] == [3, 3]
    assert (tmp_path / "scene.png").exists()
    main(["simulate", "light-field", scene, *reading, *TAKE])
    capsys.readouterr()
    known = decoded(capsys, "--truth", scene)[0]["metrics"]["psnr"]
    assert known == decoded(capsys, "--truth", scene, *reading)[0]["metrics"]["psnr"]
    assert said(capsys, "evaluate", "e.nc", scene, *reading)[0]["psnr"] == pytest.approx(known, abs=1e-4)
    main(["prior", "learn-views", scene, "--views", "3", "--out", "p.nc", *reading])
    assert (tmp_path / "p.nc").exists()
