"""Finding codes: the expected error as objective, its optimisers, and what they advise."""

from tmca.design.block_error import BlockError
from tmca.design.descent import Descent, descend
from tmca.design.flips import flip_greedily
from tmca.design.spectral import KINDS, designable
from tmca.design.throughput import hold_throughput
from tmca.design.tile import TileError

__all__ = ["KINDS", "BlockError", "Descent", "TileError", "descend", "designable", "flip_greedily", "hold_throughput"]
