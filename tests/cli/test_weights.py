"""Learned codes and networks by name, as a user meets them."""

import pytest

from tests.cli.refusals import refused
from tmca.cameras import Snapshot
from tmca.cli import main
from tmca.decoders import find_weights

SCENE = ["coffee", "--crop", "40x48", "--no-figures", "--out", "s.nc"]


@pytest.mark.parametrize(("options", "slots"), [([], 8), (["--slots", "1"], 1), (["--slots", "8"], 8)])
def test_default_weights_take_and_decode_a_snapshot(tmp_path, monkeypatch, options, slots):
    monkeypatch.chdir(tmp_path)
    main(["simulate", "spectral", *SCENE, "--weights", "default", *options, "--read-noise", "0.01"])
    camera = Snapshot.load(tmp_path / "s.nc").camera
    weights = find_weights("default", slots)
    assert camera.slots == slots
    aperture, _ = camera.codes()
    assert (aperture[:, :32, :32] == weights.codes["aperture"]).all()
    main(["reconstruct", "s.nc", "--weights", "default", "--no-figures"])
    assert (tmp_path / "s_network.nc").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--aperture", "random"], "--aperture beside weights"),
        (["--preset", "thesis"], "--preset beside weights"),
        (["--relay-blur", "0.5"], "--relay-blur beside weights"),
        (["--slots", "4"], "found 4, expected 8"),
        (["--bands", "6"], "12 bands"),
    ],
)
def test_what_learned_codes_do_not_go_with_is_refused(tmp_path, monkeypatch, capsys, options, words):
    monkeypatch.chdir(tmp_path)
    assert words in refused(capsys, "simulate", "spectral", *SCENE, "--weights", "default", *options)
    assert not (tmp_path / "s.nc").exists()


def test_weights_that_are_not_there(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert "no such file" in refused(capsys, "simulate", "spectral", *SCENE, "--weights", "my_rum")
