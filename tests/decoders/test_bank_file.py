"""Banks in files: read as written, made anew where they are damaged, refused where they are something else."""

import re
from dataclasses import replace
from functools import cache
from warnings import catch_warnings, simplefilter

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from tests.small_scenes import smooth_scene
from tmca.cameras import Snapshot, SpectralCamera
from tmca.decoders import bank, bank_file, decode
from tmca.decoders.bank_file import DamagedBank
from tmca.decoders.lmmse import PatchEstimator
from tmca.errors import DataError, OutputError, SettingError
from tmca.priors import GaussianPrior
from tmca.sensor import Sensor

CAMERA = SpectralCamera(
    3, (21, 30), slots=4, shutter="balanced", buckets=2, period=(4, 6), sensor=Sensor(read_noise=0.01)
)


@cache
def taken():
    prior = GaussianPrior.learn([smooth_scene(40, 50, 3, seed=1)], (6, 12))
    return Snapshot(CAMERA(smooth_scene(*CAMERA.size, 3, seed=2).float()[None], generator=0), CAMERA), prior


def by_bank(path, snapshot=None, prior=None, **settings):
    usual = taken()
    return decode(snapshot or usual[0], "lmmse", prior=prior or usual[1], bank=path, uncertainty=True, **settings)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """An estimate by a bank, and what is in the bank's file."""
    path = tmp_path_factory.mktemp("bank") / "b.safetensors"
    return by_bank(path), path.read_bytes()


@pytest.fixture
def path(written, tmp_path):
    """A file of this bank."""
    file = tmp_path / "b.safetensors"
    file.write_bytes(written[1])
    return file


def test_a_bank_in_a_file_decodes_as_the_one_that_was_computed(tmp_path, monkeypatch):
    path, (snapshot, prior) = tmp_path / "b.safetensors", taken()
    first = by_bank(path)
    monkeypatch.setattr(bank.Bank, "of", None)  # it is read
    again = by_bank(path)
    assert torch.equal(first.values, again.values)
    assert torch.equal(first.deviation, again.deviation)
    torch.testing.assert_close(again.values, decode(snapshot, "lmmse", prior=prior).values, atol=1e-4, rtol=0)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
    (tmp_path / "other").touch()
    assert path.stat().st_mode == (tmp_path / "other").stat().st_mode


def test_a_bank_of_another_camera_noise_or_prior_is_refused_and_stays(path):
    snapshot, before = taken()[0], path.read_bytes()
    other = [
        {"snapshot": replace(snapshot, camera=snapshot.camera.replace(seed=1))},
        {"snapshot": replace(snapshot, camera=snapshot.camera.replace(sensor=Sensor(read_noise=0.02)))},
        {"prior": GaussianPrior.learn([smooth_scene(40, 50, 3, seed=7)], (6, 12))},
    ]
    for parts in other:
        with pytest.raises(DataError, match="another camera, noise, prior or setting"):
            by_bank(path, **parts)
    assert path.read_bytes() == before


@pytest.mark.parametrize("content", [b"", b"abc" * 100, b"\x00" * 64])
def test_what_is_no_bank_is_refused_and_stays(tmp_path, content):
    path = tmp_path / "b.safetensors"
    path.write_bytes(content)
    with pytest.raises(DataError, match=r"b\.safetensors.*name another file"):
        by_bank(path)
    assert path.read_bytes() == content
    save_file({"a": torch.zeros(3)}, path)
    with pytest.raises(DataError, match="something else"):
        by_bank(path)
    save_file({"a": torch.zeros(3)}, path, {"format": "tmca bank 1"})
    with pytest.raises(DataError, match="found the format tmca bank 1, expected tmca bank 3"):
        by_bank(path)
    (tmp_path / "folder").mkdir()
    with pytest.raises(DataError, match="name another file"):
        by_bank(tmp_path / "folder")
    for wrong in (3, False, "a\0b"):
        with pytest.raises(SettingError, match="expected a path"):
            by_bank(wrong)


def rewritten(path, change):
    """The same file with other tensors, whose sums are right."""
    with safe_open(path, "pt") as file:
        head, tensors = file.metadata(), {name: file.get_tensor(name).clone() for name in file.keys()}  # noqa: SIM118
    change(tensors)
    sums = ", ".join(str(bank_file._sum(tensors[name])) for name in sorted(tensors, key=order) if name in tensors)
    head["tmca"] = re.sub(r'"sums": \[.*\]', f'"sums": [{sums}]', head["tmca"])
    save_file(tensors, path, head)


def order(name):
    """As the file lists them."""
    place, _, part = name.partition(".")
    frames = ("", "offset", "deviation", "code")
    return frames.index("" if part else place), place, bank_file._PARTS.index(part) if part else 0


CHANGES = {
    "a pixel beyond the frame": lambda t: t["00000.pixels"].fill_(10**9),
    "a measurement before the snapshot": lambda t: t["00000.down"].fill_(-1),
    "a measurement beyond the snapshot": lambda t: t["00001.across"].fill_(10**6),
    "a pixel twice": lambda t: t["00000.pixels"][0].fill_(int(t["00001.pixels"].flatten()[0])),
    "places without an axis": lambda t: t.update({"00000.down": t["00000.down"][0].clone()}),
    "a deviation in double precision": lambda t: t.update(deviation=t["deviation"].double()),
    "no number": lambda t: t["00000.matrix"].fill_(float("nan")),
    "whole numbers": lambda t: t.update({"00000.matrix": t["00000.matrix"].int()}),
    "fewer pixels": lambda t: t.update({"00000.matrix": t["00000.matrix"][:, :-1].contiguous()}),
    "an offset of other channels": lambda t: t.update(offset=t["offset"][:, :-1].contiguous()),
    "no deviation": lambda t: t.pop("deviation"),
    "another frame": lambda t: t.update(deviation=t["deviation"][..., :-1].contiguous()),
}


def test_a_bank_that_was_written_by_other_software_is_read(written, path, recwarn):
    rewritten(path, lambda tensors: None)
    assert torch.equal(written[0].values, by_bank(path).values)
    assert not [warning for warning in recwarn if warning.category is DamagedBank]


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_a_bank_whose_parts_do_not_go_together_is_made_anew(written, path, change):
    first = written[0]
    rewritten(path, change)
    with pytest.warns(DamagedBank, match="made anew"):
        again = by_bank(path)
    assert torch.equal(first.values, again.values)
    assert torch.equal(first.values, by_bank(path).values)


DAMAGES = {
    "a flipped bit": lambda content: content[:-100] + bytes([content[-100] ^ 4]) + content[-99:],
    "cut": lambda content: content[: len(content) // 2],
    "another head": lambda content: content.replace(b"boxes", b"boxen", 1),
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_file_is_made_anew(written, path, damage):
    first, content = written
    path.write_bytes(damage(content))
    with pytest.warns(DamagedBank, match="made anew"):
        assert torch.equal(first.values, by_bank(path).values)
    with catch_warnings():
        simplefilter("error")
        assert torch.equal(first.values, by_bank(path).values)


def test_a_code_with_other_last_bits_is_the_same(path):
    snapshot, prior = taken()
    taps = snapshot.camera.taps()
    near = replace(taps, code=taps.code * (1 + 1e-7))
    assert PatchEstimator(prior, near, snapshot.camera.noise).precompute(path).bank is not None
    with pytest.raises(DataError, match="another camera"):
        PatchEstimator(prior, replace(taps, code=taps.code * 1.001), snapshot.camera.noise).precompute(path)


def test_decoders_without_a_bank_say_so(tmp_path, monkeypatch):
    path, (snapshot, _) = tmp_path / "b.safetensors", taken()
    with pytest.raises(SettingError, match="dagger has nothing to store"):
        decode(snapshot, "dagger", bank=path)
    monkeypatch.setattr(bank, "MOST_BYTES", 1000)
    with pytest.raises(SettingError, match="codes that repeat themselves"):
        by_bank(path)
    assert not path.exists()


def test_a_bank_that_cannot_be_written_is_told(tmp_path):
    with pytest.raises(OutputError, match="no such folder"):
        by_bank(tmp_path / "none" / "b.safetensors")
