"""Help pages: every titled group stands by itself."""

import pytest

from tmca.cli import main


@pytest.mark.parametrize("command", ["spectral", "light-field", "spectral-depth"])
def test_a_title_follows_an_empty_line(command, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    main(["design", command, "--help"])
    lines = capsys.readouterr().out.splitlines()
    titles = [place for place, line in enumerate(lines) if line.startswith("── ")]
    assert len(titles) > 2
    assert not any(lines[place - 1].strip() for place in titles)
    assert len(lines) <= 40
