"""Wrong input as a user meets it: exit code 2 and one line."""

import pytest

from tmca.cli import main


def refused(capsys, *arguments, lines=1):
    """The last of the command's lines on standard error, one unless ``lines`` says how many; None for any number."""
    capsys.readouterr()
    with pytest.raises(SystemExit) as stop:
        main([str(a) for a in arguments])
    captured = capsys.readouterr()
    assert stop.value.code == 2, captured
    said = captured.err.strip().splitlines()
    assert lines is None or len(said) == lines, captured.err
    assert "Traceback" not in captured.err
    return said[-1]
