"""`tmca export` and `tmca capture` as a user meets them."""

import json
import shutil
from pathlib import Path

import pytest
import torch

from tests.cli.refusals import refused
from tmca.cameras import Snapshot
from tmca.cli import main
from tmca.codes import write_codes
from tmca.lab.display.manifest import read_export

SMALL = ["coffee", "--crop", "24x28", "--slots", "2", "--bands", "3", "--no-figures", "--out", "sim.nc"]
EXPORT = ["export", "sim.nc", "--device", "dli4120", "--device", "emulated-shutter", "--no-figures"]


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """A snapshot, and its codes for two devices."""
    folder = tmp_path_factory.mktemp("exported")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        main(["simulate", "spectral", *SMALL])
        main([*EXPORT, "--out", "ex"])
    return folder


@pytest.fixture(autouse=True)
def sim(exported, tmp_path):
    shutil.copy(exported / "sim.nc", tmp_path)


@pytest.fixture
def ex(sim, exported, tmp_path):
    shutil.copytree(exported / "ex", tmp_path / "ex")


def test_the_exposure_that_codes_were_designed_for_goes_along(capsys):
    planes = torch.ones(2, 4, 4), torch.ones(2, 4, 4)
    for name, notes in {"mine": {"sensor": {"exposure": 0.02, "bits": 12}}, "other": {}}.items():
        write_codes(f"{name}.nc", *planes, (4, 4), notes)
    command = ["export", "{}.nc", "--device", "emulated-shutter", "--sensor-size", "24x28", "--no-figures", "--out"]
    said = {}
    for out, name, more in (("a", "mine", []), ("b", "mine", ["--exposure", "0.3"]), ("c", "other", [])):
        main([one.format(name) for one in command] + [out, *more])
        said[out] = (capsys.readouterr().out, json.loads(Path(out, "manifest.json").read_text())["exposure_s"])
    assert [seconds for _, seconds in said.values()] == [0.02, 0.3, 0.1]
    assert "10 ms (those of the design)" in said["a"][0]
    assert "150 ms, from" in said["b"][0]
    assert "50 ms (the default of --exposure)" in said["c"][0]


def test_codes_go_to_devices_and_a_capture_comes_back(tmp_path, capsys):
    main([*EXPORT, "--macro-pixel", "2", "--mounting-angle", "45", "--out", "ex"])
    main(["export", "check", "ex"])
    capsys.readouterr()
    main(["capture", "ex", "--scene", "coffee", "--out", "frames", "--json"])
    said = json.loads(capsys.readouterr().out)
    captured, simulated = Snapshot.load(said["snapshot"]), Snapshot.load("sim.nc")
    step = 3 / (65535 - 256)
    torch.testing.assert_close(captured.values, simulated.values, atol=1.01 * step, rtol=0)
    assert captured.notes["device"] == "dli4120, emulated-shutter"


def own_codes(period):
    """The file mine.nc of the page about devices, with its period or without."""
    page = (Path(__file__).parents[2] / "docs" / "devices.md").read_text()
    (recipe,) = (block for block in page.split("```python")[1:] if "mine.nc" in block)
    exec(recipe.partition("```")[0].replace('{"period": [8, 8]}', repr({"period": [8, 8]} if period else {})), {})


def same_codes(*folders):
    one, other = (read_export(folder).planes for folder in folders)
    return all(torch.equal(one[name], other[name]) for name in ("aperture", "shutter"))


def test_codes_of_ones_own_fill_a_device_and_a_small_snapshot_is_their_camera(capsys):
    own_codes(period=True)
    simulated = ["simulate", "spectral", "coffee", "--crop", "16x16", "--bands", "3", "--codes", "mine.nc"]
    main([*simulated, "--no-figures", "--out", "small.nc"])
    Path("dmd.yaml").write_text("{name: mirrors, kind: dmd, size: [48, 100], macro_pixel: 2}")
    to = ["--device", "dmd.yaml", "--device", "coded-exposure", "--no-figures", "--code-size", "24x40"]
    main(["export", "small.nc", *to, "--out", "large"])
    main(["export", "mine.nc", *to, "--sensor-size", "24x42", "--out", "alone"])
    said = capsys.readouterr()
    assert "24×40 code pixels on 48×100 pixels of mirrors, 80% of them; 1 code pixel = 2×2 mirrors" in said.out
    assert "warning" not in said.err
    assert same_codes("large", "alone")
    main(["capture", "alone", "--scene", "coffee", "--out", "frames", "--like", "small.nc"])
    assert Snapshot.load("frames.nc").camera.size == (24, 40)
    capsys.readouterr()
    remedy = "write one: tmca simulate spectral SCENE --codes"
    assert remedy in refused(capsys, "capture", "alone", "--scene", "coffee", "--out", "f")


@pytest.mark.filterwarnings("default::tmca.cameras.CodesWarning")
def test_codes_that_fill_little_of_a_device_may_be_a_tile_that_does_not_say_so(capsys):
    own_codes(period=False)
    main(["export", "mine.nc", "--device", "dli4120", "--no-figures", "--out", "ex"])
    said = capsys.readouterr().err
    assert "mine.nc: 8×8 code pixels fill 0.00814% of dli4120; a tile that repeats needs the attribute period" in said
    simulated = ["simulate", "spectral", "coffee", "--codes", "mine.nc", "--period", "8"]
    assert "write the attribute period" in refused(capsys, *simulated)


def test_a_snapshot_whose_codes_fill_little_of_a_device_is_told_the_options_that_fill_more(capsys, sim):
    main(["export", "sim.nc", "--device", "dli4120", "--no-figures", "--out", "little"])
    little = capsys.readouterr().err
    assert "% of dli4120: a larger --macro-pixel fills more, or of codes that repeat a larger --code-size" in little
    main(["export", "sim.nc", "--device", "dli4120", "--macro-pixel", "20", "--no-figures", "--out", "much"])
    assert capsys.readouterr().err == ""


def test_a_capture_that_was_stopped_goes_on(capsys, tmp_path, ex):
    said = refused(capsys, "capture", "ex", "--scene", "coffee", "--out", "f", "--stops-after", "2", lines=None)
    assert "no answer after 2 frames" in said
    assert (tmp_path / "f" / "slot_000.tif").exists()
    main(["capture", "ex", "--scene", "coffee", "--out", "f"])
    assert (tmp_path / "f.nc").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["export", "sim.nc", "--device", "laser"], "dli4120"),
        (["export", "sim.nc", "--device", "dli4120", "--macro-pixel", "99"], "macro-pixel"),
        (["export", "sim.nc", "--device", "pluto-2.1", "--lut", "none.csv"], "none.csv"),
        (["export", "sim.nc", "--device", "dli4120", "--macro-pixel", "nan"], "--macro-pixel: found nan"),
        (["export", "sim.nc", "--device", "dli4120", "--mounting-angle", "inf"], "--mounting-angle: found inf"),
        (["export", "sim.nc", "--device", "dli4120", "--lut", "sim.nc"], "--lut: found one of a dmd"),
        (["export", "sim.nc", "--device", "dli4120", "--code-size=-3x4"], "--code-size: found -3x4"),
        (["export", "sim.nc", "--device", "dli4120", "--offset", "600x0"], "--offset: found"),
        (["capture", "sim.nc", "--scene", "coffee"], "folder of an export"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_one_line(capsys, arguments, words):
    assert words in refused(capsys, *arguments)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "--scene"), (["--scene", "coffee", "--set", "a=1"], "simulated bench"),
        (["--device", "laser"], "simulated"), (["--scene", "coffee", "--timeout", "3"], "options of its own"),
        (["--scene", "coffee", "--snapshot", "sim.nc"], "--overwrite"), (["--scene", "coffee", "--bits", "40"], "bits"),
        (["--device", "folder"], "--set path: found none"),
        (["--device", "mine", "--bits", "10"], "--bits: found 10, expected none before mine"),
        (["--device", "folder", "--set", "path=ex", "--set", "foo=1"], "--set foo: found a setting"),
        (["--scene", "coffee", "--hardware", "motion=100"], "motion"),
    ],
)  # fmt: skip
def test_benches_that_cannot_be_are_one_line(capsys, tmp_path, options, words, ex):
    assert words in refused(capsys, "capture", "ex", *options)
    assert not (tmp_path / "captures").exists()


def test_a_driver_gets_what_follows_the_first_sign_of_equality(monkeypatch, ex):
    from tests.lab.acquisition.test_drivers import Lamp
    from tmca.lab.acquisition import drivers as protocol

    given = {}

    def lamp(**settings):
        given.update(settings)
        return Lamp(900)

    point = type("Point", (), {"name": "lamp", "load": staticmethod(lambda: lamp)})
    monkeypatch.setattr(protocol, "entry_points", lambda group: [point])
    with pytest.raises(SystemExit):  # its frames are of another size
        main(["capture", "ex", "--device", "lamp", "--set", "roi=0,0,640,480", "--set", "key=a=b", "--set", "name=abc"])
    assert given == {"roi": "0,0,640,480", "key": "a=b", "name": "abc"}


def test_patterns_beyond_open_are_named_with_their_file(capsys, tmp_path):
    from scipy.io import savemat

    savemat("shutter.mat", {"S": 255.0 * (torch.rand(24, 30, 2) > 0.5).double().numpy()})
    said = refused(capsys, "simulate", "spectral", *SMALL[:-1], "b.nc", "--shutter", "shutter.mat")
    assert "--shutter shutter.mat: found values from 0 to 255, expected 0 = closed to 1 = open" in said


@pytest.mark.slow
def test_the_camera_of_an_export_is_found_from_another_folder_and_said_to_be_gone(capsys, tmp_path, monkeypatch):
    main([*EXPORT, "--out", "ex"])
    (tmp_path / "other").mkdir()
    monkeypatch.chdir(tmp_path / "other")
    main(["capture", "../ex", "--scene", "coffee", "--out", "f"])
    assert (tmp_path / "other" / "f.nc").exists()
    (tmp_path / "sim.nc").rename(tmp_path / "moved.nc")
    capsys.readouterr()
    assert "sim.nc, which is not found" in refused(capsys, "capture", "../ex", "--scene", "coffee", "--out", "g")
    main(["capture", "../ex", "--scene", "coffee", "--out", "g", "--like", "../moved.nc"])


def test_the_folder_of_a_design_stands_for_its_codes(tmp_path):
    from tmca.codes import write_codes

    (tmp_path / "design").mkdir()
    write_codes("design/codes.nc", torch.ones(2, 24, 28), torch.ones(2, 24, 30), None)
    main(["export", "design", "--device", "dli4120", "--macro-pixel", "16", "--no-figures", "--out", "ex"])
    assert json.loads((tmp_path / "ex" / "manifest.json").read_text())["slots"] == 2


def test_codes_alone_do_not_say_which_camera_they_are_of(capsys, tmp_path):
    from tmca.codes import write_codes

    write_codes("codes.nc", torch.ones(2, 24, 28), torch.ones(2, 24, 30), None)
    main(["export", "codes.nc", "--device", "dli4120", "--macro-pixel", "16", "--no-figures", "--out", "ex"])
    assert "--like" in refused(capsys, "capture", "ex", "--scene", "coffee")
