"""Finding codes: the expected error as objective, its optimisers, and what they advise."""

from tmca.design.advice import Advice, Candidate, SensorSheet, advise
from tmca.design.block_mse import BlockMse
from tmca.design.descent import Descent, descend
from tmca.design.flips import flip_greedily
from tmca.design.geometry import design_model
from tmca.design.kinds import KINDS, designable
from tmca.design.measures import CodeMeasures, measures
from tmca.design.mixture import MixtureTileMse
from tmca.design.search import SURVEY, Design, Effort, search
from tmca.design.throughput import hold_throughput
from tmca.design.tile import TileMse
from tmca.design.transfer import Examples, TransferMse, learn_examples

__all__ = [
    "KINDS",
    "SURVEY",
    "Advice",
    "BlockMse",
    "Candidate",
    "CodeMeasures",
    "Descent",
    "Design",
    "Effort",
    "Examples",
    "MixtureTileMse",
    "SensorSheet",
    "TileMse",
    "TransferMse",
    "advise",
    "descend",
    "design_model",
    "designable",
    "flip_greedily",
    "hold_throughput",
    "learn_examples",
    "measures",
    "search",
]
