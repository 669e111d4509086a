"""A decoder of ten lines in a package of its own: every command knows it, with no other line written anywhere."""

import json
import re
import sys
from pathlib import Path

import pytest
import torch
from conformance import CHECKS

from tests.plugin_packages import install
from tmca.cameras import CAMERAS, Snapshot, SpectralCamera
from tmca.cli import main
from tmca.cli.new import names_of, rendered
from tmca.decoders import DECODERS, Decoder, decode, decoders_for
from tmca.errors import SettingError
from tmca.plugins import BrokenPlugin, load_plugins

PACKAGE = rendered("decoder", names_of("backprojection"))["backprojection.py"].replace(
    '"backprojection", "backprojection"', '"backprojection", "backprojected"'
)
FROM_MEAN = re.search(r"```python\n# my_package/from_mean.py\n(.*?)```", Path("CONTRIBUTING.md").read_text(), re.S)[1]


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Installs a package of one module; decoders and packages of a test are gone after it."""
    before = dict(DECODERS)
    (tmp_path / "site").mkdir()
    monkeypatch.chdir(tmp_path)
    yield lambda source, *classes: install(
        tmp_path / "site", monkeypatch, "tmca.decoders", "ten_lines", source, classes
    )
    DECODERS.clear()
    DECODERS.update(before)
    sys.modules.pop("ten_lines", None)
    monkeypatch.undo()
    load_plugins.cache_clear()


@pytest.fixture
def plugin(installed):
    installed(PACKAGE)
    return decoders_for("spectral")["backprojection"]


@pytest.mark.parametrize("kind", ["spectral", "light-field"])
def test_it_conforms(plugin, kind):
    for check in CHECKS:
        check(plugin, kind)


def test_a_class_of_ones_own_without_numbers_is_to_be_mended_and_one_of_the_package_set_otherwise(monkeypatch):
    class Unfinished(Decoder):
        def reconstruct(self, prepared, values, progress):
            return torch.full((len(values), *prepared.scene_shape), torch.nan)

    camera = SpectralCamera(bands=3, size=(8, 8), slots=2)
    taken = Snapshot(camera(torch.rand(1, 3, 8, 8)), camera)
    with pytest.raises(SettingError, match=r"NaN or infinite values.*; mend it"):
        decode(taken, Unfinished())
    broken = DECODERS["dagger"]
    monkeypatch.setattr(broken, "reconstruct", Unfinished.reconstruct)
    with pytest.raises(SettingError, match=r"NaN or infinite values.*; change its settings"):
        decode(taken, broken())


@pytest.mark.parametrize(("name", "said"), [("tik.py", "tik.py:Class"), ("tikonov", "did you mean tikhonov?")])
def test_an_unknown_decoder_may_be_of_a_file(name, said):
    camera = SpectralCamera(bands=3, size=(8, 8), slots=2)
    with pytest.raises(SettingError, match=r"or FILE\.py:Class; ") as stop:
        decode(Snapshot(camera(torch.rand(1, 3, 8, 8)), camera), name)
    assert said in str(stop.value)


def test_the_one_with_a_prior_that_contributing_shows_conforms(installed):
    installed(FROM_MEAN)
    for check in CHECKS:
        check(decoders_for("spectral")["from-mean"], "spectral")


def test_it_is_listed_with_its_settings(plugin, capsys):
    main(["decoders", "--json"])
    row = next(row for row in json.loads(capsys.readouterr().out) if row["name"] == "backprojection")
    assert row["cameras"] == ["light-field", "spectral"]
    assert row["settings"] == [{"name": "gain", "type": "float", "default": 1.0, "help": "factor."}]


@pytest.mark.parametrize("scene", [["spectral", "coffee"], ["light-field", "coffee:1", "--views", "3"]])
def test_it_reconstructs(plugin, scene, capsys):
    main(["simulate", *scene, "--slots", "2", "--crop", "32x32", "--no-figures", "--out", "s.nc"])
    main(["reconstruct", "s.nc", "-d", "backprojection", "--set", "gain=0.5", "--no-figures", "--out", "e.nc"])
    assert "e.nc: backprojection" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["reconstruct", "s.nc", "-d", "backprojection", "--set", "gain=much", "--out", "f.nc"])
    assert "tmca: --set gain: found 'much', expected a number" in capsys.readouterr().err


@pytest.mark.parametrize(("kind", "reading"), [("spectral", {"bands": 3}), ("light-field", {"views": 3})])
def test_it_is_swept(plugin, tmp_path, kind, reading):
    from tmca.evaluation.sweep import Sweep, run_sweep

    def swept(vary, **more):
        asked = Sweep(kind, vary, ["coffee"], {**reading, "size": (24, 26)}, **more)
        return run_sweep(asked, tmp_path / f"out{len(more)}", tmp_path / "work")["rows"]

    names = ["backprojection", "dagger"]
    assert [row["decoder"] for row in swept({"decoder": names})] == names
    rows = swept({"decoder.gain": [0.5, 1.0]}, fixed={"decoder": "backprojection"})
    assert [row["decoder.gain"] for row in rows] == ["0.5", "1.0"]
    assert rows[0]["psnr"] != rows[1]["psnr"]


def test_cells_of_a_decoder_that_was_edited_are_computed_again(plugin, tmp_path):
    from tmca.evaluation.sweep import Sweep, run_sweep

    sweep = Sweep("spectral", {"decoder": ["backprojection"]}, ["coffee"], {"bands": 3, "size": (24, 26)})
    (before,) = run_sweep(sweep, tmp_path / "before", tmp_path / "work")["rows"]
    source = tmp_path / "site" / "ten_lines.py"
    source.write_text(PACKAGE.replace("self.gain *", "0.25 * self.gain *"))
    DECODERS.pop("backprojection")
    sys.modules.pop("ten_lines")  # as in another process
    load_plugins.cache_clear()
    (after,) = run_sweep(sweep, tmp_path / "after", tmp_path / "work")["rows"]
    assert after["psnr"] != before["psnr"]


def test_a_class_that_is_refused_keeps_no_other_of_its_module_out(installed):
    nameless = "\n\nclass Nameless(Decoder):\n    def reconstruct(self, prepared, values, progress):\n        pass\n"
    taken = PACKAGE.replace("Backprojection", "Taken").replace('"backprojection"', '"lmmse"')
    prior = "\n\nfrom tmca.priors import Prior\nclass Doubled(Prior):\n    kind = 'gaussian'\n"
    installed(taken + nameless + prior + PACKAGE, "Nameless", "Taken", "Backprojection")
    with pytest.warns(BrokenPlugin) as warned:
        assert decoders_for("spectral")["backprojection"].__module__ == "ten_lines"
    said = [str(one.message).partition(" of another package, left out: ") for one in warned]
    assert [(what, reason.split()[0]) for what, _, reason in said] == [
        ("decoder", "nameless"), ("decoder", "ten_lines.Taken.name:"), ("prior", "ten_lines.Doubled.kind:"),
    ]  # fmt: skip


@pytest.mark.parametrize(("part", "kind", "said"), [
    ("cameras", {"spectral", "spectrall"}, "found 'spectrall'.*did you mean spectral"),
    ("prior_kind", "gausian", "found 'gausian'.*did you mean gaussian"),
])  # fmt: skip
def test_a_kind_that_there_is_not_is_warned_of_where_decoders_are_listed(installed, monkeypatch, part, kind, said):
    parts = {"name": "early", "label": "early", "cameras": {"spectral"}, "reconstruct": lambda *given: given[2]}
    early = type("Early", (Decoder,), {**parts, part: kind})
    with pytest.warns(BrokenPlugin, match=f"decoder early: {part}: {said}"):
        assert decoders_for("spectral")["early"] is early
    if part == "cameras":
        monkeypatch.setitem(CAMERAS, "spectrall", SpectralCamera)  # of a package that comes later
        assert "early" in decoders_for("spectrall")


NET = """
from tmca.decoders import Decoder

class Net(Decoder):
    def reconstruct(self, prepared, values, progress):
        return 0.1 * prepared.A_adjoint(values)
"""


def test_a_class_that_says_nothing_is_called_by_its_name_and_is_for_all_cameras(tmp_path):
    class Net(Decoder):
        def reconstruct(self, prepared, values, progress):
            return 0.1 * prepared.A_adjoint(values)

    camera = SpectralCamera(3, (8, 8), slots=2)
    taken = Snapshot(camera(torch.rand(1, 3, 8, 8)), camera)
    (tmp_path / "net.py").write_text(NET)
    expected = 0.1 * camera.A_adjoint(taken.values)
    for given in (Net(), Net, f"{tmp_path}/net.py:Net"):
        found = decode(taken, given)
        assert found.decoder == "Net"
        torch.testing.assert_close(found.values, expected)
    assert Net.label == "Net"
    assert Net.cameras == frozenset(CAMERAS)
    with pytest.raises(SettingError, match="no class Nett in"):
        decode(taken, f"{tmp_path}/net.py:Nett")


def test_a_class_whose_name_is_no_text_is_refused_in_one_line():
    class Nameless(Decoder):
        def reconstruct(self, prepared, values, progress):
            return values

    Nameless.name = None
    camera = SpectralCamera(3, (8, 8), slots=2)
    taken = Snapshot(camera(torch.rand(1, 3, 8, 8)), camera)
    for given in (Nameless, Nameless()):
        with pytest.raises(SettingError, match=r"Nameless\.name: found None, expected a short text"):
            decode(taken, given)


@pytest.mark.parametrize(("source", "reason"), [
    ("raise RuntimeError('no luck')\n", "no luck"),
    ("raise SystemExit('bye')\n", "bye"),
    (PACKAGE.replace('"backprojection", "backprojected"', '"lmmse", "mine"'), "'lmmse', which tmca.decoders.lmmse has"),
    (PACKAGE.replace('"light-field"', "7"), "cameras: found frozenset"),
    (PACKAGE.replace('frozenset({"spectral", "light-field"})', '"spectral"'), "cameras: found 'spectral'"),
    (PACKAGE.replace('"backprojected"', "None"), "label: found None"),
    (PACKAGE.replace("def reconstruct", "def restore"), "reconstruct: found no such method"),
])  # fmt: skip
def test_a_package_that_cannot_be_loaded_is_warned_of_and_left_out(installed, source, reason):
    installed(source)
    before = dict(DECODERS)
    with pytest.warns(BrokenPlugin, match=reason):
        assert "lmmse" in decoders_for("spectral")
    assert before == DECODERS
