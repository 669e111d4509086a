"""Help pages: on a screen, with what is used most; all of it with ``--help-all``."""

import json
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

from tests.cli.calls import said
from tmca.cli.app import COMMANDS as COMMANDS_BY_PLACE
from tmca.cli.app import GROUPS, app

COMMANDS = sorted(json.loads(Path(__file__).with_name("frozen.json").read_text())["options"])
SCREEN = 42


@pytest.fixture(scope="module", autouse=True)
def docstrings_read_once():
    """Many commands have the same settings, whose docstrings cyclopts reads again for every one."""
    with pytest.MonkeyPatch.context() as patch:
        with suppress(ImportError, AttributeError):  # a private name: another version is as right, and slower
            module = import_module("cyclopts.argument._collection")
            patch.setattr(module, "extract_docstring_help", cache(module.extract_docstring_help))
        yield


@pytest.mark.parametrize("command", COMMANDS)
def test_help_fits_a_screen(command, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    lines = said(capsys, *command.split(), "--help").splitlines()
    assert lines[0].startswith(f"Usage: tmca {command}".rstrip())
    assert len(lines) <= SCREEN
    assert max(map(len, lines)) <= 80


def test_all_of_the_help_explains_what_the_short_one_only_names(capsys):
    short, whole = (said(capsys, "compare", "spectral", option) for option in ("--help", "--help-all"))
    assert len(short.splitlines()) < len(whole.splitlines())
    assert "--help-all" in short


@pytest.mark.parametrize("command", ["spectral", "light-field", "spectral-depth"])
def test_a_title_follows_an_empty_line(command, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    lines = said(capsys, "design", command, "--help").splitlines()
    titles = [place for place, line in enumerate(lines) if line.startswith("── ")]
    assert len(titles) > 2
    assert not any(lines[place - 1].strip() for place in titles)


def test_the_command_alone_shows_how_to_start_by_commands_that_exist(capsys):
    guide = said(capsys)
    commands = [line.split("  ")[1].split() for line in guide.splitlines() if line.startswith("  tmca ")]
    parsed = [app.parse_args(words[1:], exit_on_error=False, print_error=False) for words in commands[:-2]]
    assert len(parsed) >= 4
    assert max(map(len, guide.splitlines())) <= 80


def test_the_first_page_shows_every_command_by_what_it_is_for(capsys):
    page = said(capsys, "--help")
    assert [page.count(f"\n── {title} ") for title in GROUPS] == [1] * len(GROUPS)
    assert list(COMMANDS_BY_PLACE) == [
        line.split()[0] for line in page.splitlines() if line.startswith("  ") and line[2].isalpha()
    ]
