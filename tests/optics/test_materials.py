"""Refractive indices against published values and the database they are from."""

from pathlib import Path

import numpy as np
import pytest

from tmca.errors import DataError, SettingError
from tmca.optics.phase import MATERIALS, Material

TABLES = Path(__file__).parents[3] / "shared" / "data" / "tables" / "refractiveindex"
FRAUNHOFER = {"F": 486.1327e-9, "d": 587.5618e-9, "C": 656.2725e-9}
PUBLISHED = {  # n_d and Abbe number V_d of the makers' sheets; PMMA varies
    "fused-silica": (1.45846, 67.82),
    "N-BK7": (1.51680, 64.17),
    "N-SF11": (1.78472, 25.68),
    "PMMA": (1.4918, None),
}


@pytest.mark.parametrize("name", PUBLISHED)
def test_the_index_and_dispersion_are_those_of_the_sheet(name):
    blue, yellow, red = MATERIALS[name].index(list(FRAUNHOFER.values()))
    index, abbe = PUBLISHED[name]
    assert yellow == pytest.approx(index, abs=1e-3 if name == "PMMA" else 1e-5)
    assert abbe is None or (yellow - 1) / (blue - red) == pytest.approx(abbe, rel=2e-3)


@pytest.mark.skipif(not TABLES.exists(), reason="no tables beside the repository")
@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("fused-silica", "main_SiO2_nk_Malitson"),
        ("N-BK7", "specs_schott_optical_N-BK7"),
        ("N-SF11", "specs_schott_optical_N-SF11"),
        ("PMMA", "organic__C5H8O2_n_-_poly_methyl_methacrylate__nk_Beadie"),
        ("NOA61", "NOA-61_nk_Norland"),
        ("SU-8", "SU-8_2000_specs"),
    ],
)
def test_named_materials_are_those_of_the_database(name, file):
    stored = Material.read(TABLES / f"{file}.yml")
    wavelengths = np.linspace(450e-9, 680e-9, 7)
    np.testing.assert_allclose(MATERIALS[name].index(wavelengths), stored.index(wavelengths), rtol=1e-12)
    assert MATERIALS[name].limits == pytest.approx(stored.limits)


@pytest.mark.skipif(not TABLES.exists(), reason="no tables beside the repository")
def test_tabulated_indices_are_read_between_their_rows():
    material = Material.named(str(TABLES / "NOA-61_nk_Joseph.yml"))
    assert material.index([0.2466e-6])[0] == pytest.approx((1.65978 + 1.65582) / 2, abs=1e-9)


def test_what_is_not_known_is_refused(tmp_path):
    with pytest.raises(SettingError, match=r"400 nm.*450 to 1550 nm"):
        MATERIALS["NOA61"].index([400e-9])
    with pytest.raises(SettingError, match="one of fused-silica"):
        Material.named("glass")
    with pytest.raises(DataError, match="no such file"):
        Material.named(str(tmp_path / "none.yml"))
    for text in ("DATA: 3", "DATA:\n - type: formula 9\n", "DATA:\n - type: formula 1\n", "{"):
        (tmp_path / "bad.yml").write_text(text)
        with pytest.raises(DataError, match=r"bad\.yml"):
            Material.read(tmp_path / "bad.yml")
