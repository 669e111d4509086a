"""What users type and what their scripts read does not change unnoticed: options of every command, keys of `--json`.

`python -m tests.cli.test_frozen` writes frozen.json anew, for a change that is meant and told in the changelog.
"""

import contextlib
import io
import json
import os
import re
import shlex
import tempfile
from operator import itemgetter
from pathlib import Path
from typing import Annotated, Literal, get_args, get_origin

import pytest

from tmca.cli import main
from tmca.cli.app import app

FROZEN = Path(__file__).parent / "frozen.json"
KINDS = {bool: "flag", int: "int", float: "float", Path: "path"}
RUNS = """
tmca simulate spectral coffee --crop 16x16 --slots 2 --read-noise 0.01 --out s.nc --no-figures
= tmca simulate spectral coffee --crop 16x16 --slots 2 --read-noise 0.01 --out t.nc --no-figures
= tmca simulate light-field coffee --crop 16x16 --views 3 --slots 2 --out l.nc --no-figures
= tmca simulate spectral-depth coffee --crop 32x32 --out d.nc --no-figures
= tmca reconstruct s.nc -d dagger --truth coffee --out a.nc --no-figures
= tmca reconstruct l.nc -d dagger --truth coffee --out b.nc --no-figures
= tmca evaluate a.nc coffee
= tmca evaluate b.nc coffee
= tmca inspect s.nc
= tmca design judge s.nc
= tmca decoders
tmca prior learn coffee rocket --bands 2 --out p.nc
= tmca prior expect p.nc --slots 2 --period 4 --read-noise 0.01
tmca export s.nc --device dli4120 --no-figures --out e
= tmca export check e
tmca dbd simulate -M 9 -P 7 -J 2 --targets 1 --paths 1 --out o.nc
= tmca dbd solve o.nc --no-certify
"""


def commands(at, path=()):
    """(words, app) of every command that does something."""
    if at.default_command is not None:
        yield " ".join(path), at
    for name in at:
        if not name.startswith("-"):
            yield from commands(at[name], (*path, name))


def kind_of(hint):
    """flag, int, float, path, choice, or text; several of them with a +."""
    if get_origin(hint) is Annotated:
        return kind_of(get_args(hint)[0])
    members = [one for one in get_args(hint) if one is not type(None)] if type(None) in get_args(hint) else [hint]
    [hint] = members if len(members) == 1 else [str]
    if get_origin(hint) in (list, tuple):
        return f"{kind_of(get_args(hint)[0])}+"
    return "choice" if get_origin(hint) is Literal else KINDS.get(hint, "text")


def stated(argument):
    """Kind, default as the help page shows it, choices."""
    default = argument.field_info.default
    told = re.search(r"\[default: (.*?)\]", argument.parameter.help or "")
    if default in (None, argument.field_info.empty):
        default = told[1] if told else None
    shown = None if default is None else str(default)
    choices = [] if kind_of(argument.hint) == "flag" else list(argument.get_choices() or ())
    required = ["required"] if argument.required else []
    return [" ".join(argument.names), kind_of(argument.hint), shown, *choices, *required]


def options(command):
    """A row for every option."""
    return sorted(
        stated(argument)
        for argument in command.assemble_argument_collection(default_parameter=app.default_parameter)
        if not argument.children
    )


def types(value):
    """The keys of a JSON value, with types in the place of values; a list is as its first entry."""
    if isinstance(value, dict):
        return {key: types(part) for key, part in value.items()}
    return [types(one) for one in value[:1]] if isinstance(value, list) else type(value).__name__


def printed():
    """Command → keys and types of what it prints with `--json`."""
    found = {}
    for line in filter(None, RUNS.splitlines()):
        words = shlex.split(line.lstrip("= "))[1:]
        said = io.StringIO()
        with contextlib.redirect_stdout(said):
            main([*words, *(["--json"] if line.startswith("=") else [])])
        if line.startswith("="):
            found[" ".join(words)] = types(json.loads(said.getvalue()))
    return found


def test_no_spelling_is_lost():
    frozen = json.loads(FROZEN.read_text())["options"]
    assert set(frozen) <= {name for name, _ in sorted(commands(app), key=itemgetter(0))}


@pytest.mark.parametrize(
    ("name", "command"), [pytest.param(*one, id=one[0]) for one in sorted(commands(app), key=itemgetter(0))]
)
def test_options_stay_as_they_are(name, command):
    assert options(command) == json.loads(FROZEN.read_text())["options"].get(name, [])


@pytest.mark.slow
def test_json_stays_as_it_is(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert printed() == json.loads(FROZEN.read_text())["json"]


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        lines = [f"{json.dumps(name)}: [\n  " + ",\n  ".join(map(json.dumps, options(one))) + "]"
                 for name, one in sorted(commands(app), key=itemgetter(0))]  # fmt: skip
        keys = [f"{json.dumps(name)}: {json.dumps(value)}" for name, value in printed().items()]
        FROZEN.write_text('{"options": {\n' + ",\n".join(lines) + '},\n"json": {\n' + ",\n".join(keys) + "}}\n")
