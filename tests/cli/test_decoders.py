"""``tmca decoders``, and its page in the documents."""

import json
from pathlib import Path

from tests.cli.refusals import refused
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


def test_a_camera_has_its_own_decoders(capsys):
    main(["decoders", "light-field", "--json"])
    rows = json.loads(capsys.readouterr().out)
    assert {"dictionary", "lmmse"} <= {row["name"] for row in rows} < {*DECODERS}
    assert all("light-field" in row["cameras"] for row in rows)
    assert "did you mean light-field?" in refused(capsys, "decoders", "lightfield")


if __name__ == "__main__":
    PAGE.write_text(PAGE.read_text().split("\n\n| decoder |")[0] + "\n\n" + markdown(plugins=False))
