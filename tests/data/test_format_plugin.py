"""A format in a package of its own, as CONTRIBUTING.md shows it, is read and described like any other."""

import importlib
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from tmca.data import describe, read
from tmca.data.formats.stored import OPENERS
from tmca.errors import DataError

SOURCE = re.search(r"```python\n# my_package/text_cube.py\n(.*?)```", Path("CONTRIBUTING.md").read_text(), re.S)[1]
NM = np.array([450.0, 500.0, 600.0])


@pytest.fixture
def plugin(tmp_path, monkeypatch):
    about = tmp_path / "text_cube-1.0.dist-info"
    about.mkdir()
    (tmp_path / "text_cube.py").write_text(SOURCE)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: text_cube\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[tmca.formats]\ntext_cube = text_cube\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    importlib.invalidate_caches()
    yield tmp_path
    OPENERS.pop(".cube3", None)
    sys.modules.pop("text_cube", None)


def test_it_is_read_and_described(plugin):
    spectra = np.random.default_rng(0).random((25, 3))
    np.savetxt(plugin / "a.cube3", np.vstack([NM, spectra]))
    cube = read(plugin / "a.cube3")
    np.testing.assert_allclose(cube.values, spectra.T.reshape(3, 5, 5), rtol=1e-6)
    np.testing.assert_allclose(cube["wavelength_nm"], NM)
    about = describe(plugin / "a.cube3")
    assert (about["kind"], about["format"], about["spectral_axis"]) == ("cube", "text cube", 2)


def test_a_damaged_file_is_named(plugin):
    (plugin / "b.cube3").write_text("450 500\nrubbish\n")
    with pytest.raises(DataError, match=r"b.cube3: found an unreadable or truncated file"):
        read(plugin / "b.cube3")
