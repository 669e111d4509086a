"""Every file explains itself, and the page of file formats is true: its commands and names are there."""

import re
import shlex
import sys
from importlib import import_module
from pathlib import Path

import pytest
import xarray as xr

from tmca.cli.app import app

DOCS = Path(__file__).parents[1] / "docs"
sys.path.insert(0, str(DOCS))
file_formats, file_kinds, tiny_files = map(import_module, ("file_formats", "file_kinds", "tiny_files"))
SLOW = {"_scenes": pytest.mark.slow}  # tests/data/test_rendered_scenes.py looks at these
WRITERS = [
    pytest.param(write, id=write.__name__[1:], marks=SLOW.get(write.__name__, ())) for write in tiny_files.WRITERS
]
CALLS = [call for kind in file_kinds.KINDS for call in (kind.write, kind.read)]


@pytest.mark.filterwarnings("ignore")  # masks of a few pixels are no good ones
@pytest.mark.parametrize("write", WRITERS)
def test_every_variable_says_what_it_is_and_its_unit(tmp_path, write):
    write(tmp_path)
    for file in tmp_path.glob("*.nc"):
        with xr.open_datatree(file, engine="h5netcdf") as tree:
            for group in tree.subtree:
                for name, values in group.to_dataset(inherit=False).variables.items():
                    assert values.attrs.get("long_name"), f"{file.name}: {group.path} {name}"
                    assert values.dtype.kind not in "biuf" or values.attrs.get("units"), f"{file.name}: {name}"


@pytest.mark.parametrize("command", sorted({command for command, _ in CALLS if command}))
def test_commands_of_the_page_are_understood(command):
    program, *words = shlex.split(command)
    assert program == "tmca"
    app.parse_args(words, exit_on_error=False, print_error=False)


def test_names_of_the_page_are_there():
    for name in re.findall(r"tmca(?:\.\w+)+", " ".join(python for _, python in CALLS)):
        room, _, part = name.rpartition(".")
        try:
            holder = import_module(room)
        except ModuleNotFoundError:
            outer, _, inner = room.rpartition(".")
            holder = getattr(import_module(outer), inner)
        assert hasattr(holder, part), name


@pytest.mark.slow
def test_the_page_has_a_section_for_every_kind():
    page = file_formats.files_page()
    assert all(f"\n## {kind.title}\n" in page for kind in file_kinds.KINDS)
    assert not [name for name in file_kinds.ATTRIBUTES if f"| `{name}`" not in page]
    assert "| `snapshot`{.entry} | y 16, x_sensor 22 | float32 |" in page
