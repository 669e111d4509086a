"""Fine-tuning a trained decoder on calibrated captures: their folder, the run, pictures."""

from tmca.tuning.folder import PairFiles, find_pairs, held_out
from tmca.tuning.pairs import read_pair
from tmca.tuning.run import FineTuning, decoded, prepared, tuning_pictures

__all__ = ["FineTuning", "PairFiles", "decoded", "find_pairs", "held_out", "prepared", "read_pair", "tuning_pictures"]


def __dir__() -> list[str]:
    return sorted(__all__)
