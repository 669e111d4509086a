"""``tmca decoders``, and its page in the documents."""

import json
from pathlib import Path

from tests.cli.refusals import refused
from tmca.cli import main
from tmca.cli.decoders import markdown, table
from tmca.cli.new import names_of, rendered
from tmca.decoders import DECODERS

PAGE = Path(__file__).parents[2] / "docs" / "decoders.md"


def test_every_decoder_is_listed(capsys):
    main(["decoders", "--json"])
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)}
    assert set(rows) == set(DECODERS)
    assert rows["mixture"]["prior"] == "mixture"
    assert rows["lmmse"]["uncertainty"] is True
    main(["decoders"])
    assert capsys.readouterr().out == markdown(table())


def test_one_decoder_is_listed_alone_that_of_a_file_too(capsys, tmp_path):
    main(["decoders", "lmmse"])
    assert capsys.readouterr().out.count("\n| `") == 1
    file = tmp_path / "net.py"
    file.write_text(rendered("decoder", names_of("my-net"))["my_net.py"])
    try:
        main(["decoders", f"{file}:MyNet"])
    finally:
        DECODERS.pop("my-net", None)
    said = capsys.readouterr().out
    assert "| `my-net` |" in said
    assert "- `gain` (float, 1.0): factor." in said
    assert "WHICH: found 'lmse', expected" in refused(capsys, "decoders", "lmse")


def test_the_page_is_current():
    assert PAGE.read_text().endswith("\n\n" + markdown(table(plugins=False))), "run: python tests/cli/test_decoders.py"


def test_a_camera_has_its_own_decoders(capsys):
    main(["decoders", "light-field", "--json"])
    rows = json.loads(capsys.readouterr().out)
    assert {"dictionary", "lmmse"} <= {row["name"] for row in rows} < {*DECODERS}
    assert all("light-field" in row["cameras"] for row in rows)
    assert "did you mean light-field?" in refused(capsys, "decoders", "lightfield")


if __name__ == "__main__":
    PAGE.write_text(PAGE.read_text().split("\n\n| decoder |")[0] + "\n\n" + markdown(table(plugins=False)))
