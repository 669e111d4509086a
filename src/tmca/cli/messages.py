"""Errors in the words of the command line: the option of the command that was called, instead of the field."""

from __future__ import annotations

from collections.abc import Sequence

from tmca.errors import TmcaError


def in_options(error: TmcaError, given: Sequence[str] = ()) -> str:
    """The error's line; a field that the command has an option for is named by it."""
    option = f"--{error.where.replace('_', '-').replace(' ', '-')}"
    if not error.where.isprintable() or option not in _options(given):
        return str(error)
    return f"{option}{str(error)[len(error.where) :]}"


def _options(given: Sequence[str]) -> set[str]:
    """Options of the command that these words call."""
    from tmca.cli.app import app

    command = app.parse_commands(list(given))[1][-1]
    return {name for argument in command.assemble_argument_collection() for name in argument.names}
