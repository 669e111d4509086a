"""What adaptation to a real capture gives: ``python -m studies.real.adaptation DATA --scenes real_scene1 --rows 48``.

Of the brightest rows of captures behind the single disperser, 5 % of the pixels are withheld from every decoder. The
table says how well each predicts them.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from studies.bench import import_capture
from studies.real.captures_table import print_table
from studies.real.merit import brightest_rows, neighbours_error, prediction_error, withheld
from studies.real.study import MASK, single_disperser
from tmca.decoders import decode

DECODERS: dict[str, tuple[str, dict[str, Any]]] = {
    "admm-tv-joint": ("admm-tv-joint", {}),
    "pnp-subspace": ("pnp-subspace", {}),
    "universal network": ("network", {"weights": "universal"}),
    "adapted, with the stop": ("network", {"weights": "universal", "adapt": 60}),
    "from ADMM-TV": ("network", {"weights": "universal", "start": "admm-tv-joint"}),
    "from ADMM-TV, adapted": ("network", {"weights": "universal", "start": "admm-tv-joint", "adapt": 60}),
}


def rows_of(folder: Path, name: str, rows: int) -> Iterator[str]:
    """Lines of the table of one capture."""
    whole = import_capture(folder / f"tsa/{name}.mat", single_disperser(), folder / MASK)
    part = brightest_rows(whole, rows)
    blind, hidden = withheld(part)
    yield f"| {name} | mean of neighbours | {neighbours_error(part.values, hidden):.2%} | | |"
    for label, (decoder, settings) in DECODERS.items():
        begun = time.process_time()
        estimate = decode(blind, decoder, **settings)
        seconds = time.process_time() - begun
        error = prediction_error(part.camera.operator(), estimate.values.float(), part.values, hidden)
        yield f"| {name} | {label} | {error:.2%} | {estimate.notes.get('adapted', '')} | {seconds:.0f} |"


if __name__ == "__main__":
    print_table(__doc__ or "", "| capture | decoder | withheld pixels | adaptation | CPU s |", rows_of, 48)
