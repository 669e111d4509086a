"""The pages under docs/results are what their page writers make of the numbers beside them."""

import json
from importlib import import_module
from pathlib import Path

import pytest

RESULTS = Path(__file__).parents[2] / "docs" / "results"


@pytest.mark.parametrize("camera", ["spectral", "light-field", "spectral-depth"])
def test_a_shipped_page_tells_the_shipped_numbers(camera):
    writer = import_module(f"tmca.evaluation.pages.{camera.replace('-', '_')}")
    numbers = json.loads((RESULTS / f"{camera}.json").read_text())
    assert writer.markdown(numbers) == (RESULTS / f"{camera}.md").read_text()
