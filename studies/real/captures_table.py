"""Tables of the captures behind the single disperser, printed line by line as they are measured."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path

import torch

from studies.real.study import SCENES, captures_folder


def print_table(about: str, columns: str, rows_of: Callable[[Path, str, int], Iterator[str]], rows: int) -> None:
    """Print what command-line options ask for, on one thread.

    Args:
        about: the study, for ``--help``.
        columns: the first line of the table.
        rows_of: lines of a capture, from the folder of the captures, its name, and so many of its brightest rows.
        rows: taken without ``--rows``.
    """
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("data", type=Path, help="folder with tsa/, or with cassi/tsa/")
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES))
    parser.add_argument("--rows", type=int, default=rows, help="of a capture, its brightest")
    options = parser.parse_args()
    torch.set_num_threads(1)
    print(columns, "| --- " * (columns.count("|") - 1) + "|", sep="\n")
    for name in options.scenes:
        for line in rows_of(captures_folder(options.data), name, options.rows):
            print(line, flush=True)
