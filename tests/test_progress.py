"""Progress where nobody watches, in a terminal and in a notebook, as a ``progress`` argument asks."""

import sys
from types import SimpleNamespace

import pytest

from tmca import progress


def test_lines_say_share_step_and_time_left(capsys, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    with progress.progress_bar("prior p.nc") as told:
        for share, step, detail in ((0.0, "reading one", ""), (0.2, "reading two", ""), (0.6, "learning", "step 3")):
            told(share, step, detail)
            now[0] += 20
    assert capsys.readouterr().err.splitlines() == [
        "prior p.nc: 0% reading one",
        "prior p.nc: 20% reading two, 80 s left",
        "prior p.nc: 60% learning step 3, 27 s left",
    ]


class Screen:
    """What a notebook shows below a cell."""

    def __init__(self):
        self.shown = []

    def display(self, page, display_id):
        assert display_id is True
        self.shown.append(page)
        return SimpleNamespace(update=self.shown.append)


@pytest.fixture
def notebook(monkeypatch):
    """A shell of a notebook, and a clock."""
    screen, now = Screen(), [0.0]
    shell = SimpleNamespace(kernel=object())
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    monkeypatch.setitem(sys.modules, "IPython.display", SimpleNamespace(HTML=str, display=screen.display))
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return screen, now


def work(report, now, seconds):
    for step in range(1, 11):
        now[0] += seconds / 10
        if report:
            report(step / 10, "step <3>")


def test_a_notebook_shows_a_bar_for_work_of_more_than_a_second_and_then_its_time(notebook):
    screen, now = notebook
    with progress.reporting(None, "lmmse") as report:
        work(report, now, 20)
    assert 'value="0.500"' in "".join(screen.shown)
    assert "10 s left" in "".join(screen.shown)
    assert "<3>" not in "".join(screen.shown)
    assert screen.shown[-1] == "lmmse: 18.0 s"


def test_short_work_shows_nothing_unless_a_bar_is_asked_for(notebook):
    screen, now = notebook
    with progress.reporting(None, "lmmse") as report:
        work(report, now, 0.9)
    assert screen.shown == []
    with progress.reporting(True, "lmmse") as report:
        work(report, now, 0.9)
    assert screen.shown[-1] == "lmmse: 0.9 s"


def test_a_script_is_quiet_unless_lines_are_asked_for(capsys):
    for asked in (None, False):
        with progress.reporting(asked, "lmmse") as report:
            assert report is None
    with progress.reporting(True, "lmmse") as report:
        report(0.5, "half")
    assert capsys.readouterr().err == "lmmse: 50% half\n"


def test_a_callable_is_called_as_the_work_calls_it():
    told = []
    with progress.counting(lambda *about: told.append(about), "study") as report:
        report(1, 4, "a cell", 2.5)
    assert told == [(1, 4, "a cell", 2.5)]


def test_counts_become_shares(capsys):
    with progress.counting(True, "study") as report:
        report(1, 4, "a cell", 2.5)
        assert report is not None
    assert capsys.readouterr().err == ""  # a detail is no step: the next line is due in ten seconds


def test_a_terminal_shows_a_bar_and_wipes_it(monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with progress.progress_bar("prior") as report:
        report(0.5, "half")
        assert report.bars.tasks[0].completed == 0.5
    assert report.bars.live.is_started is False
