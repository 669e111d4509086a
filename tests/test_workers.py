"""Work in other processes: results by their place, the error of one, and the end of all."""

import os

import pytest

from tmca.errors import SettingError
from tmca.workers import in_processes


def squared(number):
    if number < 0:
        raise SettingError("number", str(number), "0 or more")
    return number**2, os.getpid()


@pytest.mark.slow
def test_results_come_from_other_processes_by_their_place():
    done = dict(in_processes(squared, [(3,), (4,), (5,)], 2))
    assert {place: square for place, (square, _) in done.items()} == {0: 9, 1: 16, 2: 25}
    assert os.getpid() not in {process for _, process in done.values()}


@pytest.mark.slow
def test_what_one_raises_stops_the_others():
    with pytest.raises(SettingError, match="number: found -1, expected 0 or more"):
        list(in_processes(squared, [(-1,), (4,)], 2))
