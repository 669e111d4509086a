"""Blocks on which designs are judged: as small as a camera allows, so that a search takes seconds."""

from __future__ import annotations

from tmca.errors import SettingError
from tmca.operators.taps import Taps
from tmca.priors.blocks import BlockModel

_ROWS, _JUDGED, _SQUARE = 4, 26, 9
_MOST_ENTRIES = 9000
"""Measurements times taps of a block: two matrices of that side, in double precision, are 1.3 GB."""


def design_model(taps: Taps, rows: int = _ROWS) -> BlockModel:
    """The block model of a camera's taps for designs.

    For 12 bands at one pixel per band it is 4×48: on real cubes codes found on it are as good under 12×36 blocks as
    codes found on 8×48 in four times the time. Where nothing is displaced, as behind the mask of a light-field camera,
    it is 9×9 or what fits.

    Raises:
        SettingError: a dispersion so wide, or so many bands, that no block fits the memory.
    """
    span = max(taps.offsets) - min(taps.offsets)
    if span == 0:
        side = min(_SQUARE, max(1, int((_MOST_ENTRIES / len(taps.offsets)) ** 0.5)))
        return BlockModel.of(taps, (taps.scene_channels, side, side))
    for height in range(rows, 0, -1):
        for judged in (_JUDGED, _JUDGED // 2, 6):
            model = BlockModel.of(taps, (taps.scene_channels, height, 2 * span + judged))
            if model.measurements * len(taps.offsets) <= _MOST_ENTRIES:
                return model
    found = f"{len(taps.offsets)} taps over {span} pixels"
    raise SettingError("bands", found, "blocks of 1.3 GB at most", "design with fewer bands or a smaller dispersion")
