"""What `tmca inspect` says of weights: the camera that they decode, as they give it."""

import json

import pytest

from tests.cli.refusals import refused
from tmca.cli import main
from tmca.decoders.nets.weights import FOLDER, Weights


@pytest.mark.parametrize("name", ["multiplexed", "universal"])
def test_weights_are_described_by_their_camera_and_network(name, capsys):
    file, weights = FOLDER / f"{name}.safetensors", Weights.load(FOLDER / f"{name}.safetensors")
    main(["inspect", str(file), "--json"])
    about = json.loads(capsys.readouterr().out)
    assert (about["camera"], about["slots"], tuple(about["size"])) == (weights.kind, weights.slots, weights.size)
    assert about["bands"]["count"] == len(weights.wavelengths)
    assert about["decoder"]["parameters"] == sum(one.numel() for one in weights.network.parameters())
    main(["inspect", str(file)])
    said = capsys.readouterr().out
    assert ("any codes" in said) == (name == "universal")
    assert ("12, 400 to 700 nm" in said) == (name == "multiplexed")
    assert len(said.splitlines()) <= 8


def test_what_holds_no_weights_is_one_line(tmp_path, capsys):
    (tmp_path / "none.safetensors").write_bytes(b"nothing")
    assert "none.safetensors" in refused(capsys, "inspect", str(tmp_path / "none.safetensors"))
    file = str(FOLDER / "universal.safetensors")
    assert "--conditioning" in refused(capsys, "inspect", file, "--conditioning")
