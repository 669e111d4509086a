"""Documents name what is there: tests that hold an erratum, presets."""

import pydoc
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tmca.cameras import LightFieldCamera, SpectralDepthCamera
from tmca.decoders.nets.shipped import FOLDER
from tmca.training import TRAININGS

ROOT = Path(__file__).parents[1]
PAGES = sorted((ROOT / "docs").glob("*.md"))
SIX_LINES = 6 * 125
ERRATA = (ROOT / "docs" / "errata.md").read_text()
SPECTRAL_DEPTH = (ROOT / "docs" / "spectral-depth.md").read_text()
LIGHT_FIELD = (ROOT / "docs" / "light-field.md").read_text()


def test_the_tests_that_hold_an_erratum_are_there():
    for row in ERRATA.splitlines():
        if files := re.findall(r"`(tests/\S+\.py)`", row):
            text = "".join((ROOT / file).read_text() for file in files)
            for name in re.findall(r"`(test_\w+)`", row):
                assert f"def {name}(" in text, row


def test_every_preset_of_the_light_field_is_described():
    cameras, trainings = LIGHT_FIELD.split("`--preset` of `tmca train light-field`")
    assert all(f"| `{name}` |" in cameras for name in LightFieldCamera.presets)
    assert all(f"| `{name}` |" in trainings for name in TRAININGS["light-field"].presets)


def test_every_preset_of_the_spectral_depth_camera_is_described():
    cameras, trainings = SPECTRAL_DEPTH.split("`--preset` of `tmca train spectral-depth`")
    assert all(f"`{name}`" in cameras for name in SpectralDepthCamera.presets)
    assert all(f"| `{name}` |" in trainings for name in TRAININGS["spectral-depth"].presets)


def test_pages_say_what_they_are_for_in_paragraphs_of_six_lines():
    for page in PAGES:
        text = re.sub(r"```.*?```|\$\$.*?\$\$", "", page.read_text(), flags=re.S)
        paragraphs = [part.strip() for part in re.split(r"\n\s*\n", text)]
        assert not paragraphs[1].startswith(("#", "|", "!")), f"{page.name} opens in the middle of the matter"
        for paragraph in paragraphs:
            told = paragraph.startswith(("|", "#", "- ", "<", "1."))
            assert told or len(paragraph) <= SIX_LINES, f"{page.name}: {paragraph[:60]}"


def test_python_names_of_pages_are_there():
    pages, seen = [*PAGES, *(ROOT / "docs" / "results").glob("*.md"), ROOT / "README.md", FOLDER / "README.md"], 0
    for page in pages:
        text = page.read_text()
        names = re.findall(r"(?<![\w./-])tmca(?:\.[A-Za-z_]\w*)+", text)
        for room, parts in re.findall(r"^from (tmca[\w.]*) import ([\w, ]+)$", text, re.M):
            names += [f"{room}.{part.split()[0]}" for part in parts.split(",")]
        for name in names:
            assert pydoc.locate(name) is not None, f"{page.name}: {name}"
        seen += len(names)
    assert seen > 100


def test_the_site_has_every_page_in_its_navigation():
    navigation = (ROOT / "mkdocs.yml").read_text().partition("\nnav:\n")[2]
    for page in [*PAGES, *(ROOT / "docs" / "results").glob("*.md")]:
        assert f": {page.relative_to(ROOT / 'docs').as_posix()}\n" in navigation, page.name


@pytest.mark.slow
def test_the_site_is_built_and_asks_no_other_host(tmp_path):
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", tmp_path / "site"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    for page in (tmp_path / "site").rglob("*.html"):
        assert not re.findall(r'<(?:script|link|img)[^>]+(?:src|href)="https?://[^"]+"', page.read_text()), page
