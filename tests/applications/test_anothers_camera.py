"""A camera of another package, as `tmca new camera` writes it: what it lacks is one line, and its scenes are cubes."""

import json
import re
import sys

import pytest
import torch

import tmca
from tests.cli.calls import answer
from tests.cli.refusals import refused
from tests.plugin_packages import install
from tmca.applications import APPLICATIONS, Application, application_of
from tmca.cameras import CAMERAS, BandCamera, SpectralCamera
from tmca.cli import main
from tmca.cli.decoders import table
from tmca.cli.new import names_of, rendered
from tmca.decoders import decoders_for, make_decoder
from tmca.errors import SettingError, ShapeError
from tmca.plugins import load_plugins
from tmca.testing import check_camera

SOURCE = rendered("camera", names_of("weighted"))["weighted.py"]


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Installs the camera as pip does, from some source; it is imported once somebody asks for it."""
    monkeypatch.chdir(tmp_path)
    yield lambda source=SOURCE: install(tmp_path, monkeypatch, "tmca.cameras", "weighted", source)
    CAMERAS.pop("weighted", None)
    APPLICATIONS.pop("weighted", None)
    sys.modules.pop("weighted", None)
    monkeypatch.undo()
    load_plugins.cache_clear()


def made(**how):
    application_of("weighted")
    return CAMERAS["weighted"](**{"bands": 3, "size": (5, 7), "slots": 2, **how})


class Plain(Application):
    """Says only what has to be said."""

    kind = "plain"
    parts = fitted = tensors = metrics = lambda self, *given: {}


class Views(type(APPLICATIONS["light-field"])):
    """Another camera of light fields."""

    kind = "views"


@pytest.mark.parametrize(("application", "dims"), [
    (Plain(), ("wavelength", "y", "x")), (Views(), ("view_v", "view_u", "y", "x")),
    (APPLICATIONS["light-field"], ("view_v", "view_u", "y", "x")),
])  # fmt: skip
def test_a_scene_is_read_as_what_it_is_or_as_the_camera_that_is_extended_reads_it(application, dims):
    assert application.read("coffee", size=(16, 16)).dims == dims


def test_a_cube_file_is_read_as_a_cube(tmp_path):
    tmca.read("coffee", bands=3, size=(16, 16)).to_dataset(name="radiance").to_netcdf(tmp_path / "c.nc")
    assert Plain().read(tmp_path / "c.nc").sizes == {"wavelength": 3, "y": 16, "x": 16}


for kind in ("plain", "views"):
    APPLICATIONS.pop(kind)


def test_the_command_line_takes_it(installed, capsys):
    installed()
    told = answer(capsys, "simulate", "weighted", "coffee", "--crop", "16x16", "--out", "s.nc")
    assert told["files"] == ["s.nc", "s.png", "s_weights.png"]
    assert answer(capsys, "reconstruct", "s.nc", "-d", "dagger", "--truth", "coffee", "--out", "e.nc")["metrics"]


def test_the_list_of_decoders_says_which_decode_it(installed, capsys):
    installed()
    main(["decoders", "--json"])
    rows = {row["name"]: row["cameras"] for row in json.loads(capsys.readouterr().out)}
    assert {name for name, cameras in rows.items() if "weighted" in cameras} == {"dagger", "admm-tv"}
    assert not any("weighted" in row["cameras"] for row in table(plugins=False))


@pytest.mark.parametrize(("old", "new", "said"), [
    ("(self.code * scene).sum", "(self.code / 0 * none).sum", r"weighted\.py: found NameError: .*none.* \(line 25\)"),
    ("(self.code * scene).sum(1, keepdim=True)", "(self.code * scene).sum(1)", "A of the operator of Weighted: found"),
    ("def throughput", "def put_through", "found Weighted of weighted without throughput, .* define throughput"),
    ('"weighted", ("weights',  '"other", ("weights', "found 'weighted', which has no application, expected both"),
    ("def A_adjoint", "def A_transposed", r"weighted\.py: found TypeError: .*A_adjoint.* \(line \d+\)"),
])  # fmt: skip
def test_what_is_wrong_with_its_code_is_one_line(installed, capsys, old, new, said):
    assert old in SOURCE
    installed(SOURCE.replace(old, new))
    shown = refused(capsys, "simulate", "weighted", "coffee", "--crop", "16x16")
    assert re.search(said, shown.replace("\n", " ")), shown
    APPLICATIONS.pop("other", None)


@pytest.mark.parametrize("lacks", ["bands", "lenses"])
def test_a_part_that_a_property_lacks_is_named(installed, lacks):
    source = SOURCE.replace("        self._hold_bands(12 if bands is None else bands)\n", "")
    if lacks == "lenses":
        source = SOURCE.replace("return (1, *self.size)", "return (self.lenses.count, *self.size)")
    installed(source)
    said = rf"Weighted\.(scene|snapshot)_shape: found 'Weighted' object has no attribute '{lacks}'"
    with pytest.raises(SettingError, match=said) as refusal:
        _ = made().snapshot_shape
    assert "\n" not in str(refusal.value)


def test_what_there_is_not_is_still_told_by_torch():
    camera = SpectralCamera(bands=3, size=(8, 8), slots=2)
    assert not hasattr(camera, "nonsense")
    with pytest.raises(AttributeError, match="'SpectralCamera' object has no attribute 'nonsense'"):
        _ = camera.nonsense


def test_a_decoder_that_needs_taps_says_so_and_which_works(installed):
    installed(SOURCE.replace('{"dagger", "admm-tv"}', '{"dagger", "admm-tv", "lmmse", "tikhonov"}'))
    camera = made()
    assert set(decoders_for("weighted")) == {"dagger", "admm-tv"}
    said = r"decoder: found 'lmmse', which needs camera\.taps\(\), .*weighted camera.*expected one of .*dagger"
    for call in (
        lambda: make_decoder("lmmse", "weighted"),
        lambda: tmca.reconstruct(tmca.simulate(torch.rand(3, 5, 7), camera), "lmmse"),
        lambda: make_decoder("lmmse", "spectral").prepare(camera),
    ):
        with pytest.raises(SettingError, match=said):
            call()
    with pytest.raises(AssertionError, match=r"Weighted: decoders that it names are there: .*camera\.taps"):
        check_camera(camera)


def test_a_camera_with_taps_is_decoded_by_those_that_need_them(installed):
    source = SOURCE.replace('{"dagger", "admm-tv"}', '{"dagger", "tikhonov"}')
    taps = """
    def taps(self):
        from tmca.operators import Taps

        code = self.weights.mean(0)
        return Taps(code, tuple(range(self.bands)), (0,) * self.bands, self.bands, self.size[1])


class WeightedApplication"""
    installed(source.replace("\n\nclass WeightedApplication", taps))
    camera = made()
    scene = torch.rand(1, 3, 5, 7)
    torch.testing.assert_close(tmca.operators.TapOperator(camera.taps()).A(scene), camera.A(scene))
    assert set(decoders_for("weighted")) == {"dagger", "tikhonov"}
    assert tmca.reconstruct(tmca.simulate(scene[0], camera), "tikhonov").values.shape == (1, 3, 5, 7)


@pytest.mark.parametrize("shape", [(2, 3, 5, 7), (1, 2, 5, 7), (1, 1, 6, 7)])
def test_a_snapshot_of_other_channels_has_no_adjoint(installed, shape):
    installed()
    if shape[1] == 3:
        shape = (2, 1, 5, 8)
    with pytest.raises(ShapeError, match=r"snapshot: found shape \(.*expected \(batch, 1, 5, 7\)"):
        made().A_adjoint(torch.ones(shape))


@pytest.mark.parametrize(("old", "new", "said"), [
    ("return self.code * snapshot", "return 1.1 * self.code * snapshot", "the adjoint is the transpose.*⟨A x, y⟩ is"),
    ("return float(self.bands)", "return 0.01", "a white one stays below full scale: a white scene gives"),
    ('{"weights": weights, "slots"', '{"weights": 0.5 * weights, "slots"', "it comes back from its file: exact of"),
    ('"bands": bands, "size"', '"sise"', "it comes back from its file: "),
    ("self.weights.sum(0)", "torch.rand(self.scene_shape)", "same camera|taken one by one|transpose|replace"),
])  # fmt: skip
def test_the_checks_find_what_is_wrong_with_a_camera(installed, old, new, said):
    assert old in SOURCE
    installed(SOURCE.replace(old, new))
    with pytest.raises(AssertionError, match=f"Weighted: .*{said}") as failed:
        check_camera(made())
    assert "\n" not in str(failed.value)


def test_its_base_is_exported():
    assert issubclass(SpectralCamera, BandCamera)
    assert "BandCamera" in tmca.cameras.__all__
