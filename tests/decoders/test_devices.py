"""Where decoders compute."""

import pytest
import torch
from conformance import camera_for, values_for

from tmca.cameras import Snapshot
from tmca.decoders import DECODERS, LMMSE, decode
from tmca.devices import computing_on, device_of, usual_device
from tmca.errors import SettingError


def taken():
    camera = camera_for(LMMSE, "spectral")
    return Snapshot(values_for(camera)[:1], camera, {"scene": "smooth"})


def test_a_snapshot_goes_to_a_device_as_a_copy():
    snapshot = taken()
    there = snapshot.to("cpu")
    assert there.camera is not snapshot.camera
    assert torch.equal(there.camera.codes()[0], snapshot.camera.codes()[0])
    assert torch.equal(there.values, snapshot.values)
    assert there.notes == snapshot.notes


def test_a_device_that_is_named_computes_the_same():
    snapshot = taken()
    here = decode(snapshot, "dagger")
    assert torch.equal(here.values, decode(snapshot, "dagger", device="cpu").values)
    with computing_on("cpu"):
        assert usual_device() == torch.device("cpu")
        assert torch.equal(here.values, decode(snapshot, "dagger").values)
    assert usual_device() is None
    with computing_on(None):
        assert usual_device() is None


@pytest.mark.parametrize("name", ["cuda:99", "nowhere", "", "cpu:-3", "meta", "hpu", ["cpu"]])
def test_a_device_that_is_not_there_is_refused(name):
    with pytest.raises(SettingError, match="one of this machine: cpu") as refusal:
        device_of(name)
    assert refusal.value.where == "device"
    with pytest.raises(SettingError):
        decode(taken(), "dagger", device=name)
    with pytest.raises(SettingError), computing_on(name):
        pass


def test_a_device_without_room_is_told_in_one_line(monkeypatch):
    def greedy(self, prepared, values, progress):
        raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 20.00 GiB.")

    monkeypatch.setattr(DECODERS["dagger"], "reconstruct", greedy)
    with pytest.raises(SettingError, match=r"20.00 GiB.*compute on the cpu") as refusal:
        decode(taken(), "dagger")
    assert "\n" not in str(refusal.value)
    with pytest.raises(SettingError, match="compute on the cpu"):
        DECODERS["dagger"]().prepare(taken().camera)(taken())
    with pytest.raises(SettingError, match=r"20.00 GiB.*compute on the cpu"), computing_on("cpu"):
        greedy(None, None, None, None)
    assert usual_device() is None
