"""A decoder of ten lines in a package of its own: every command knows it, with no other line written anywhere."""

import json
import sys

import pytest
from conformance import CHECKS

from tests.plugin_packages import install
from tmca.cli import main
from tmca.decoders import DECODERS, decoders_for
from tmca.plugins import BrokenPlugin, load_plugins

PACKAGE = '''
from dataclasses import dataclass
from tmca.decoders import Decoder

@dataclass
class Backprojection(Decoder):
    """The adjoint, as bright as asked for.

    Args:
        gain: factor.
    """

    name, label, cameras = "backprojection", "backprojected", frozenset({"spectral", "light-field"})
    gain: float = 1.0

    def reconstruct(self, prepared, values, progress):
        return self.gain * prepared.operator().A_adjoint(values)
'''


@pytest.fixture
def plugin(tmp_path, monkeypatch):
    (tmp_path / "site").mkdir()
    install(tmp_path / "site", monkeypatch, "tmca.decoders", "ten_lines", PACKAGE)
    monkeypatch.chdir(tmp_path)
    yield decoders_for("spectral")["backprojection"]
    DECODERS.pop("backprojection")
    sys.modules.pop("ten_lines")
    monkeypatch.undo()
    load_plugins.cache_clear()


@pytest.mark.parametrize("kind", ["spectral", "light-field"])
def test_it_conforms(plugin, kind):
    for check in CHECKS:
        check(plugin, kind)


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
    assert "gain: found 'much', expected a number" in capsys.readouterr().err


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


@pytest.mark.parametrize(("source", "reason"), [
    ("raise RuntimeError('no luck')\n", "no luck"),
    ("raise SystemExit('bye')\n", "bye"),
    (PACKAGE.replace('"backprojection", "backprojected"', '"lmmse", "mine"'), "'lmmse', which tmca.decoders.lmmse has"),
    (PACKAGE.replace('"light-field"', "7"), "cameras: found frozenset"),
    (PACKAGE.replace('frozenset({"spectral", "light-field"})', '"spectral"'), "cameras: found 'spectral'"),
    (PACKAGE.replace('"backprojected"', "None"), "label: found None"),
    (PACKAGE.replace("def reconstruct", "def restore"), "reconstruct: found no such method"),
])  # fmt: skip
def test_a_package_that_cannot_be_loaded_is_warned_of_and_left_out(source, reason, tmp_path, monkeypatch, capsys):
    install(tmp_path, monkeypatch, "tmca.decoders", "broken_lines", source)
    before = dict(DECODERS)
    with pytest.warns(BrokenPlugin, match=reason):
        assert "lmmse" in decoders_for("spectral")
    assert before == DECODERS
    sys.modules.pop("broken_lines", None)
    monkeypatch.undo()
    load_plugins.cache_clear()
