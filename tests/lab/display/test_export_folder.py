"""The folder of an export: whatever stops its writing, the old one or the new one is there whole."""

import shutil
from pathlib import Path

import pytest

from tests.lab.acquisition.test_capture import exported
from tests.lab.display.test_export import spectral
from tmca.lab.display.codes import read_planes
from tmca.lab.display.devices import device_named
from tmca.lab.display.export import export_codes
from tmca.lab.display.manifest import check_export

OLD, NEW = 0.1, 0.2


def contents(folder):
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def again(tmp_path, folder):
    devices = [device_named(name) for name in ("dli4120", "emulated-shutter")]
    return export_codes(read_planes(tmp_path / "taken.nc"), devices, folder, exposure=NEW, overwrite=True)


@pytest.mark.parametrize("standing", [False, True], ids=["beside", "inside"])
@pytest.mark.parametrize("after", [False, True], ids=["before", "after"])
@pytest.mark.parametrize("step", range(6))
def test_an_export_that_is_stopped_at_any_step_leaves_one_whole(tmp_path, monkeypatch, step, after, standing):
    folder, count, own = exported(tmp_path, spectral()), [], Path.rename
    before = contents(folder)

    def stopped(self, target):
        count.append(target)
        if len(count) == step + 1 and not after:
            raise KeyboardInterrupt
        found = own(self, target)
        if len(count) == step + 1:
            raise KeyboardInterrupt
        return found

    if standing:
        monkeypatch.chdir(folder)
    monkeypatch.setattr(Path, "rename", stopped)
    if step < (6 if standing else 2):  # three entries of either, or the folders themselves
        with pytest.raises(KeyboardInterrupt):
            again(tmp_path, "." if standing else folder)
        assert contents(folder) == before
    else:
        again(tmp_path, folder)
    monkeypatch.undo()
    assert check_export(folder)["exposure_s"] == (OLD if contents(folder) == before else NEW)
    assert not [file.name for file in tmp_path.iterdir() if file.name.startswith(".")]


def test_what_is_left_of_an_old_export_does_not_undo_the_new_one(tmp_path, monkeypatch):
    folder = exported(tmp_path, spectral())

    def stopped(place, ignore_errors=False):
        if Path(place).name.endswith(".old"):
            raise KeyboardInterrupt
        own(place, ignore_errors)

    own = shutil.rmtree
    monkeypatch.setattr(shutil, "rmtree", stopped)
    with pytest.raises(KeyboardInterrupt):
        again(tmp_path, folder)
    assert check_export(folder)["exposure_s"] == NEW


def test_a_link_leads_to_the_folder_of_the_export(tmp_path):
    folder = exported(tmp_path, spectral())
    (tmp_path / "link").symlink_to(folder, target_is_directory=True)
    again(tmp_path, tmp_path / "link")
    assert (tmp_path / "link").is_symlink()
    assert check_export(folder)["exposure_s"] == NEW
