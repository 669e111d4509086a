"""Light fields of several namings and lens grids together: each is read in its own way, in every command."""

import json

import numpy as np
import pytest
from PIL import Image

from tests.cli.refusals import refused
from tests.cli.test_light_field_reading import smooth_views, write_views
from tmca.cli import main
from tmca.data.light_field_scenes import Reading

NAMES = ["--pattern", "r{row}c{column}end.png"]
SWEEP = ["sweep", "light-field", "--vary", "noise=0", "--decoder", "dagger", "--views", "3", "--set", "period=6"]
DESIGN = ["--views", "3", "--slots", "2", "--period", "6", "--kinds", "one-hot", "--read-noise", "0.02"]
TINY = """
camera: {views: 3, size: [24, 24], slots: 2, period: 8}
decoder: {kind: spatial-angular, stages: 1, width: 4, blocks: 1, start: dagger}
data: {patch: 16, batch: 1}
checkpoint_every: 1
"""


@pytest.fixture
def place(tmp_path):
    """The same views in a folder of known names, in one of unknown names, and as a lenslet picture."""
    write_views(tmp_path / "plain", lambda v, u: f"{v}_{u}.png")
    write_views(tmp_path / "odd", lambda v, u: f"r{v}c{u}end.png")
    Image.fromarray(smooth_views()[..., 0].transpose(2, 0, 3, 1).reshape(144, 168)).save("lens.png")
    return tmp_path


def psnr(capsys, *arguments):
    main([*SWEEP, *arguments, "--overwrite", "--json"])
    return json.loads(capsys.readouterr().out)["rows"][0]["psnr"]


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
