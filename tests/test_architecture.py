"""The house: imports only go down, ``import tmca`` and ``--help`` stay light, files fit in the head."""

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import pytest

SOURCE = Path(__file__).parents[1] / "src" / "tmca"
FLOORS = {
    "errors": 0,
    "arguments": 0.2,
    "text_files": 0.2,
    "summaries": 0.2,
    "progress": 0.2,
    "plugins": 0.2,
    "attributes": 0.3,
    "yaml_loader": 0.3,
    "yaml_files": 0.4,
    "stored_numbers": 0.4,
    "specs": 0.5,
    "devices": 0.5,
    "workers": 0.5,
    "data": 1,
    "metrics": 1,
    "plots": 2,
    "dbd": 3,
    "codes": 2,
    "optics": 2,
    "operators": 3,
    "sensor": 3,
    "cameras": 4,
    "priors": 5,
    "design": 6,
    "decoders": 6,
    "registration": 6,
    "training": 7,
    "lab": 7,
    "applications": 7,
    "evaluation": 8,
    "testing": 8,
    "reports": 8.5,
    "tuning": 9,
    "cli": 10,
    "viewer": 10,
    "adapters": 10,
}
ALONE = {
    "data": {"errors", "arguments", "attributes", "text_files", "plugins"},
    "metrics": {"errors", "arguments"},
    "plots": {"errors", "data", "metrics"},
    "dbd": {"errors", "attributes", "yaml_files", "summaries", "progress", "data", "plots"},
}
"""Rooms that know no camera, and what they know."""
FILES = sorted(SOURCE.rglob("*.py"))


def statements(node):
    """All statements within one, which are never within expressions."""
    for block in ("body", "handlers", "orelse", "finalbody", "cases"):
        for child in getattr(node, block, ()):
            yield child
            yield from statements(child)


def names_type_checking(test):
    names = {getattr(part, "id", getattr(part, "attr", None)) for part in ast.walk(test)}
    return "TYPE_CHECKING" in names


def imported_rooms(tree):
    for node in statements(tree):
        names = []
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        for name in names:
            parts = name.split(".")
            if parts[0] == "tmca" and len(parts) > 1 and parts[1] in FLOORS:
                yield parts[1]


def imported_files(tree):
    """Files of the package that are imported at the top or inside functions, not for the type checker alone."""
    typing_only = [node for node in statements(tree) if isinstance(node, ast.If) and names_type_checking(node.test)]
    skipped = {inner for node in typing_only for part in node.body for inner in (part, *statements(part))}
    for node in statements(tree):
        if node in skipped or not isinstance(node, ast.ImportFrom | ast.Import):
            continue
        module = getattr(node, "module", None)
        for alias in node.names:
            place = SOURCE.parent.joinpath(*(f"{module}.{alias.name}" if module else alias.name).split("."))
            outer = place.parent if module else place
            found = [place.with_suffix(".py"), place / "__init__.py", outer.with_suffix(".py"), outer / "__init__.py"]
            yield from [path for path in found if path.exists()][:1]


def imports_at_run_time(tree):
    """All import statements but those for types alone."""
    checked = [node for node in statements(tree) if isinstance(node, ast.If) and isinstance(node.test, ast.Name)]
    skipped = {inner for node in checked if node.test.id == "TYPE_CHECKING" for inner in statements(node)}
    for node in statements(tree):
        if node in skipped:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@cache
def about(file):
    """What a file imports, in three ways, and its public classes; it is parsed once."""
    tree = ast.parse(file.read_text())
    return SimpleNamespace(
        rooms=[*imported_rooms(tree)],
        files=[*imported_files(tree)],
        at_run_time=[*imports_at_run_time(tree)],
        classes=[node.name for node in tree.body if isinstance(node, ast.ClassDef) and not node.name.startswith("_")],
    )


def allowed(room, other):
    """The room itself, the lower ones, and of these only some where it is to know no camera."""
    return other == room or (other in ALONE[room] if room in ALONE else FLOORS[other] < FLOORS[room])


def test_imports_only_go_down():
    wrong = []
    for file in FILES:
        room = file.relative_to(SOURCE).parts[0].removesuffix(".py")
        if room not in ("__init__", "__main__"):
            wrong += [f"{file} imports {other}" for other in about(file).rooms if not allowed(room, other)]
    assert wrong == []


ROOMS = sorted(path.name for path in SOURCE.iterdir() if path.is_dir() and (path / "__init__.py").exists())


@pytest.mark.parametrize("room", ROOMS)
def test_no_room_has_an_import_circle(room):
    files = [file for file in FILES if file.relative_to(SOURCE).parts[0] == room]
    needs = {file: {other for other in about(file).files if other in files} for file in files}
    while free := [file for file, others in needs.items() if not others]:
        needs = {file: others - {*free} for file, others in needs.items() if file not in free}
    assert [str(file.relative_to(SOURCE)) for file in needs] == []


def test_no_two_public_classes_have_one_name():
    names = [name for file in FILES for name in about(file).classes]
    assert sorted({name for name in names if names.count(name) > 1}) == []


def test_every_room_has_its_floor():
    rooms = {path.name for path in SOURCE.iterdir() if path.is_dir() and (path / "__init__.py").exists()}
    assert rooms <= set(FLOORS)


def test_only_plots_draw():
    for file in {*FILES} - {*(SOURCE / "plots").rglob("*.py")}:
        drawing = {name for name in about(file).at_run_time if name.startswith("matplotlib")}
        assert not drawing, file


def test_files_fit_in_the_head():
    assert [f for f in FILES if len(f.read_text().splitlines()) > 400] == []


def loaded_after(code, depth=1):
    script = f"{code}\nimport sys; print(' '.join(sorted({{'.'.join(m.split('.')[:{depth}]) for m in sys.modules}})))"
    return set(
        subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()
    )


def test_importing_tmca_loads_no_third_party_package():
    third_party = loaded_after("import tmca; tmca.__version__") - loaded_after("")
    assert {m for m in third_party if m not in sys.stdlib_module_names} == {"tmca"}


def test_help_loads_nothing_heavy():
    code = "import tmca.cli\ntry: tmca.cli.main(['--help'])\nexcept SystemExit: pass"
    heavy = {"torch", "numpy", "scipy", "xarray", "matplotlib", "h5py", "colour", "skimage"}
    assert not loaded_after(code) & heavy


def test_the_camera_loads_torch_and_numpy_only():
    heavy = {"matplotlib", "xarray", "h5py", "colour", "skimage", "pandas"}
    assert not loaded_after("from tmca.cameras import SpectralCamera; SpectralCamera(size=(4, 4))") & heavy


def test_tables_are_had_without_the_engine_that_fills_them():
    loaded = loaded_after("import tmca.evaluation.tables", depth=3)
    assert "tmca.evaluation.tables" in loaded
    assert not {"torch", "tmca.applications", "tmca.training", "tmca.evaluation.run", "tmca.evaluation.sweep"} & loaded
