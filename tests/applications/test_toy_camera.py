"""A fourth camera: one class of a camera and one of its application, and every face of the package takes it."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
import xarray as xr
import yaml

import tmca
from tests.cli.calls import answer, said
from tests.cli.refusals import refused
from tmca.applications import APPLICATIONS, Application
from tmca.applications.demo import Demo, Trial
from tmca.applications.pictures import snapshot_files, snapshot_pictures
from tmca.cameras import CAMERAS, Camera, Snapshot
from tmca.cli import main
from tmca.data.fitting import middle_of
from tmca.data.scenes import load_scene
from tmca.decoders import decoders_for, usual_decoder
from tmca.errors import SettingError
from tmca.operators import LinearOperator
from tmca.plots.style import image_figure
from tmca.plugins import load_plugins

SIZE = (14, 17)


class Masks(LinearOperator):
    """One number for each mask: the light that it lets through, of all pixels together; ten in a row."""

    def __init__(self, masks):
        super().__init__()
        self.masks, self.pixels = masks, masks[0].numel()
        self.scene_shape, self.snapshot_shape = (1, *masks.shape[1:]), (1, len(masks) // 10, 10)

    def A(self, scene):
        return torch.einsum("khw,bchw->bck", self.masks, scene).unflatten(-1, (-1, 10)) / self.pixels

    def A_adjoint(self, snapshot):
        return torch.einsum("khw,bck->bchw", self.masks, snapshot.flatten(2)) / self.pixels


class SinglePixelCamera(Camera):
    """K random masks, one after the other, in front of a sensor of one pixel."""

    kind, channel = "single-pixel", "image"
    decoders = frozenset({"dagger", "admm-tv"})
    needed = ("masks",)
    white, channel_names = 1.0, ["image"]

    def __init__(self, size=None, slots=160, *, masks=None, exposure="equal", sensor=None):
        super().__init__(size or (32, 32), slots, exposure, sensor)
        drawn = torch.rand(slots, *self.size, generator=torch.Generator().manual_seed(0)) < 0.5
        self.register_buffer("masks", drawn.float() if masks is None else masks)

    @property
    def scene_shape(self):
        return (1, *self.size)

    @property
    def snapshot_shape(self):
        return (1, self.slots // 10, 10)

    def throughput(self):
        return float(self.masks.mean())

    def build_operator(self, depth=None):
        return Masks(self.masks)

    def label(self, scenes, name="", unit="relative irradiance"):
        return xr.DataArray(scenes[0, 0].numpy(), dims=("y", "x"), attrs={"long_name": name, "quantity": unit})

    def snapshot_axes(self, snapshots):
        return ("row", "reading")

    def _variables(self, tiled):
        return {"masks": (("slot", "y", "x"), self.masks.numpy())}, {}, {}

    @classmethod
    def _settings(cls, dataset, where):
        masks = torch.from_numpy(dataset["masks"].values)
        return {"masks": masks, "slots": len(masks), "size": tuple(masks.shape[1:])}


class SinglePixelDemo(Demo):
    key, title, scenes = "single_pixel", "One pixel", ("coffee",)

    def scene(self, name, size):
        return middle_of(SinglePixelApplication().read(name), size, name)

    def trials(self, scene):
        return [Trial(f"{slots} masks", f"masks{slots}", SinglePixelCamera(scene.shape, slots)) for slots in (60, 160)]


class SinglePixelApplication(Application):
    """Images (y, x)."""

    kind, codes, demo = "single-pixel", ("masks",), SinglePixelDemo()

    def read(self, source, **reading):
        return load_scene(source, **reading).mean("wavelength", keep_attrs=True)

    def parts(self, scene):
        return {"size": scene.shape}

    def fitted(self, scene, camera, where):
        return middle_of(scene, camera.size, where)

    def tensors(self, scene):
        return (torch.from_numpy(np.array(scene.values))[None, None],)

    def metrics(self, estimate, truth, camera):
        error = estimate["values"].reshape(truth.shape) - truth.values
        return {"psnr": float(-10 * np.log10((error**2).mean()))}

    def code_figures(self, camera):
        return {"masks": image_figure(camera.masks[0].numpy(), "first mask")}


CAMERAS.pop("single-pixel")  # other tests count the cameras of the package
APPLICATIONS.pop("single-pixel")


@pytest.fixture(autouse=True)
def known(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(CAMERAS, "single-pixel", SinglePixelCamera)
    monkeypatch.setitem(APPLICATIONS, "single-pixel", SinglePixelApplication())


@pytest.fixture
def installed(monkeypatch):
    """The camera in another package that is not imported yet: its entry point registers it."""

    class Point:
        name, value = "single-pixel", "my_package.my_camera"

        def load(self):
            monkeypatch.setitem(CAMERAS, "single-pixel", SinglePixelCamera)
            monkeypatch.setitem(APPLICATIONS, "single-pixel", SinglePixelApplication())

    monkeypatch.delitem(CAMERAS, "single-pixel")
    monkeypatch.delitem(APPLICATIONS, "single-pixel")
    monkeypatch.setattr("tmca.plugins.entry_points", lambda group: [Point()] if group == "tmca.cameras" else [])
    load_plugins.cache_clear()
    yield
    load_plugins.cache_clear()


@pytest.fixture
def taken():
    return tmca.simulate("coffee", SinglePixelCamera(SIZE))


def test_its_operator_has_its_adjoint_and_its_masks_are_the_rows():
    camera = SinglePixelCamera((3, 5), 20)
    basis = torch.eye(15).reshape(15, 1, 3, 5)
    torch.testing.assert_close(camera.A(basis).flatten(1).mT, camera.masks.flatten(1) / 15)
    scene, snapshot = torch.rand(1, 1, 3, 5), torch.rand(1, 1, 2, 10)
    torch.testing.assert_close((camera.A(scene) * snapshot).sum(), (camera.A_adjoint(snapshot) * scene).sum())


def test_python_takes_it(taken):
    assert "1×14×17 (images, rows, columns)" in repr(taken.camera)
    assert usual_decoder("single-pixel") == "admm-tv"
    assert set(decoders_for("single-pixel")) == SinglePixelCamera.decoders
    scene = APPLICATIONS["single-pixel"].read("coffee")
    found = {name: tmca.evaluate(tmca.reconstruct(taken, name), scene)["psnr"] for name in SinglePixelCamera.decoders}
    assert min(found.values()) > 20
    torch.testing.assert_close(taken.camera.A(tmca.reconstruct(taken, "dagger").values), taken.values)
    again = Snapshot.load(taken.save("s.nc"))
    torch.testing.assert_close(again.values, taken.values)
    torch.testing.assert_close(again.camera.masks, taken.camera.masks)
    with pytest.raises(SettingError) as refused:
        tmca.reconstruct(taken, "tikhonov")
    assert refused.value.where == "decoder"


def test_the_command_line_takes_its_files(taken, capsys):
    taken.save("s.nc")
    told = answer(capsys, "reconstruct", "s.nc", "-d", "dagger", "--truth", "coffee", "--out", "e.nc")
    assert told["files"] == ["e.nc", "e.png"]
    again = answer(capsys, "evaluate", "e.nc", "coffee", "--figure", "both.png")
    assert again == pytest.approx(told["metrics"], abs=1e-4)
    with pytest.raises(SystemExit) as stop:
        main(["evaluate", "e.nc", "coffee", "--wavelengths", "400:700:31"])
    assert stop.value.code == 2


def test_its_files_bring_it_from_another_package(taken, capsys, request):
    estimate = tmca.reconstruct(taken, "dagger")
    expected = tmca.evaluate(estimate, "coffee")["psnr"]
    estimate.save("e.nc")
    request.getfixturevalue("installed")
    assert answer(capsys, "evaluate", "e.nc", "coffee")["psnr"] == pytest.approx(expected, abs=1e-4)


def test_what_needs_codes_of_planes_refuses_it(taken, capsys):
    taken.save("s.nc")
    assert "single-pixel camera" in refused(capsys, "export", "s.nc", "--device", "dli4120")
    assert "--conditioning" in refused(capsys, "inspect", "s.nc", "--conditioning")


def test_inspect_says_what_its_file_is(taken, capsys):
    taken.save("s.nc")
    main(["inspect", "s.nc"])
    assert capsys.readouterr().out.startswith("s.nc: snapshot of a single-pixel camera (")


def test_its_pictures_lie_beside_its_snapshot(taken, tmp_path):
    target = taken.save(tmp_path / "s.nc")
    assert [target, *snapshot_pictures(taken, target)] == snapshot_files(target, "single-pixel")
    assert (tmp_path / "s_masks.png").exists()


def test_the_demo_shows_a_camera_of_another_package(tmp_path, monkeypatch, installed, capsys):
    for kind in ("spectral", "light-field", "spectral-depth"):
        monkeypatch.setattr(APPLICATIONS[kind], "demo", None)
    command = ("demo", "--size", "14x17", "--jobs", "1", "--out", tmp_path / "demo")
    found = answer(capsys, *command)
    rows = found["single_pixel"]
    assert found["report"] == str(tmp_path / "demo" / "report.html")
    assert [row["code"] for row in rows] == ["60 masks", "160 masks"]
    assert rows[1]["psnr"] > rows[0]["psnr"]
    page = (tmp_path / "demo" / "report.html").read_text()
    assert page.count(";base64,") == 2
    assert "<h2>One pixel</h2>" in page
    assert "demo/report.html: found the report of an earlier demo" in refused(capsys, *command, lines=None)
    monkeypatch.setattr("tmca.applications.demo.run_demo", lambda out, **how: found)
    text = said(capsys, *command)
    assert text.startswith("A single-pixel camera:\n\n| code |")
    assert f"| 160 masks | {rows[1]['psnr']:.2f} |" in text
    (tmp_path / "file").write_text("mine")
    assert "file: found a file, expected a folder" in refused(capsys, "demo", "--out", tmp_path / "file")
    assert (tmp_path / "file").read_text() == "mine"


def test_the_command_line_takes_its_snapshots(capsys):
    told = answer(capsys, "simulate", "single-pixel", "coffee", "--crop", "14x17", "--set", "slots=60", "--out", "s.nc")
    assert (told["camera"], told["slots"]) == ("single-pixel", 60)
    assert told["files"] == ["s.nc", "s.png", "s_masks.png"]
    taken = tmca.simulate("coffee", SinglePixelCamera(SIZE, 60))
    torch.testing.assert_close(Snapshot.load("s.nc").values, taken.values)
    assert "slots=few" in refused(capsys, "simulate", "single-pixel", "coffee", "--set", "slots=few")
    assert "spectral" in refused(capsys, "simulate", "pinhole", "coffee")


def psnr(slots, decoder, seed=0):
    taken = tmca.simulate("coffee", SinglePixelCamera(SIZE, slots, sensor=tmca.Sensor(0.001)), seed=seed)
    scene = middle_of(APPLICATIONS["single-pixel"].read("coffee"), SIZE, "coffee")
    return tmca.evaluate(tmca.reconstruct(taken, decoder), scene)["psnr"]


@pytest.mark.slow
def test_a_study_compares_it(capsys):
    about = {
        "camera": "single-pixel", "scenes": {"test": ["coffee"]}, "reading": {"size": [*SIZE]},
        "codes": {"few": {"camera": {"slots": 60}}, "many": {"camera": {"slots": 160}}},
        "noises": {"some": {"read_noise": 0.001}}, "decoders": ["dagger", "admm-tv"],
    }  # fmt: skip
    Path("mine.yaml").write_text(yaml.safe_dump(about))
    main(["study", "mine.yaml", "--json"])
    rows = {(row["code"], row["decoder"]): row for row in json.loads(capsys.readouterr().out)["rows"]}
    assert set(rows) == {(code, decoder) for code in about["codes"] for decoder in about["decoders"]}
    assert rows["many", "dagger"]["psnr"] == pytest.approx(psnr(160, "dagger"), abs=1e-4)
    assert rows["few", "admm-tv"]["psnr"] == pytest.approx(psnr(60, "admm-tv"), abs=1e-4)
    assert "| many |" in Path("results/mine.md").read_text()


def test_a_sweep_varies_its_settings(capsys):
    main(["sweep", "single-pixel", "coffee", "--vary", "slots=60,160", "--vary", "decoder=dagger,admm-tv",
          "--set", "noise=0.001", "--crop", "14x17", "--json"])  # fmt: skip
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert [(row["slots"], row["decoder"]) for row in rows] == [
        (60, "dagger"), (60, "admm-tv"), (160, "dagger"), (160, "admm-tv"),
    ]  # fmt: skip
    assert rows[2]["psnr"] == pytest.approx(psnr(160, "dagger"), abs=1e-4)
    assert Path("sweep.png").exists()
    assert "masks" in refused(capsys, "sweep", "single-pixel", "coffee", "--vary", "masks=1")
