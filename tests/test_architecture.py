"""The house: imports only go down, ``import tmca`` and ``--help`` stay light, files fit in the head."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src" / "tmca"
FLOORS = {
    "errors": 0,
    "data": 1,
    "metrics": 1,
    "dbd": 2,
    "codes": 2,
    "optics": 2,
    "operators": 3,
    "sensor": 3,
    "cameras": 4,
    "priors": 5,
    "design": 6,
    "decoders": 6,
    "training": 7,
    "lab": 7,
    "experiments": 8,
    "cli": 9,
    "viewer": 9,
}
FILES = sorted(SOURCE.rglob("*.py"))


def imported_rooms(file):
    for node in ast.walk(ast.parse(file.read_text())):
        names = []
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        for name in names:
            parts = name.split(".")
            if parts[0] == "tmca" and len(parts) > 1 and parts[1] in FLOORS:
                yield parts[1]


@pytest.mark.parametrize("file", FILES, ids=lambda f: str(f.relative_to(SOURCE)))
def test_imports_only_go_down(file):
    room = file.relative_to(SOURCE).parts[0].removesuffix(".py")
    if room in ("__init__", "__main__"):
        return
    for other in imported_rooms(file):
        assert other == room or FLOORS[other] < FLOORS[room], f"{file} imports {other}, which lies above {room}"


def imported_files(file):
    """Files of the same room that a file imports, wherever in it."""
    room = file.relative_to(SOURCE).parts[0]
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith(f"tmca.{room}."):
            path = SOURCE.parent.joinpath(*node.module.split("."))
            yield from (found for found in (path.with_suffix(".py"), path / "__init__.py") if found.exists())


@pytest.mark.parametrize("room", ["decoders"])
def test_no_file_of_a_room_is_imported_by_what_it_imports(room):
    graph = {file: {*imported_files(file)} for file in (SOURCE / room).rglob("*.py") if file.name != "__init__.py"}
    done = set()

    def visit(file, path):
        assert file not in path, " → ".join(one.stem for one in (*path, file))
        if file not in done:
            for other in graph.get(file, ()):
                visit(other, (*path, file))
            done.add(file)

    for file in graph:
        visit(file, ())


def test_every_room_has_its_floor():
    rooms = {path.name for path in SOURCE.iterdir() if path.is_dir() and (path / "__init__.py").exists()}
    assert rooms <= set(FLOORS)


def test_data_and_metrics_know_no_camera():
    for room in ("data", "metrics"):
        for file in (SOURCE / room).rglob("*.py"):
            assert set(imported_rooms(file)) <= {"errors", room}, file


def test_blind_deconvolution_knows_no_camera():
    for file in (SOURCE / "dbd").rglob("*.py"):
        assert set(imported_rooms(file)) <= {"errors", "data", "dbd"}, file


def test_files_fit_in_the_head():
    assert [f for f in FILES if len(f.read_text().splitlines()) > 350] == []


def loaded_after(code):
    script = f"{code}\nimport sys; print(' '.join(sorted({{m.split('.')[0] for m in sys.modules}})))"
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
