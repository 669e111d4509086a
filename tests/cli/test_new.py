"""``tmca new``: every template is written, keeps to the style of this project, and passes its own test."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import torch

from tests.cli.calls import said
from tests.cli.refusals import refused
from tmca.applications import APPLICATIONS
from tmca.cameras import CAMERAS, Snapshot, SpectralCamera
from tmca.cli.new import names_of, rendered
from tmca.data.formats.stored import OPENERS
from tmca.decoders import DECODERS
from tmca.lab.display import device_named, export_codes, read_planes

PARTS = ("camera", "decoder", "format", "driver")


@pytest.fixture
def clean(monkeypatch):
    """What a template registers, and its modules, are gone after a test."""
    for known in (CAMERAS, APPLICATIONS, DECODERS, OPENERS):
        for name in ("my-camera", "my-decoder", ".my-format"):
            monkeypatch.setitem(known, name, None)
            monkeypatch.delitem(known, name)
    before = {*sys.modules}
    yield
    for name in {*sys.modules} - before:
        if "my_" in name:
            del sys.modules[name]


@pytest.mark.slow
@pytest.mark.parametrize("part", PARTS)
def test_a_template_passes_its_own_test(part, tmp_path, capsys, clean):
    told = said(capsys, "new", part, f"my-{part}", "--out", tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == {f"my_{part}.py", f"test_my_{part}.py"}
    assert f"python -m pytest {tmp_path / f'test_my_{part}.py'}" in told
    entry = tomllib.loads("\n".join(line for line in told.splitlines() if line.startswith("  ")))
    assert [*entry["project"]["entry-points"]] == [{"driver": "tmca.devices"}.get(part, f"tmca.{part}s")]
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    plain = ["-q", "-s", "-p", "no:cacheprovider", "-p", "no:xdist", "-c", str(tmp_path / "pytest.ini")]
    assert pytest.main([*plain, str(tmp_path)]) == pytest.ExitCode.OK, capsys.readouterr().out[-3000:]


@pytest.mark.parametrize("part", PARTS)
def test_a_template_keeps_to_the_style_of_the_project(part, tmp_path):
    for file, text in rendered(part, names_of(f"my-{part}")).items():
        (tmp_path / file).write_text(text)
    settings = ["--no-cache", "--config", str(Path(__file__).parents[2] / "pyproject.toml"), "."]
    for command in (["check", "--ignore", "I,S"], ["format", "--check"]):
        ruff = [sys.executable, "-m", "ruff", *command, *settings]
        done = subprocess.run(ruff, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(("text", "names"), [
    ("my-camera", ("my-camera", "my_camera", "MyCamera", "my camera")),
    ("MyCamera2", ("my-camera2", "my_camera2", "MyCamera2", "my camera2")),
    ("my_camera", ("my-camera", "my_camera", "MyCamera", "my camera")),
])  # fmt: skip
def test_a_name_is_made_of_words(text, names):
    assert names_of(text) == names


@pytest.mark.parametrize(("words", "said"), [
    (("camera", "2nd"), "NAME: found '2nd', expected letters and digits"),
    (("camera", "../x"), "NAME: found '../x'"),
    (("decoder", "lambda"), "a name that Python or a package has"),
    (("decoder", "json"), "a name that Python or a package has"),
    (("decoder", "torch"), "a name that Python or a package has"),
    (("camera", "light-field"), "light-field, a camera that there is"),
    (("decoder", "lmmse"), "lmmse, a decoder that there is"),
    (("driver", "folder"), "folder, a driver that there is"),
    (("format", "npy"), "npy, a format that there is"),
    (("camera", "band-camera"), "whose class BandCamera is used already"),
    (("lens", "mine"), "lens"),
])  # fmt: skip
def test_what_is_no_name_or_taken_is_refused_and_nothing_is_written(words, said, tmp_path, capsys):
    assert said in refused(capsys, "new", *words, "--out", tmp_path)
    assert [*tmp_path.iterdir()] == []


def test_nothing_is_replaced_unless_asked_for(tmp_path, capsys):
    (tmp_path / "test_mine.py").write_text("mine")
    assert "test_mine.py: found an existing output" in refused(capsys, "new", "decoder", "mine", "--out", tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["test_mine.py"]
    said(capsys, "new", "decoder", "mine", "--out", tmp_path, "--overwrite")
    assert (tmp_path / "test_mine.py").read_text() == rendered("decoder", names_of("mine"))["test_mine.py"]
    assert 'mine = "none.mine:Mine"' in said(capsys, "new", "decoder", "mine", "--out", tmp_path / "none")


def test_nothing_of_a_template_is_registered_by_writing_it(tmp_path, capsys):
    before = set(CAMERAS)
    said(capsys, "new", "camera", "weighted", "--out", tmp_path)
    assert set(CAMERAS) == before


def test_a_driver_is_tried_by_its_file_and_its_settings_are_named(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    camera = SpectralCamera(bands=3, size=(12, 16), slots=2, aperture="open")
    Snapshot(camera(torch.rand(1, 3, 12, 16)), camera).save("s.nc")
    export_codes(read_planes("s.nc"), [device_named("emulated-shutter")], "ex")
    said(capsys, "new", "driver", "my-bench")
    command = ["capture", "ex", "--like", "s.nc", "--device", "my_bench.py:MyBench"]
    for setting, words in {
        "port=abc": "--set port: found 'abc', expected a whole number; my_bench.py:MyBench has port (a whole number, 0",
        "prot=1": "--set prot: found a setting that this device does not have, expected one of port; did you mean port",
    }.items():
        assert words in refused(capsys, *command, "--set", setting)
    assert "no class Bench in my_bench.py" in refused(capsys, *command[:-1], "my_bench.py:Bench")
    assert not Path("captures").exists()
    assert "captures.nc" in said(capsys, *command, "--set", "port=3")
    assert Snapshot.load("captures.nc").values.shape == (1, *camera.snapshot_shape)


@pytest.mark.parametrize("part", PARTS)
def test_paths_with_spaces_are_quoted_for_the_shell(part, tmp_path, capsys):
    folder = tmp_path / "my parts"
    folder.mkdir()
    told = said(capsys, "new", part, f"my-{part}", "--out", folder)
    assert f"python -m pytest '{folder / f'test_my_{part}.py'}'" in told
    moved = part in ("camera", "format")
    assert (f"cd '{folder}' && " if moved else f" '{folder / f'my_{part}.py'}:") in told
