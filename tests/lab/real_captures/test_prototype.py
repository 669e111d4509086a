"""Descriptions of prototypes: those of the package are whole, wrong ones are refused in one line."""

import numpy as np
import pytest

from tests.lab.real_captures.bench import DESCRIBED, NM, prototype_of
from tmca.errors import DataError, SettingError
from tmca.lab.prototype import PixelShutter, SingleDisperser, load_prototype, prototype_names


def test_the_package_brings_both_prototypes():
    assert prototype_names() == ["pixel-shutter-wine", "tsa"]
    tsa, wine = load_prototype("tsa"), load_prototype("pixel-shutter-wine")
    assert isinstance(tsa, SingleDisperser)
    assert isinstance(wine, PixelShutter)
    assert (len(tsa.wavelengths_nm), tsa.wavelengths_nm[0], tsa.wavelengths_nm[-1]) == (28, 453.3, 648.1)
    assert set(tsa.points) == set(tsa.scenes)


def test_a_response_by_bandwidth_is_the_width_of_the_bands(tmp_path):
    response = prototype_of(tmp_path, DESCRIBED).response_of_bands()
    widths = np.array([10, 12.5, 17.5, 20])
    np.testing.assert_allclose(response, widths / widths.mean())
    np.testing.assert_array_equal(prototype_of(tmp_path, DESCRIBED, response="flat").response_of_bands(), 1)
    own = prototype_of(tmp_path, DESCRIBED, response=[1.0, 1.0, 2.0, 4.0]).response_of_bands()
    np.testing.assert_allclose(own, [0.5, 0.5, 1, 2])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"wavelengths_nm": NM[::-1]}, "wavelengths_nm that rise"),
        ({"response": [1.0, 2.0]}, "a response of 2 values for 4 bands"),
        ({"white": 0.05}, "white above black"),
        ({"saturation": 0.1}, "saturation above black"),
        ({"pixels_per_band": None}, "pixels_per_band"),
        ({"colour": "blue"}, "colour: found an unknown name, expected one of .*wavelengths_nm"),
        ({"kind": "lens"}, "kind"),
        ({"turned": 45}, "turned"),
        ({"registration": {"scale": [2.0, 1.0]}}, "registration.scale"),
        ({"wavelengths_nm": [nm / 1000 for nm in NM]}, "wavelengths_nm.0: Input should be greater than 100"),
        ({"registration": {"blur": np.inf}}, "registration.blur: Input should be a finite number"),
        ({"registration": {"shift": [0.0, np.nan]}}, "finite numbers"),
        ({"black": np.nan}, "finite numbers"),
        ({"pixels_per_band": np.inf}, "pixels_per_band: Input should be a finite number"),
    ],
)
def test_wrong_descriptions_are_refused(tmp_path, changes, said):
    with pytest.raises(DataError, match=said):
        prototype_of(tmp_path, DESCRIBED, **changes)


def test_unknown_names_and_files_that_are_no_yaml_are_refused(tmp_path):
    with pytest.raises(SettingError, match="pixel-shutter-wine, tsa, or a YAML file"):
        load_prototype("nothing")
    (tmp_path / "bad.yaml").write_text("{kind: [")
    with pytest.raises(DataError, match="no readable YAML"):
        load_prototype(tmp_path / "bad.yaml")
