"""A command that is asked to stop stops, wherever it is."""

import subprocess
import sys

import pytest

import tmca.cli.app
from tmca.cli import main
from tmca.errors import DataError

COMMAND = """
import os, signal, sys, time
import tmca.cli.app
from tmca.cli import main

class Asked:
    def __del__(self):
        os.kill(os.getpid(), getattr(signal, sys.argv[1]))
        for _ in range(1000):
            pass

def command(tokens, **how):
    Asked()
    time.sleep(30)

tmca.cli.app.app = command
main(["simulate"])
"""


HALF_MADE = """
import sys
import tmca.cli.app
from tmca.cli import main

class Half:
    def __init__(self):
        raise KeyboardInterrupt
    def __del__(self):
        self.closed

def command(tokens, **how):
    Half()

tmca.cli.app.app = command
main(["simulate"])
"""


REPLACED = """
import os, signal, sys
import tmca.cli.app
from tmca.cli import main
from tmca.errors import DataError

def command(tokens, **how):
    try:
        os.kill(os.getpid(), getattr(signal, sys.argv[1]))
        for _ in range(1000):
            pass
    except KeyboardInterrupt:
        pass
    error = {"TypeError": TypeError, "OSError": OSError, "DataError": DataError}[sys.argv[2]]
    raise error("a.nc", "Operation not defined for data type class", "data")  # as HDF5 says from within a conversion

tmca.cli.app.app = command
main(["simulate"])
"""


@pytest.mark.parametrize("arguments", [(COMMAND, "SIGTERM"), (COMMAND, "SIGINT"), (HALF_MADE,)])
def test_a_signal_in_a_destructor_is_not_passed_over_and_what_was_half_made_says_nothing(arguments):
    """Python goes on where a destructor raises: the command would end as if nobody had asked."""
    assert_stops(*arguments)


@pytest.mark.parametrize(
    ("name", "error"),
    [("SIGTERM", "TypeError"), ("SIGTERM", "OSError"), ("SIGTERM", "DataError"), ("SIGINT", "TypeError")],
)
def test_a_stop_that_a_compiled_library_replaces_by_an_error_of_its_own_is_a_stop(name, error):
    assert_stops(REPLACED, name, error)


@pytest.mark.parametrize(("error", "code", "word"), [("TypeError", 1, "Traceback"), ("DataError", 2, "found")])
def test_an_error_that_nobody_asked_for_is_shown(error, code, word):
    done = subprocess.run([sys.executable, "-c", REPLACED, "SIGWINCH", error], capture_output=True, text=True)
    assert done.returncode == code
    assert word in done.stderr


HOST = """
import signal
from tmca.cli import main

mine = lambda number, frame: None
for handler in (mine, signal.SIG_IGN):
    signal.signal(signal.SIGINT, handler)
    main([])
    assert signal.getsignal(signal.SIGINT) is handler
"""


def test_a_handler_of_the_host_and_a_signal_that_is_ignored_stay():
    subprocess.run([sys.executable, "-c", HOST], check=True, capture_output=True)


HANDLED = """
import os, signal, sys
import tmca.cli.app
from tmca.cli import main
from tmca.cli.stopping import handled
from tmca.errors import DataError

def command(tokens, **how):
    try:
        os.kill(os.getpid(), signal.SIGINT)
        for _ in range(1000):
            pass
    except KeyboardInterrupt:
        handled()
    raise DataError("a.nc", "a full disk", "space")

tmca.cli.app.app = command
main(["simulate"])
"""


def test_an_error_after_a_stop_that_the_command_handled_is_said():
    done = subprocess.run([sys.executable, "-c", HANDLED], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (2, "tmca: a.nc: found a full disk, expected space\n")


def assert_stops(*arguments):
    done = subprocess.run([sys.executable, "-c", *arguments], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "tmca: stopped; finished files are whole\n")


class Part:
    def __set_name__(self, owner, name):
        raise KeyboardInterrupt


def class_made(*tokens, **how):
    """Python wraps what is raised in ``__set_name__`` into a RuntimeError."""
    type("Made", (), {"part": Part()})


def compiled_module(*tokens, **how):
    """Modules of another language end with an ImportError of their own."""
    raise ImportError("initialization failed") from KeyboardInterrupt()


def compiled_reader(*tokens, **how):
    """The reader says that it was wrong, and the file is called unreadable."""
    try:
        raise SystemError("returned a result with an exception set") from KeyboardInterrupt()
    except SystemError as error:
        raise DataError("a.nc", "an unreadable file", "a whole one") from error


@pytest.mark.parametrize("command", [class_made, compiled_module, compiled_reader])
def test_a_stop_that_another_error_wraps_is_a_stop(command, monkeypatch, capsys):
    monkeypatch.setattr(tmca.cli.app, "app", command)
    with pytest.raises(SystemExit) as end:
        main(["decoders"])
    assert end.value.code == 130
    assert "stopped" in capsys.readouterr().err
