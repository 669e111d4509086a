"""A format in a package of its own, as CONTRIBUTING.md shows it, is read and described like any other."""

import re
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from tests.plugin_packages import install
from tmca.data import describe, read
from tmca.data.formats.stored import OPENERS
from tmca.errors import DataError

SOURCE = re.search(r"```python\n# my_package/text_cube.py\n(.*?)```", Path("CONTRIBUTING.md").read_text(), re.S)[1]
NM = np.array([450.0, 500.0, 600.0])


@pytest.fixture
def plugin(tmp_path, monkeypatch):
    install(tmp_path, monkeypatch, "tmca.formats", "text_cube", SOURCE)
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
    with pytest.raises(DataError, match=r"b.cube3: found ValueError: .*columns.* \(line 9\) in text_cube\."):
        read(plugin / "b.cube3")


@pytest.mark.parametrize(("old", "new", "said"), [
    ("np.loadtxt(path)", "np.loadtext(path)", r"found AttributeError: .*loadtext.* \(line 9\) in text_cube\.o"),
    ("np.loadtxt(path)", "np.loadtxt(open(f'{path}.head'))", r"b.cube3: found no .*b.cube3.head that belongs to it"),
    ("return Contents", "Contents", "found a NoneType from text_cube.open_text_cube, expected Contents"),
    ("{cube.name: cube}", "{'cube': np.ones(3)}", r"found cube as a ndarray from text_cube.*from_array"),
    ("nm * 1e-9", "nm", "found wavelengths up to 600 m from text_cube.*multiply nanometres by 1e-9"),
    ('".cube3"', '".npy"', "cannot be loaded .*reads: found .npy, which tmca.data.formats.arrays reads"),
    ("return Contents", "return 1 / 0 or Contents", r"ZeroDivisionError: .* \(line 12\) in text_cube\.open_text_cube"),
    ('".cube3"', '"cube3"', "cannot be loaded .*reads: found 'cube3', expected a suffix in small letters"),
])  # fmt: skip
def test_what_is_wrong_with_a_reader_is_one_line_that_names_it(tmp_path, monkeypatch, old, new, said):
    assert old in SOURCE
    install(tmp_path, monkeypatch, "tmca.formats", "text_cube", SOURCE.replace(old, new))
    np.savetxt(tmp_path / "b.cube3", np.vstack([NM, np.ones((25, 3))]))
    try:
        with pytest.raises(DataError, match=said):
            read(tmp_path / "b.cube3")
    finally:
        OPENERS.pop(".cube3", None)
        sys.modules.pop("text_cube", None)


def test_a_reader_that_is_no_function_is_named_too(tmp_path, monkeypatch):
    monkeypatch.setitem(OPENERS, ".mine", partial(int, base=3))
    (tmp_path / "b.mine").write_text("")
    with pytest.raises(DataError, match=r"b.mine: found TypeError: .* in "):
        read(tmp_path / "b.mine")
