"""Grids of cells: finished ones stay, failed ones named, a rerun does the rest."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import ClassVar

import pytest
from pydantic import BaseModel, model_serializer

from tmca.errors import DataError, SettingError
from tmca.evaluation.grid import CellsFailed, DamagedCell, Grid, cell_key, run_cells

CELLS = [{"name": f"cell {i}", "value": i} for i in range(5)]


def square(cell):
    return {"square": cell["value"] ** 2}


def square_but_not_three(cell):
    if cell["value"] == 3:
        raise ValueError("three is too many")
    return square(cell)


def never(cell):
    raise AssertionError("computed again")


@pytest.mark.parametrize("jobs", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_every_cell_is_computed_in_order(tmp_path, jobs):
    found = run_cells(CELLS, square, tmp_path, jobs=jobs)
    assert [cell["square"] for cell in found] == [0, 1, 4, 9, 16]


def test_failed_cells_are_named_and_the_rest_is_kept(tmp_path):
    told = []
    with pytest.raises(CellsFailed, match=r"1 of 5.*cell 3"):
        run_cells(
            CELLS, square_but_not_three, tmp_path, progress=lambda done, total, name, left: told.append((done, total))
        )
    assert told[-1] == (5, 5)
    trouble = tmp_path / f"{cell_key(CELLS[3])}.error.txt"
    assert "three is too many" in trouble.read_text()
    run_cells([c for c in CELLS if c["value"] != 3], never, tmp_path)
    run_cells(CELLS, square, tmp_path)
    assert not trouble.exists()


def of_no_form(cell):
    if cell["value"] == 0:
        raise DataError("bench.nc", "two\nlines", "one", "mend it")
    if cell["value"] == 1:
        raise RuntimeError("Error(s) in loading state_dict for Net:\n\tMissing key(s): first.weight\n\tsize mismatch")
    Power.model_validate(cell)
    return {}


def test_a_failure_of_several_lines_is_said_from_its_first(tmp_path):
    grid = Grid(of_no_form, tmp_path)
    grid.run([{"name": "ours", "value": 0}, {"name": "torch", "value": 1}, {"name": "pydantic", "value": "many"}])
    reasons = grid.reasons()
    assert reasons["ours"] == "bench.nc: found two lines, expected one; mend it"
    assert reasons["torch"].startswith("RuntimeError: Error(s) in loading state_dict for Net: Missing key(s): first")
    assert reasons["pydantic"].startswith("ValidationError: 1 validation error for Power value Input should be a valid")
    with pytest.raises(CellsFailed, match=r"3 of 3 cells failed \(ours, …\); the first says: bench.nc: found"):
        grid.check()


class Power(BaseModel):
    name: str
    value: int


def test_typed_cells_are_their_json_values_and_equal_ones_are_computed_once(tmp_path):
    told = []
    cells = [Power(name="two", value=2)] * 2
    found = run_cells(cells, square, tmp_path, progress=lambda done, total, name, left: told.append(name))
    assert found == [{"name": "two", "value": 2, "square": 4}] * 2
    assert told == ["two"]


def test_a_typed_cell_is_put_into_json_once_and_named_by_its_foreign_sources(tmp_path):
    class Foreign(Power):
        foreign: ClassVar = ["source"]
        dumped: ClassVar = []

        @model_serializer(mode="wrap")
        def dump(self, usual):
            self.dumped.append(self.name)
            return usual(self)

    run_cells([Foreign(name="two", value=2)], square, tmp_path)
    assert Foreign.dumped == ["two"]
    assert (tmp_path / f"{cell_key({'name': 'two', 'value': 2}, ['source'])}.json").exists()


def test_another_version_of_the_package_computes_anew(tmp_path, monkeypatch):
    run_cells(CELLS[:1], square, tmp_path)
    monkeypatch.setattr("tmca.evaluation.grid.package_version", lambda: "0.0+other")
    with pytest.raises(CellsFailed):
        run_cells(CELLS[:1], never, tmp_path)


def test_cells_go_through_submitit_as_well(tmp_path):
    pytest.importorskip("submitit")
    found = run_cells(CELLS, square, tmp_path, cluster={"cluster": "debug"})
    assert [cell["square"] for cell in found] == [0, 1, 4, 9, 16]
    assert len(run_cells(CELLS, never, tmp_path, cluster={"cluster": "debug"})) == 5


def test_a_job_that_the_cluster_ends_is_a_failed_cell(tmp_path, monkeypatch):
    submitit = pytest.importorskip("submitit")

    def ended(job):
        raise submitit.core.utils.UncompletedJobError("out of time")

    monkeypatch.setattr(submitit.DebugJob, "result", ended)
    with pytest.raises(CellsFailed, match="1 of 1 cells failed"):
        run_cells(CELLS[:1], square, tmp_path, cluster={"cluster": "debug"})
    (trouble,) = tmp_path.glob("*.error.txt")
    assert "out of time" in trouble.read_text()


def test_slurm_without_submitit_is_refused_in_one_line(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "submitit", None)
    with pytest.raises(SettingError, match=r"--slurm: found no submitit, .* pip install submitit"):
        run_cells(CELLS, never, tmp_path, cluster={})


def linger(cell):
    (Path(cell["folder"]) / str(os.getpid())).touch()
    time.sleep(300)
    return {}


GRID = """
import sys
from tests.evaluation.test_grid import linger
from tmca.evaluation.grid import run_cells
if __name__ == "__main__":
    cells = [{"name": str(i), "folder": sys.argv[1]} for i in range(5)]
    run_cells(cells, linger, sys.argv[1] + "/cells", jobs=2)
"""


def listen():
    """Where the tests run in the background, Ctrl-C is ignored, and would be by the processes they start."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def alive(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return "\nState:\tZ" not in Path(f"/proc/{process}/status").read_text()


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc").exists(), reason="looks into /proc")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_no_process_outlives_a_grid_that_is_stopped(tmp_path, number):
    script, pids = tmp_path / "grid.py", tmp_path / "pids"
    script.write_text(GRID)
    pids.mkdir()
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path.cwd()), *sys.path])}
    process = subprocess.Popen(
        [sys.executable, str(script), str(pids)], env=environment, stderr=subprocess.DEVNULL, preexec_fn=listen
    )
    begun = time.monotonic()
    while len(list(pids.glob("[0-9]*"))) < 2:
        assert time.monotonic() - begun < 120
        time.sleep(0.1)
    process.send_signal(number)
    process.wait(60)
    begun = time.monotonic()
    while any(alive(int(file.name)) for file in pids.glob("[0-9]*")):
        assert time.monotonic() - begun < 60
        time.sleep(0.1)


@pytest.mark.parametrize("damage", [lambda text: text[:20], lambda text: text.replace("1", "2"), lambda text: "[]"])
def test_a_damaged_cell_is_computed_again(tmp_path, damage):
    cells = [{"name": "one", "seed": 1}]
    first = run_cells(cells, _number, tmp_path)
    (file,) = tmp_path.glob("*.json")
    file.write_text(damage(file.read_text()))
    with pytest.warns(DamagedCell, match="computed again"):
        assert run_cells(cells, _number, tmp_path) == first
    assert run_cells(cells, _number, tmp_path) == first


def _number(cell):
    return {"value": cell["seed"] + 10}


def test_what_a_killed_process_left_is_deleted_though_all_cells_are_there(tmp_path):
    left = [tmp_path / ".1.json.0123456789ab.tmp", tmp_path / "designs" / ".a.nc.0123456789ab.tmp"]
    run_cells(CELLS, square, tmp_path)
    for folder in left:
        folder.mkdir(parents=True)
        (folder / ".lock").touch()
    run_cells(CELLS, square, tmp_path)
    assert not any(folder.exists() for folder in left)


def test_the_source_of_classes_of_other_packages_alone_counts_among_what_makes_a_cell():
    from tmca.cameras import CAMERAS
    from tmca.decoders import DECODERS
    from tmca.evaluation.cells import LearnedPrior, Measurement
    from tmca.plugins import foreign_source
    from tmca.priors import prior_kinds

    ours = [*DECODERS.values(), *CAMERAS.values(), *prior_kinds().values()]
    assert {foreign_source(cls) for cls in ours if cls.__module__.startswith("tmca.")} == {""}
    about = {"name": "one", "camera": "spectral", "reading": {"bands": 3}}
    measured = Measurement(decoder="lmmse", scene="coffee", source="coffee", settings={}, sensor={}, **about)
    learned = LearnedPrior(prior_kind="gaussian", scenes=("coffee",), identities=(None,), **about)
    for cell in (measured, learned):
        assert cell.key == cell_key(cell.model_dump(mode="json"))
