"""Cameras of other packages: their entry point is loaded once a camera is asked for by its kind."""

import sys

import pytest

from tmca.applications import APPLICATIONS, application_of
from tmca.cameras import CAMERAS, load_cameras
from tmca.cameras.plugins import BrokenCamera
from tmca.errors import SettingError

PACKAGE = """
from tmca.applications import SpectralApplication
from tmca.cameras import SpectralCamera

class Pinhole(SpectralCamera):
    kind = "pinhole"

class PinholeApplication(SpectralApplication):
    kind = "pinhole"
"""


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """A package with a camera, as pip installs it."""

    def install(text):
        (tmp_path / "pinhole_package.py").write_text(text)
        about = tmp_path / "pinhole_package-1.dist-info"
        about.mkdir()
        (about / "METADATA").write_text("Metadata-Version: 2.1\nName: pinhole-package\nVersion: 1\n")
        (about / "entry_points.txt").write_text("[tmca.cameras]\npinhole = pinhole_package\n")
        monkeypatch.syspath_prepend(tmp_path)

    load_cameras.cache_clear()
    yield install
    load_cameras.cache_clear()
    sys.modules.pop("pinhole_package", None)
    CAMERAS.pop("pinhole", None)
    APPLICATIONS.pop("pinhole", None)


def test_the_entry_point_of_another_package_is_found(installed):
    installed(PACKAGE)
    assert "pinhole" not in CAMERAS
    assert application_of("pinhole").kind == "pinhole"
    assert CAMERAS["pinhole"].__module__ == "pinhole_package"


def test_one_that_cannot_be_loaded_is_warned_of_and_left_out(installed):
    installed("import a_package_that_is_not_there")
    with pytest.warns(BrokenCamera, match="pinhole_package.*a_package_that_is_not_there"), pytest.raises(SettingError):
        application_of("pinhole")
