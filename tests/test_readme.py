"""Every command of README and tour runs, on smaller scenes and with fewer steps; as written with TMCA_WHOLE_TOUR=1."""

import ast
import importlib
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tmca.cli import main

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "README.md").read_text()
TOUR = (ROOT / "docs" / "tour.md").read_text()
PARTS = [block.splitlines() for block in re.findall(r"```bash\n(.*?)```", TOUR + TEXT, re.S)]
BASH = [line for part in PARTS for line in part]
SMALL = {"spectral": "24x32", "light-field": "20x24", "spectral-depth": "48x64"}
SHRUNK = (
    {}
    if os.environ.get("TMCA_WHOLE_TOUR")
    else {
        "128x128": "48x56",
        "96x128": "48x64",
        "96x96": "48x48",
        "64x80": "32x40",
        "64x64": "32x32",
        "--steps 5": "--steps 2",
        "--slots 2 --period 8": "--slots 2 --period 4",
        "astronaut chelsea rocket": "chelsea rocket",
    }
)
"""Crops, steps, tile and scenes of the tour, and what its tests take in their place."""
PYTHON = re.findall(r"```python\n(.*?)```", TEXT, re.S)


def run(arguments, folder):
    return subprocess.run(arguments, cwd=folder, capture_output=True, text=True, timeout=600)


def test_the_tour_has_commands():
    assert len(BASH) >= 8
    assert len(PYTHON) >= 1
    assert all(any(large in line for line in BASH) for large in SHRUNK)


def written_by(line):
    """Name after ``--out``, of a file or, with or without a suffix, a folder."""
    named = re.search(r"--out (\S+)", line)
    return named and named[1]


def with_what_it_reads(part):
    """The lines of a part of the tour, after those of the parts before that make what these read."""
    lines = list(part)
    for line in reversed(BASH[: BASH.index(part[0])]):
        made = written_by(line)
        read = [word for one in lines for word in one.split() if one != line]
        if made and any(word == made or word.startswith((f"{made}/", f"{made}.")) for word in read):
            lines.insert(0, line)
    return lines


def test_parts_of_the_tour_start_from_what_they_read():
    assert with_what_it_reads(PARTS[0]) == PARTS[0]
    made = {written_by(line) for part in PARTS for line in with_what_it_reads(part)[: -len(part)]}
    assert {"coffee_snapshot.nc", "patterns", "captured"} <= made


@pytest.fixture(scope="module")
def tour(tmp_path_factory):
    """The folder of the tour, and the commands that were run in it."""
    return tmp_path_factory.mktemp("tour"), set()


@pytest.mark.slow
@pytest.mark.parametrize("part", PARTS, ids=lambda part: "-".join(part[0].split()[1:3]))
def test_the_tour_runs_in_its_order(part, tour, monkeypatch):
    """Part by part in one folder, as a reader does; a part that runs alone, after what it reads."""
    folder, ran = tour
    monkeypatch.chdir(folder)
    for line in with_what_it_reads(part):
        if line in ran:
            continue
        words = shlex.split(re.sub("|".join(SHRUNK) or "(?!)", lambda large: SHRUNK[large[0]], line))
        assert words[0] == "tmca", line
        main(words[1:])
        ran.add(line)


def first_of(camera):
    """The tour's first snapshot of a camera, small, and what reconstructs it without a comparison."""
    taken = next(line for line in BASH if line.startswith(f"tmca simulate {camera} ") and "--weights" not in line)
    file = re.search(r"--out (\S+)", taken)[1]
    taken = re.sub(r"--crop \S+", f"--crop {SMALL[camera]}", taken)
    decoded = next(line for line in BASH if line.startswith(f"tmca reconstruct {file}"))
    return taken, decoded


@pytest.mark.parametrize(
    "camera", ["spectral", *(pytest.param(name, marks=pytest.mark.slow) for name in ("light-field", "spectral-depth"))]
)
def test_the_first_snapshot_of_every_camera_is_taken_and_reconstructed(camera, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for line in first_of(camera):
        main(shlex.split(line)[1:])
    assert len(list(tmp_path.glob("*.nc"))) == 2


@pytest.mark.slow
@pytest.mark.parametrize("code", PYTHON)
def test_the_python_of_the_tour_runs(code, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "README.md", "exec"), {})
    assert (tmp_path / "from_python.png").exists()


def test_the_two_commands_are_what_the_makefile_and_ci_call():
    makefile, ci = (ROOT / "Makefile").read_text(), (ROOT / ".ci" / "run").read_text()
    assert "make demo" in TEXT
    assert "tmca demo" in makefile
    assert "make test" in TEXT
    assert "make -j 2 lint test-all" in ci
    assert '-m "not slow"' in makefile
    assert '-c constraints.txt -e ".[dev]"' in makefile


def test_the_package_runs_as_a_program(tmp_path):
    done = run([sys.executable, "-m", "tmca", "demo", "--help"], tmp_path)
    assert done.returncode == 0, done.stderr
    assert "report.html" in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("camera", ["spectral", "light_field"])
def test_the_benchmarks_run(camera, tmp_path):
    done = run([sys.executable, str(ROOT / "benchmarks" / f"{camera}.py"), "--repeats", "1", "--json"], tmp_path)
    assert done.returncode == 0, done.stderr
    assert "ratios" in done.stdout


def test_benchmarks_import_what_is_there():
    for file in sorted((ROOT / "benchmarks").glob("*.py")):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("tmca"):
                module = importlib.import_module(node.module)
                missing = [name.name for name in node.names if not hasattr(module, name.name)]
                assert not missing, (file.name, node.module, missing)


def test_links_lead_somewhere():
    for target in re.findall(r"\]\(([^)#:]+)\)", TEXT):
        assert (ROOT / target).exists(), target
