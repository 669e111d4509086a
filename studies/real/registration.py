"""What register masks give real captures: ``python -m studies.real.registration DATA --scenes real_scene1``.

Every capture is taken with the mask as its file has it, with the place that the prototype's blocks tell, and with that
of most evidence, which the capture alone tells. The table says how well ADMM-TV then predicts 5 % of the pixels of the
brightest rows, which it is not shown (the ten numbers of the place come from the whole capture).
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

from torch import Tensor
from torch.nn.functional import pad

from studies.bench import import_capture, without_pixels
from studies.real.captures_table import print_table
from studies.real.merit import brightest_rows, neighbours_error, prediction_error, withheld
from studies.real.study import MASK, single_disperser
from tmca.cameras import Snapshot, SpectralCamera
from tmca.decoders import decode
from tmca.registration import register


def rows_of(folder: Path, name: str, rows: int) -> Iterator[str]:
    """Lines of the table of one capture."""
    capture, prototype, mask = folder / f"tsa/{name}.mat", single_disperser(), folder / MASK
    as_filed = type(prototype.registration)()
    filed = import_capture(capture, prototype.model_copy(update={"registration": as_filed}), mask)
    hidden = withheld(brightest_rows(filed, rows))[1]
    yield f"| {name} | as filed | {withheld_error(filed, rows, hidden)} | | |"
    yield f"| {name} | by blocks | {withheld_error(import_capture(capture, prototype, mask), rows, hidden)} | | |"
    begun = time.process_time()
    found = register(filed)
    seconds = time.process_time() - begun
    there = filed.camera.dispersion.origin - found.snapshot.camera.dispersion.origin  # its sensor may begin elsewhere
    moved = pad(hidden.float(), (there, found.snapshot.values.shape[3] - hidden.shape[1] - there)) > 0
    yield f"| {name} | by evidence | {withheld_error(found.snapshot, rows, moved)} | {found} | {seconds:.0f} |"


def withheld_error(snapshot: Snapshot[SpectralCamera], rows: int, hidden: Tensor) -> str:
    """Error of ADMM-TV over hidden pixels (rows, W') of the brightest rows, and that of the mean of their
    neighbours."""
    part = brightest_rows(snapshot, rows)
    estimate = decode(without_pixels(part, hidden), "admm-tv-joint").values.float()
    error = prediction_error(part.camera.operator(), estimate, part.values, hidden)
    return f"{error:.2%} | {neighbours_error(part.values, hidden):.2%}"


if __name__ == "__main__":
    print_table(
        __doc__ or "", "| capture | mask | withheld pixels | mean of neighbours | place | CPU s |", rows_of, 200
    )
