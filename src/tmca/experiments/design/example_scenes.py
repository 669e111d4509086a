"""`tmca.evaluation.example_scenes` by its old name."""

from tmca.evaluation.example_scenes import JUDGING as JUDGING
from tmca.evaluation.example_scenes import flat_error as flat_error
from tmca.evaluation.example_scenes import judge_on as judge_on
from tmca.evaluation.example_scenes import placed_error as placed_error
from tmca.evaluation.example_scenes import some_of as some_of
