"""Finding codes and masks: the expected error as objective, its optimisers, and which designs to take."""

from tmca.design.advice import advise
from tmca.design.advised import Advice, Candidate
from tmca.design.checks import check_search, check_size
from tmca.design.expected_error import BlockMse, MixtureMse, TileMse, design_model
from tmca.design.flips import flip_greedily
from tmca.design.kinds import KINDS, designable, hold_throughput, throughput_of
from tmca.design.mask_advised import MaskAdvice, MaskCandidate
from tmca.design.mask_search import MaskEffort, MaskTask, search_masks
from tmca.design.measures import CodeMeasures, measures
from tmca.design.search import QUICK, SURVEY, Descent, Design, Effort, Progress, decibels, descend, search
from tmca.design.sheet import SensorSheet
from tmca.design.spectral_depth import depth_information, design_masks
from tmca.design.task import Task, camera_arguments, load_examples, on_frame, save_examples
from tmca.design.transfer import Examples, TransferMse, learn_examples

__all__ = [
    "KINDS",
    "QUICK",
    "SURVEY",
    "Advice",
    "BlockMse",
    "Candidate",
    "CodeMeasures",
    "Descent",
    "Design",
    "Effort",
    "Examples",
    "MaskAdvice",
    "MaskCandidate",
    "MaskEffort",
    "MaskTask",
    "MixtureMse",
    "Progress",
    "SensorSheet",
    "Task",
    "TileMse",
    "TransferMse",
    "advise",
    "camera_arguments",
    "check_search",
    "check_size",
    "decibels",
    "depth_information",
    "descend",
    "design_masks",
    "design_model",
    "designable",
    "flip_greedily",
    "hold_throughput",
    "learn_examples",
    "load_examples",
    "measures",
    "on_frame",
    "save_examples",
    "search",
    "search_masks",
    "throughput_of",
]


def __dir__() -> list[str]:
    return sorted(__all__)
