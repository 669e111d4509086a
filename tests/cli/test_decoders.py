"""``tmca decoders``, and its page in the documents."""

import json
from pathlib import Path

from tmca.cli import main
from tmca.cli.decoders import markdown
from tmca.decoders import DECODERS

PAGE = Path(__file__).parents[2] / "docs" / "decoders.md"


def test_every_decoder_is_listed(capsys):
    main(["decoders", "--json"])
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)}
    assert set(rows) == set(DECODERS)
    assert rows["mixture"]["prior"] == "mixture"
    assert rows["lmmse"]["uncertainty"] is True
    main(["decoders"])
    assert capsys.readouterr().out == markdown()


def test_the_page_is_current():
    assert PAGE.read_text().endswith("\n\n" + markdown(plugins=False)), "run: python tests/cli/test_decoders.py"


if __name__ == "__main__":
    PAGE.write_text(PAGE.read_text().split("\n\n| decoder |")[0] + "\n\n" + markdown(plugins=False))
