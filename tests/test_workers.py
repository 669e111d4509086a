"""Work in other processes: results by their place, the error of one, and the end of all."""

import os
import time

import pytest

from tmca.errors import SettingError
from tmca.workers import in_processes


def squared(number):
    if number < 0:
        raise SettingError("number", str(number), "0 or more")
    return number**2, os.getpid()


def one_raises_the_other_writes(number, started, late):
    """A negative number raises once the other has begun; the other writes 3 s later, unless it is stopped."""
    if number < 0:
        until = time.monotonic() + 60
        while not started.exists() and time.monotonic() < until:
            time.sleep(0.01)
        squared(number)
    started.touch()
    time.sleep(3)
    late.touch()


@pytest.mark.slow
def test_results_come_from_other_processes_by_their_place():
    done = dict(in_processes(squared, [(3,), (4,), (5,)], 2))
    assert {place: square for place, (square, _) in done.items()} == {0: 9, 1: 16, 2: 25}
    assert os.getpid() not in {process for _, process in done.values()}


@pytest.mark.slow
def test_what_one_raises_stops_the_others(tmp_path):
    started, late = tmp_path / "started", tmp_path / "late"
    with pytest.raises(SettingError, match="number: found -1, expected 0 or more"):
        list(in_processes(one_raises_the_other_writes, [(-1, started, late), (4, started, late)], 2))
    assert started.exists()
    assert not late.exists()
