"""Codes of sensors with several buckets come back from their frames; what such a sensor cannot do is refused."""

import numpy as np
import pytest
import torch

from tests.lab.display.test_export import export, spectral
from tmca.cameras import SpectralDepthCamera
from tmca.codes import write_codes
from tmca.errors import SettingError
from tmca.lab.display.codes import read_planes
from tmca.lab.display.devices import DeviceDescription, device_named
from tmca.lab.display.export import export_codes
from tmca.lab.display.manifest import read_export, read_frame, read_manifest

TWO = "coded-exposure-two-bucket"


def sensor(**about):
    return DeviceDescription(name="sensor", kind="coded-exposure", **about)


def sorted_codes(buckets, slots=3, size=(12, 18), drained=False):
    """(R, K, H, W) a bucket of every slot, or none."""
    owner = torch.randint(buckets + drained, (slots, *size), generator=torch.Generator().manual_seed(1))
    return (owner == torch.arange(buckets)[:, None, None, None]).float()


@pytest.mark.parametrize(
    ("settings", "device"),
    [
        ({"buckets": 2}, device_named(TWO)), ({"buckets": 2, "shutter": "burst"}, device_named(TWO)),
        ({"buckets": 2, "shutter": sorted_codes(2)}, device_named(TWO)),
        ({"buckets": 2, "shutter": sorted_codes(2, drained=True)}, sensor(buckets=2, drain=True, bits=2)),
        ({"buckets": 2}, sensor(buckets=2, drain=True, bits=8)),
        ({"buckets": 3, "shutter": sorted_codes(3)}, sensor(buckets=3, bits=2)),
        ({"buckets": 3, "shutter": "burst"}, sensor(buckets=3, bits=2)),
    ],
)  # fmt: skip
def test_what_every_bucket_collects_comes_back(tmp_path, settings, device):
    camera = spectral(**settings)
    folder = export(tmp_path, camera, "dli4120", device).folder
    found, codes = read_export(folder), read_planes(tmp_path / "taken.nc")
    assert found.buckets == camera.buckets
    assert found.slots == 3
    assert torch.equal(found.planes["shutter"], codes.planes["shutter"])
    assert len(read_manifest(folder)["planes"][1]["frames"]) == 3


def test_a_bit_says_which_of_two_buckets(tmp_path):
    camera = SpectralDepthCamera.from_preset("quick", size=(16, 18), slots=2, buckets=2)
    folder = export(tmp_path, camera, TWO).folder
    plane = read_manifest(folder)["planes"][0]
    assert plane["units"] == "0 = bucket 2, 1 = bucket 1"
    shown = np.stack([read_frame(folder / frame["file"]) for frame in plane["frames"]])
    np.testing.assert_array_equal(shown, camera.codes()[1].numpy())


def test_a_tile_that_a_sensor_holds_is_shown_all_over(tmp_path):
    export(tmp_path, spectral(buckets=2, period=4), "dli4120", f"{TWO}-tile")


@pytest.mark.parametrize(
    ("settings", "device", "words"),
    [
        ({"buckets": 2}, device_named("coded-exposure"), "codes of 2 buckets, expected 1"),
        ({"buckets": 2}, device_named("emulated-shutter"), "codes of 2 buckets, expected 1"),
        ({}, device_named(TWO), "the light of closed slots to a drain, expected 2"),
        ({"buckets": 2, "shutter": sorted_codes(2, drained=True)}, device_named(TWO), "in no bucket.*has no drain"),
        ({"buckets": 2}, device_named(TWO, pattern_rate_hz=20), "20 at most"),
        ({"buckets": 2}, device_named(TWO, memory_patterns=2), "2 at most in its memory"),
        ({"buckets": 2}, device_named(f"{TWO}-tile"), "does not repeat, expected one .* every 4×4.*--period 4,"),
        ({"buckets": 2, "period": 6}, device_named(f"{TWO}-tile"), "found a shutter that repeats every 6×6 pixels"),
        ({"buckets": 2, "period": 6}, device_named(f"{TWO}-tile", tile=(3, 5)), "every 3×5.*from a file"),
    ],
)  # fmt: skip
def test_what_a_sensor_cannot_do_leaves_nothing(tmp_path, settings, device, words):
    with pytest.raises(SettingError, match=words):
        export(tmp_path, spectral(**settings), "dli4120", device)
    assert [file.name for file in tmp_path.iterdir()] == ["taken.nc"]


def test_a_slot_in_two_buckets_is_refused(tmp_path):
    twice = sorted_codes(2)
    twice[:, 1, 2, 3] = 1
    file = write_codes(tmp_path / "codes.nc", torch.ones(3, 12, 16), twice.flatten(0, 1), None, buckets=2)
    with pytest.raises(SettingError, match=r"slot 1 of pixel \(2, 3\) in buckets 0 and 1, .* close it in all but one"):
        export_codes(read_planes(file), [device_named(TWO)], tmp_path / "out")


@pytest.mark.parametrize(
    ("about", "words"),
    [
        ({"buckets": 2, "drain": True}, "3 places"),
        ({"buckets": 3}, "3 places"),
        ({"kind": "dmd", "buckets": 2}, "no more"),
    ],
)
def test_sensors_that_no_frame_tells_apart_are_refused(about, words):
    with pytest.raises(ValueError, match=words):
        DeviceDescription(**{"name": "s", "kind": "coded-exposure", "size": (4, 4)} | about)
