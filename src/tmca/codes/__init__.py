"""What the aperture and the shutter show in each time slot."""

from tmca.codes.buckets import BURST, bucket_shutters
from tmca.codes.files import CodesFile, read_codes, write_codes
from tmca.codes.imperfect import Outside, leaked, misplaced, slot_overlap, through_time
from tmca.codes.multiplexed import Codes, MultiplexedCodes, fitted_codes
from tmca.codes.patterns import FAMILIES, balanced_choice, blue_noise_ranks, one_hot_planes, pattern
from tmca.codes.plane import CodePlane, check_shares, hard_threshold, one_hot_slots, shutter_plane, tile_of

__all__ = [
    "BURST",
    "FAMILIES",
    "CodePlane",
    "Codes",
    "CodesFile",
    "MultiplexedCodes",
    "Outside",
    "balanced_choice",
    "blue_noise_ranks",
    "bucket_shutters",
    "check_shares",
    "fitted_codes",
    "hard_threshold",
    "leaked",
    "misplaced",
    "one_hot_planes",
    "one_hot_slots",
    "pattern",
    "read_codes",
    "shutter_plane",
    "slot_overlap",
    "through_time",
    "tile_of",
    "write_codes",
]


def __dir__() -> list[str]:
    return sorted(__all__)
