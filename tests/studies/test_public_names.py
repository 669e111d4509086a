"""The studies use what the package offers to everybody, and are found beside a checkout alone."""

import ast
import sys
from importlib import import_module
from pathlib import Path

import pytest

import tmca
from tmca.cli.studies import study_module
from tmca.errors import TmcaError

STUDIES = Path(__file__).parents[2] / "studies"
ENGINES = {STUDIES / "grid.py", STUDIES / "bench.py"}
"""The files that know where engines are."""


@pytest.mark.parametrize("file", sorted({*STUDIES.rglob("*.py")} - ENGINES), ids=lambda f: str(f.relative_to(STUDIES)))
def test_studies_import_exported_names(file):
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "tmca":
            assert node.module.count(".") <= 1, f"{node.module}: no room"
            exported = getattr(import_module(node.module), "__all__", None)
            for alias in node.names if exported is not None else []:
                assert alias.name in exported, f"{node.module}.{alias.name}"


def test_files_fit_in_the_head():
    assert [file for file in STUDIES.rglob("*.py") if len(file.read_text().splitlines()) > 400] == []


def test_the_studies_of_this_checkout_are_found():
    assert Path(study_module("codes.study").__file__) == STUDIES / "codes" / "study.py"


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """The package as if it ran from a folder of installed packages, in a folder with studies of its own."""
    (tmp_path / "studies").mkdir()
    (tmp_path / "studies" / "__init__.py").write_text("raise SystemExit('run')")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", ["", *sys.path])
    for name in [name for name in sys.modules if name.split(".")[0] == "studies"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(tmca, "__file__", str(tmp_path / "lib" / "python" / "site-packages" / "tmca" / "__init__.py"))


def test_an_installation_without_studies_says_where_they_are(installed):
    with pytest.raises(TmcaError) as refused:
        study_module("codes.study")
    assert refused.value.where == "studies"
    assert "git clone" in refused.value.remedy


def test_studies_of_another_folder_are_never_run(installed, monkeypatch):
    monkeypatch.setattr(tmca, "__file__", str(STUDIES.parent / "src" / "tmca" / "__init__.py"))
    assert Path(study_module("tables").__file__) == STUDIES / "tables.py"


def test_studies_that_are_not_of_this_checkout_are_refused(installed, monkeypatch):
    monkeypatch.setattr(tmca, "__file__", str(STUDIES.parent / "src" / "tmca" / "__init__.py"))
    other = type(sys)("studies")
    other.__file__ = "elsewhere/studies/__init__.py"
    monkeypatch.setitem(sys.modules, "studies", other)
    with pytest.raises(TmcaError) as refused:
        study_module("tables")
    assert refused.value.where == "studies"
