"""Cameras of other packages: their entry point is loaded once a camera is asked for by its kind."""

import sys

import pytest

from tests.plugin_packages import install
from tmca.applications import APPLICATIONS, application_of
from tmca.cameras import CAMERAS
from tmca.errors import SettingError
from tmca.plugins import BrokenPlugin, load_plugins

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
    yield lambda text: install(tmp_path, monkeypatch, "tmca.cameras", "pinhole_package", text)
    load_plugins.cache_clear()
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
    with pytest.warns(BrokenPlugin, match="pinhole_package.*a_package_that_is_not_there"), pytest.raises(SettingError):
        application_of("pinhole")


def test_one_of_a_kind_that_there_is_is_warned_of_and_left_out(installed):
    before = CAMERAS["spectral"]
    installed(PACKAGE.replace('"pinhole"', '"spectral"', 1))
    taken = "Pinhole.kind: found 'spectral', which tmca.cameras.spectral has"
    with pytest.warns(BrokenPlugin, match=taken), pytest.raises(SettingError, match="'pinhole', which has no camera"):
        application_of("pinhole")
    assert CAMERAS["spectral"] is before
