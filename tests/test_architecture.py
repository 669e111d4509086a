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
    "training": 7,
    "lab": 7,
    "applications": 7,
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


def test_pictures_are_of_arrays():
    for file in (SOURCE / "plots").rglob("*.py"):
        assert set(imported_rooms(file)) <= {"errors", "data", "metrics", "plots"}, file


def imported_files(file):
    """Files of the same room that a file imports, at its head or in a function, types apart."""
    room = SOURCE / file.relative_to(SOURCE).parts[0]
    for name in imports_at_run_time(ast.parse(file.read_text())):
        place = SOURCE.parent / name.replace(".", "/")
        for target in (place.with_suffix(".py"), place.parent.with_suffix(".py")):
            if target.exists() and room in target.parents:
                yield target


def circles(room):
    """Files of a room that import themselves by way of others."""
    graph = {file: set(imported_files(file)) for file in room.rglob("*.py") if file.name != "__init__.py"}
    found = set()
    for start in graph:
        seen, ahead = set(), list(graph[start])
        while ahead:
            step = ahead.pop()
            if step not in seen and step in graph:
                seen.add(step)
                ahead += graph[step]
        if start in seen:
            found.add(start.relative_to(SOURCE).as_posix())
    return found


ROOMS = sorted(path for path in SOURCE.iterdir() if path.is_dir() and (path / "__init__.py").exists())


@pytest.mark.parametrize("room", ROOMS, ids=lambda path: path.name)
def test_no_import_goes_round_in_a_circle_inside_a_room(room):
    assert circles(room) == set()


def imports_at_run_time(node):
    """All import statements but those for types alone."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and isinstance(child.test, ast.Name) and child.test.id == "TYPE_CHECKING":
            continue
        if isinstance(child, ast.Import):
            yield from (alias.name for alias in child.names)
        elif isinstance(child, ast.ImportFrom):
            yield from (f"{child.module}.{alias.name}" for alias in child.names)
        yield from imports_at_run_time(child)


def test_only_plots_draw():
    exceptions = {SOURCE / "dbd" / "figures.py"}
    for file in {*FILES} - exceptions - {*(SOURCE / "plots").rglob("*.py")}:
        drawing = {name for name in imports_at_run_time(ast.parse(file.read_text())) if name.startswith("matplotlib")}
        assert not drawing, file


def test_files_fit_in_the_head():
    assert [f for f in FILES if len(f.read_text().splitlines()) > 400] == []


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
