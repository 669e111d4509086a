"""Learned codes and networks by name, as a user meets them."""

import pytest

from tmca.cameras import Snapshot
from tmca.cli import main
from tmca.decoders import find_weights

SCENE = ["coffee", "--crop", "40x48", "--no-figures", "--out", "s.nc"]


@pytest.mark.parametrize(("options", "slots"), [([], 8), (["--slots", "1"], 1)])
def test_default_weights_take_and_decode_a_snapshot(tmp_path, options, slots):
    main(["simulate", "spectral", *SCENE, "--weights", "default", *options, "--read-noise", "0.01"])
    camera = Snapshot.load(tmp_path / "s.nc").camera
    weights = find_weights("default", slots)
    assert camera.slots == slots
    aperture, _ = camera.codes()
    assert (aperture[:, :32, :32] == weights.codes["aperture"]).all()
    main(["reconstruct", "s.nc", "--weights", "default", "--no-figures"])
    assert (tmp_path / "s_network.nc").exists()
