"""A command that is asked to stop stops, wherever it is."""

import subprocess
import sys

import pytest

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


@pytest.mark.parametrize("number", ["SIGTERM", "SIGINT"])
def test_a_signal_in_a_destructor_is_not_passed_over(number):
    """Python goes on where a destructor raises: the command would end as if nobody had asked."""
    done = subprocess.run([sys.executable, "-c", COMMAND, number], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "tmca: stopped; finished files are whole\n")


def test_a_stop_that_comes_while_a_class_is_made_is_a_stop(monkeypatch, capsys):
    """Python wraps what is raised in ``__set_name__`` into a RuntimeError."""
    import tmca.cli.app
    from tmca.cli import main

    class Part:
        def __set_name__(self, owner, name):
            raise KeyboardInterrupt

    monkeypatch.setattr(tmca.cli.app, "app", lambda *tokens, **how: type("Made", (), {"part": Part()}))
    assert stopped(main, capsys)


def test_a_stop_that_comes_while_a_module_of_another_language_is_imported_is_a_stop(monkeypatch, capsys):
    """Such modules end with an ImportError of their own."""
    import tmca.cli.app
    from tmca.cli import main

    def command(*tokens, **how):
        raise ImportError("initialization failed") from KeyboardInterrupt()

    monkeypatch.setattr(tmca.cli.app, "app", command)
    assert stopped(main, capsys)


def test_a_stop_that_comes_within_a_compiled_reader_is_a_stop(monkeypatch, capsys):
    """The reader says that it was wrong, and the file is called unreadable."""
    import tmca.cli.app
    from tmca.cli import main
    from tmca.errors import DataError

    def command(*tokens, **how):
        try:
            raise SystemError("returned a result with an exception set") from KeyboardInterrupt()
        except SystemError as error:
            raise DataError("a.nc", "an unreadable file", "a whole one") from error

    monkeypatch.setattr(tmca.cli.app, "app", command)
    assert stopped(main, capsys)


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


def test_what_was_half_made_when_a_stop_came_says_nothing():
    done = subprocess.run([sys.executable, "-c", HALF_MADE], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "tmca: stopped; finished files are whole\n")


def stopped(main, capsys):
    with pytest.raises(SystemExit) as end:
        main(["decoders"])
    return end.value.code == 130 and "stopped" in capsys.readouterr().err
