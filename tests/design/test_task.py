"""Designs of a study: each starts from those that it contains."""

import pytest
import torch

from tmca.design import Effort, Task, design_model, designable, learn_examples
from tmca.sensor import Noise

BANDS = [500e-9, 550e-9, 600e-9]


@pytest.fixture(scope="module")
def task(tmp_path_factory):
    model = design_model(designable("static", 1, (4, 4), bands=BANDS).taps())
    source = torch.Generator().manual_seed(0)
    cubes = {name: torch.rand(3, 24, 40, generator=source).cumsum(2) / 40 for name in ("one", "other")}
    examples = learn_examples(cubes, model, BANDS)
    folder = tmp_path_factory.mktemp("designs")
    return Task(examples, Noise(0.01, 0.0), (4, 4), Effort(descents=1, steps=3, flips=0), 0, folder, None, {})


@pytest.mark.parametrize(("kind", "slots", "contained"), [
    ("free", 2, ("static", 1)), ("free", 4, ("free", 2)),
    ("two-bucket", 2, ("burst", 2)), ("two-bucket", 4, ("two-bucket", 2)),
    ("two-bucket", 3, None), ("one-hot", 2, None), ("burst", 2, None), ("burst", 3, None),
])  # fmt: skip
def test_codes_are_no_worse_than_the_first_that_they_contain(task, kind, slots, contained):
    best = task.design(kind, slots)
    assert task.design(kind, slots).mse == pytest.approx(best.mse)
    assert {f"{kind} K = {slots}"} <= {*task.seconds(kind, slots)}
    if contained is None:
        assert len(task.seconds(kind, slots)) == 1
    else:  # with one descent only the first start is used
        assert best.mse <= task.design(*contained).mse * (1 + 1e-9)


def test_a_burst_of_four_starts_from_the_one_of_two(task):
    assert [*task.seconds("burst", 4)] == ["burst K = 4", "burst K = 2"]
    assert task.design("burst", 4).camera.buckets == task.design("burst", 4).slots == 4  # searched, then read again
