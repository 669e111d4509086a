"""How light fields are read: in every command, the same from snapshot to truth, and each in its own way where several
namings and lens grids come together."""

import json

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter

from tests.cli.calls import answer, run
from tests.cli.refusals import refused
from tests.data.light_field_files import write_folder
from tmca.cli import main
from tmca.data import write_dataset
from tmca.data.light_field_scenes import Reading, load_light_field

TAKE = ["--views", "3", "--slots", "2", "--period", "6", "--no-figures", "--out", "s.nc"]
NAMES = ["--pattern", "r{row}c{column}end.png"]


def smooth_views(side=3, size=(48, 56)):
    values = gaussian_filter(np.random.default_rng(0).random((side, side, *size, 3)), (0, 0, 2, 2, 0))
    values -= values.min()
    return np.rint(255 * values / values.max()).astype(np.uint8)


@pytest.fixture
def place(tmp_path):
    """The same views in a folder of known names, in one of unknown names, and as a lenslet picture."""
    views = smooth_views()
    write_folder(tmp_path / "plain", views, "{}_{}.png".format)
    write_folder(tmp_path / "odd", views, "r{}c{}end.png".format)
    Image.fromarray(views[..., 0].transpose(2, 0, 3, 1).reshape(144, 168)).save("lens.png")
    return tmp_path


def decoded(capsys, *arguments):
    """Its PSNR, and what is said beside it."""
    how = ("-d", "dagger", "--no-figures", "--overwrite", "--out", "e.nc", "--json")
    printed = run(capsys, "reconstruct", "s.nc", *how, *arguments)
    return json.loads(printed.out)["metrics"]["psnr"], printed.err


def test_the_truth_is_averaged_as_the_scene_of_the_snapshot_was(place, capsys):
    main(["simulate", "light-field", "plain", "--scale", "2", *TAKE])
    known, err = decoded(capsys, "--truth", "plain")
    assert err == ""
    assert known == pytest.approx(decoded(capsys, "--truth", "plain", "--scale", 2)[0])
    assert answer(capsys, "evaluate", "e.nc", "plain")["psnr"] == pytest.approx(known, abs=1e-4)
    for command in (["reconstruct", "s.nc", "-d", "dagger", "--out", "f.nc", "--truth"], ["evaluate", "e.nc"]):
        line = refused(capsys, *command, "plain", "--scale", "1")
        assert "--scale: found 1, expected 2, as the snapshot's scene was read" in line
    line = refused(capsys, "reconstruct", "s.nc", "--weights", "default", "--out", "f.nc")
    assert "--weights: found 5×5 views, expected the camera's 3×3" in line


@pytest.mark.filterwarnings("default::tmca.data.scene_names.SceneWarning")
def test_another_truth_is_read_at_the_scale_of_the_snapshot_and_that_is_said(place, capsys):
    main(["simulate", "light-field", "plain", "--scale", "2", *TAKE])
    known, _ = decoded(capsys, "--truth", "plain")
    write_folder(place / "copy", smooth_views(), "view_{}_{}.png".format)
    found, err = decoded(capsys, "--truth", "copy")
    assert found == pytest.approx(known)
    assert "copy is beside a snapshot of plain" in err
    write_dataset(load_light_field("plain", views=3, scale=2), place / "reduced.nc")
    line = refused(capsys, "evaluate", "e.nc", "reduced.nc", "--scale", "2", lines=2)
    assert "reduced.nc: found 24×28" in line
    assert answer(capsys, "evaluate", "e.nc", "reduced.nc", "--scale", "1")["psnr"] == pytest.approx(known, abs=1e-4)


def test_a_grid_without_a_centre_view_is_told(tmp_path, capsys):
    write_folder(tmp_path / "even", smooth_views(4), "{}_{}.png".format)
    main(["simulate", "light-field", "even", *TAKE])
    assert "even: 4×4 views have no centre one; taken are rows 1 to 3 and columns 1 to 3" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "reading"), [("odd", NAMES), ("lens.png", ["--lens", "3x3"])])
def test_an_unknown_naming_or_lens_grid_is_read_everywhere(place, capsys, scene, reading):
    assert scene != "odd" or "--pattern" in refused(capsys, "inspect", "odd")
    assert scene != "odd" or "--pattern" in refused(capsys, "simulate", "light-field", "odd")
    about = answer(capsys, "inspect", scene, *reading, "--figure", "scene.png")
    assert about["light_field"]["views"] == [3, 3]
    assert (place / "scene.png").exists()
    main(["simulate", "light-field", scene, *reading, *TAKE])
    known, _ = decoded(capsys, "--truth", scene)
    assert known == decoded(capsys, "--truth", scene, *reading)[0]
    assert answer(capsys, "evaluate", "e.nc", scene, *reading)["psnr"] == pytest.approx(known, abs=1e-4)
    main(["prior", "learn-views", scene, "--views", "3", "--out", "p.nc", *reading])
    assert (place / "p.nc").exists()


SWEEP = ["sweep", "light-field", "--vary", "noise=0", "--decoder", "dagger", "--views", "3", "--set", "period=6"]
DESIGN = ["--views", "3", "--slots", "2", "--period", "6", "--kinds", "one-hot", "--read-noise", "0.02"]
TINY = """
camera: {views: 3, size: [24, 24], slots: 2, period: 8}
decoder: {kind: spatial-angular, stages: 1, width: 4, blocks: 1, start: dagger}
data: {patch: 16, batch: 1}
checkpoint_every: 1
"""


def psnr(capsys, *arguments):
    return answer(capsys, *SWEEP, *arguments, "--overwrite")["rows"][0]["psnr"]


def test_each_light_field_takes_what_applies_to_it(place):
    reading = Reading(scale=2, pattern=NAMES[1], lens=(3, 3))
    assert reading.of("odd") == {"scale": 2, "pattern": NAMES[1]}
    assert reading.of("plain") == {"scale": 2}
    assert reading.of("lens.png") == {"scale": 2, "lens": (3, 3)}
    assert reading.of("coffee") == {}
    assert Reading(**json.loads(json.dumps(vars(reading)))) == reading
    main(["prior", "learn-views", "odd", "lens.png", "--views", "3", "--out", "p.nc", *NAMES, "--lens", "3x3"])
    assert (place / "p.nc").exists()


def test_a_sweep_reads_any_naming_and_keeps_readings_apart(place, capsys):
    known = psnr(capsys, "plain")
    assert psnr(capsys, "odd", *NAMES) == pytest.approx(known)
    cells = len(list((place / "runs" / "sweep-light-field").glob("*.json")))
    upside = psnr(capsys, "odd", "--pattern", "r{-row}c{column}end.png")
    assert abs(upside - known) > 1e-3
    assert len(list((place / "runs" / "sweep-light-field").glob("*.json"))) == cells + 1
    assert np.isfinite(psnr(capsys, "lens.png", "odd", *NAMES, "--lens", "3x3"))


@pytest.mark.slow
def test_a_run_is_trained_on_any_naming_and_not_resumed_with_another(place, capsys):
    (place / "run.yaml").write_text(TINY)
    command = ["train", "light-field", "--config", "run.yaml", "--train", "odd", "--train", "lens.png", "--lens", "3x3"]
    main([*command, *NAMES, "--steps", "1", "--out", "run"])
    capsys.readouterr()
    assert json.loads((place / "run" / "run.json").read_text())["settings"]["data"]["lens"] == [3, 3]
    line = refused(capsys, *command, "--pattern", "r{-row}c{column}end.png", "--steps", "1", "--out", "run")
    assert "another run (data.pattern = r{row}c{column}end.png, now r{-row}c{column}end.png)" in line
    main([*command, *NAMES, "--steps", "1", "--out", "run"])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["odd"], "--pattern"),
        (["odd", "--pattern", "x{row}_{column}.png"], "--pattern: found x{row}_{column}.png, which applies to none"),
        (["odd", "--pattern", "r0c0end.png"], "{row} and {column}"),
        (["odd", *NAMES, "--lens", "3x3"], "--lens: found 3×3, which applies to none"),
        (["lens.png"], "a multiple of the 14×14 views under a lens"),
        (["lens.png", "--lens", "5x5"], "a multiple of the 5×5 views under a lens"),
        (["lens.png", "--lens", "3"], "--lens"),
        (["coffee", *NAMES], "--pattern: found r{row}c{column}end.png, which applies to none"),
        (["coffee", "--scale", "2"], "scale: found 2, which applies to none"),
    ],
)
def test_readings_that_fit_nothing_are_refused(place, capsys, options, words):
    scene, *how = options
    how = ["--set", "data.scale=2"] if how[:1] == ["--scale"] else how
    for command in (
        ["prior", "learn-views", *options, "--out", "p.nc"],
        ["design", "light-field", *options, *DESIGN],
        ["train", "light-field", "--train", scene, *how, "--out", "run"],
    ):
        assert words in refused(capsys, *command, lines=None)
    assert not (place / "p.nc").exists()
