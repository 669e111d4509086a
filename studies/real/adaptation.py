"""What adaptation to a real capture gives: ``python -m studies.real.adaptation DATA --scenes real_scene1 --rows 48``.

Of the brightest rows of captures behind the single disperser, 5 % of the pixels are withheld from every decoder. The
table says how well each predicts them.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch

from studies.bench import import_capture
from studies.real.merit import brightest_rows, neighbours_error, prediction_error, withheld
from studies.real.study import MASK, SCENES, captures_folder, single_disperser
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path, help="folder with tsa/, or with cassi/tsa/")
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES))
    parser.add_argument("--rows", type=int, default=48, help="of a capture, its brightest")
    options = parser.parse_args()
    torch.set_num_threads(1)
    print("| capture | decoder | withheld pixels | adaptation | CPU s |\n| --- | --- | --- | --- | --- |")
    for name in options.scenes:
        for line in rows_of(captures_folder(options.data), name, options.rows):
            print(line, flush=True)


if __name__ == "__main__":
    main()
