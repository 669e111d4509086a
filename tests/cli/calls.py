"""Commands as a user types them: what they print, and the JSON of ``--json``."""

import json

from tmca.cli import main


def run(capsys, *arguments):
    """Standard output and standard error of one command, without those of earlier ones."""
    capsys.readouterr()
    main([str(a) for a in arguments])
    return capsys.readouterr()


def said(capsys, *arguments):
    """Standard output of one command."""
    return run(capsys, *arguments).out


def answer(capsys, *arguments):
    """What a command prints with ``--json``."""
    return json.loads(said(capsys, *arguments, "--json"))
