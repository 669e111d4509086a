"""Markdown tables are drawn in a terminal, and stay as they are in a pipe."""

import re
import sys

import pytest

from tmca.cli import main
from tmca.cli.options.output import say

TEXT = "# Title\n\n| code | PSNR (dB) |\n| --- | --- |\n| one \\| two | **31.20** |\n| none |  |\n\nlast line"


@pytest.mark.parametrize(("terminal", "markdown"), [(False, False), (False, True), (True, True)])
def test_markdown_stays(capsys, monkeypatch, terminal, markdown):
    monkeypatch.setattr(sys.stdout, "isatty", lambda: terminal)
    say({}, False, TEXT, markdown=markdown)
    assert capsys.readouterr().out == f"{TEXT}\n"


def test_a_terminal_shows_tables(capsys, monkeypatch):
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    say({}, False, TEXT)
    said = re.sub(r"\x1b\[\d*m", "", capsys.readouterr().out).splitlines()
    assert said[0] == "# Title"
    assert said[-1] == "last line"
    [row] = [line for line in said if "31.20" in line]
    assert row.split() == ["one", "|", "two", "31.20"]
    assert not any("---" in line or "**" in line for line in said)
    [head] = [line for line in said if "PSNR" in line]
    assert head.rstrip().endswith("PSNR (dB)")
    assert row.rstrip().endswith("31.20")
    assert len(head.rstrip()) == len(row.rstrip())  # numbers end where their heading ends


def test_commands_that_print_tables_print_them_as_markdown_if_asked(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    main(["simulate", "spectral", "coffee", "--bands", "4", "--crop", "20x24", "--out", "s.nc", "--no-figures"])
    for name in ("a", "b"):
        main(["reconstruct", "s.nc", "-d", "dagger", "--out", f"{name}.nc", "--no-figures"])
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    capsys.readouterr()
    main(["evaluate", "a.nc", "b.nc", "coffee", "--markdown"])
    assert "| --- |" in capsys.readouterr().out
