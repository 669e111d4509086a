"""The command line: it parses, calls and prints; it computes nothing."""

from __future__ import annotations

import os
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING

from tmca.cli.stopping import end, listen, stop_behind
from tmca.errors import TmcaError, did_you_mean

if TYPE_CHECKING:
    from cyclopts import MissingArgumentError, UnknownCommandError

_FEW_CORES = 4
"""Up to here one thread is the safe choice: two threads that wait for a busy core were measured 5 to 8 times slower."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the ``tmca`` command; wrong input gives one line on standard error and exit code 2."""
    if (os.cpu_count() or 1) <= _FEW_CORES:
        os.environ.setdefault("OMP_NUM_THREADS", "1")
    from tmca.cli.app import GUIDE, app

    warnings.showwarning = _lines_once()
    if threading.current_thread() is threading.main_thread():
        listen()
    tokens = list(sys.argv[1:] if arguments is None else arguments)
    if not tokens:
        print(GUIDE, end="")
        return
    try:
        if _asks_for_help(tokens):
            from tmca.cli.help import print_help

            print_help(app, tokens)
            return
        app(tokens, exit_on_error=False, print_error=False, result_action="return_value")
    except (Exception, KeyboardInterrupt) as error:
        if (stop := stop_behind(error)) is not None:
            end(stop)
        _say_why(error, tokens)


def _say_why(error: BaseException, tokens: list[str]) -> None:
    """One line and exit code 2; what is no user's fault is raised again."""
    from cyclopts import CycloptsError

    if isinstance(error, CycloptsError):
        _leave(_misspelt(error, tokens))
    if isinstance(error, TmcaError):
        _leave(_in_options(error, tokens))
    if isinstance(error, MemoryError) or (isinstance(error, (RuntimeError, ImportError)) and "allocate" in str(error)):
        _leave("found too little memory for this size, expected less; use --crop, fewer --bands or fewer --slots")
    if isinstance(error, BrokenPipeError):
        sys.exit(0)
    if isinstance(error, PermissionError):
        _leave(f"{error.filename}: found no permission, expected a file and folder that may be used")
    if isinstance(error, OSError):
        _leave(f"{error.filename or 'output'}: found {error.strerror or error}, expected a file that can be used")
    from tmca.plugins import foreign_failure

    foreign = None if sys.flags.dev_mode else foreign_failure(error)
    if foreign is not None:
        _leave(str(foreign))
    raise error


def _asks_for_help(tokens: list[str]) -> bool:
    options = tokens[: tokens.index("--")] if "--" in tokens else tokens
    return not {"--help", "-h", "--help-all"}.isdisjoint(options)


def _misspelt(error: Exception, tokens: list[str]) -> str:
    """What the command line cannot take, in one line; a value that a spec refuses like every other error."""
    from cyclopts import MissingArgumentError, UnknownCommandError, UnknownOptionError, UnusedCliTokensError
    from pydantic import ValidationError

    if isinstance(error.__cause__, ValidationError):
        from tmca.specs import first_error

        return _in_options(first_error(error.__cause__), tokens)
    if isinstance(error, UnusedCliTokensError):
        return f"found {' '.join(error.unused_tokens or ())!r} too much, expected what --help of this command shows"
    if isinstance(error, UnknownOptionError):
        known = [name for one in error.argument_collection for name in one.names]
        return _unknown_option(error.token.keyword or error.token.value, known)
    if isinstance(error, MissingArgumentError):
        return _missing(error)
    if isinstance(error, UnknownCommandError) and error.command_chain and _token(error).startswith("-"):
        return _no_command(error)
    said = " ".join(str(error).split())
    return said if tokens else f"{said} Try `tmca --help`."


def _unknown_option(option: str, known: Iterable[str]) -> str:
    remedy = did_you_mean(option, known, "leave it out")
    return f"{option}: found an unknown option, expected one that --help-all of this command lists; {remedy}"


def _token(error: UnknownCommandError) -> str:
    """What is no command."""
    return (error.unused_tokens or [""])[0]


def _no_command(error: UnknownCommandError) -> str:
    """An option where the name of a command belongs, such as a camera's."""
    option = _token(error)
    command = " ".join(error.command_chain or ())
    known = [name for name in error.app or () if not name.startswith("-")]
    expected = f"one of {', '.join(known)} before it"
    return f"{command}: found {option}, expected {expected}; such as tmca {command} {known[0]} {option}"


def _missing(error: MissingArgumentError) -> str:
    """An argument that is required, or the value of an option; where one was misspelt, that option."""
    assert error.argument is not None
    known = error.argument.names
    options = [one.partition("=")[0] for one in error.unused_tokens or () if one.startswith("--")]
    misspelt = [option for option in options if option not in known and did_you_mean(option, known)]
    if misspelt and error.keyword is None:
        return _unknown_option(misspelt[0], known)
    command = " ".join(("tmca", *(error.command_chain or ())))
    return f"{error.keyword or error.argument.name}: found nothing, expected a value; {command} --help says which"


def _in_options(error: TmcaError, tokens: list[str]) -> str:
    """The error's line; a field that the command has an option for, or that ``--set`` or ``--reading`` gives, is named
    by it."""
    from tmca.cli.app import app

    field, space, rest = error.where.partition(" ")
    option = f"--{field.replace('_', '-')}"
    given = [(by, name) for by, name in _names_given(tokens) if field in (name, name.rpartition(".")[2])]
    if given and option not in tokens:
        return f"{' '.join(given[0])}{str(error)[len(field) :]}"
    if not field.replace("-", "_").isidentifier():
        return str(error)
    has_option = error.where.isprintable() and option in _options_of(*app.parse_commands(tokens)[0])
    return f"{option}{space}{rest}{str(error)[len(error.where) :]}" if has_option else str(error)


@cache
def _options_of(*words: str) -> frozenset[str]:
    """Names of all options of a command."""
    from tmca.cli.app import app

    command = app.parse_commands(words)[1][-1]
    return frozenset(name for argument in command.assemble_argument_collection() for name in argument.names)


def _names_given(tokens: list[str]) -> list[tuple[str, str]]:
    """Options that take NAME=VALUE, and the names that they give."""
    pairs = [*pairwise(tokens), *((option, value) for option, _, value in (one.partition("=") for one in tokens))]
    return [(option, value.partition("=")[0].strip()) for option, value in pairs if option in ("--set", "--reading")]


def _lines_once() -> Callable[..., None]:
    """What shows warnings: ours in one line each, once; others only where Python was asked for them (``-W``)."""
    said: set[str] = set()

    def show(message: Warning | str, category: type[Warning], *place: object, **more: object) -> None:
        if str(message) not in said and (category.__module__.startswith("tmca") or sys.warnoptions):
            said.add(str(message))
            print(f"tmca: warning: {message}", file=sys.stderr)

    return show


def _leave(message: str) -> None:
    print(f"tmca: {message}", file=sys.stderr)
    sys.exit(2)
