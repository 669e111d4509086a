"""The tutorials run as a notebook does, from the package alone; their pages show what that gave."""

import ast
import json
import re

import jupytext
import pytest

import tmca
from docs import run_tutorials as tutorials
from tests.test_documents import ROOT, SIX_LINES

each = pytest.mark.parametrize("script", tutorials.SCRIPTS, ids=lambda script: script.stem)
KEPT = json.loads(tutorials.OUTPUTS.read_text())
MOST_BYTES = 150_000


def of_kind(script, kind):
    return [cell.source for cell in tutorials.cells(script) if cell.cell_type == kind]


def test_there_are_six():
    assert [script.name[0] for script in tutorials.SCRIPTS] == list("123456")
    assert sorted(KEPT) == [script.stem for script in tutorials.SCRIPTS]


@each
def test_a_tutorial_says_first_what_one_learns_and_last_where_to_go(script):
    texts = of_kind(script, "markdown")
    title, opening, *_ = texts[0].split("\n\n")
    assert title.startswith("# ")
    assert opening.startswith("You learn")
    assert "seconds" in opening
    assert texts[-1].startswith("## Where to go")
    assert all(len(part) <= SIX_LINES for text in texts for part in text.split("\n\n") if not part.startswith("- "))


@each
def test_a_tutorial_uses_public_names_alone(script):
    for node in ast.walk(ast.parse("\n".join(of_kind(script, "code")))):
        if isinstance(node, ast.Import):
            assert {alias.name for alias in node.names} <= {"tmca", "pandas", "warnings"}
        if isinstance(node, ast.ImportFrom):
            assert node.module == "tmca"
            assert {alias.name for alias in node.names} <= {*dir(tmca)}
        if isinstance(node, ast.Attribute):
            assert not node.attr.startswith("_")


@each
def test_links_of_a_tutorial_lead_to_files(script):
    for target in re.findall(r"\]\(([^)]+)\)", "\n".join(of_kind(script, "markdown"))):
        assert (script.parent / target).is_file(), target


@each
def test_what_a_page_shows_comes_from_the_code_on_it(script):
    remedy = "run python docs/run_tutorials.py, and look at its pictures"
    assert KEPT[script.stem]["code"] == tutorials.digest(script), remedy
    tagged = [n for n, cell in enumerate(tutorials.cells(script)) if "picture" in cell.metadata.get("tags", ())]
    pictures = [tutorials.picture_of(script, number) for number in tagged]
    assert 1 <= len(pictures) <= 2
    assert sorted(script.parent.glob(f"{script.stem}-*.webp")) == sorted(pictures), remedy
    assert all(picture.stat().st_size <= MOST_BYTES for picture in pictures)


@each
def test_a_tutorial_becomes_a_notebook_and_back(script):
    book = jupytext.writes(jupytext.read(script), fmt="ipynb")
    again = jupytext.reads(book, fmt="ipynb")
    assert json.loads(book)["metadata"]["kernelspec"]["name"] == "python3"
    assert [cell.source for cell in again.cells] == [cell.source for cell in tutorials.cells(script)]


def test_a_cell_that_fails_is_named(tmp_path):
    script = tmp_path / "broken.py"
    script.write_text("# %% [markdown]\n# # Title\n\n# %%\na = 1\na\n\n# %%\nprint(a)\n1 / 0\n")
    outputs = tutorials.run(script)
    assert next(outputs) == (1, "1", None)
    with pytest.raises(RuntimeError, match=r"broken.py, cell 2 \(print\(a\) …\): ZeroDivisionError"):
        next(outputs)


@pytest.mark.slow
@each
def test_a_tutorial_runs(script, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    outputs = {str(output.number): output for output in tutorials.run(script)}
    assert {number for number, output in outputs.items() if output.text} == {*KEPT[script.stem]["texts"]}
    for number, cell in enumerate(tutorials.cells(script)):
        if "picture" in cell.metadata.get("tags", ()):
            assert outputs[str(number)].picture.startswith(b"\x89PNG")
    assert not (ROOT / "tiny_run").exists()
