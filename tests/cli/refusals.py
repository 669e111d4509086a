"""Wrong input as a user meets it: exit code 2 and one line."""

import pytest

from tmca.cli import main


def refused(capsys, *arguments):
    """The line on standard error."""
    with pytest.raises(SystemExit) as stop:
        main([str(a) for a in arguments])
    captured = capsys.readouterr()
    assert stop.value.code == 2, captured
    lines = captured.err.strip().splitlines()
    assert len(lines) == 1, captured.err
    assert "Traceback" not in captured.err
    return lines[0]
