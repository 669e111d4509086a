"""Where bands fall on the sensor."""

import pytest
import torch

from tmca.errors import SettingError
from tmca.optics import Dispersion, gaussian_psf


@pytest.mark.parametrize(
    ("displacement", "origin", "spread"),
    [((0, 1, 2), 0, 2), ((0, -1, -2), -2, 2), ((0.5, 1.5), 0, 2), ((-0.5, 0.2), -1, 2), ((3, 3), 3, 0)],
)
def test_origin_and_width_are_those_of_the_errata(displacement, origin, spread):
    dispersion = Dispersion(displacement)
    assert (dispersion.origin, dispersion.extent) == (origin, spread)


def test_taps_keep_the_light_and_its_centre():
    displacement = (0.0, 0.7, -1.25, 3.0)
    dispersion = Dispersion(displacement)
    for band, d in enumerate(displacement):
        taps = [(offset + dispersion.origin, weight) for b, offset, weight in dispersion.taps() if b == band]
        assert sum(weight for _, weight in taps) == pytest.approx(1)
        assert sum(place * weight for place, weight in taps) == pytest.approx(d)


def test_rounding_errors_make_no_taps():
    nearly = Dispersion(tuple(1.1 * band * 10 / 11 for band in range(12)))
    assert (nearly.extent, len(nearly.taps())) == (11, 12)


def test_gaussian_psf_has_unit_energy_and_the_width_asked():
    spread = gaussian_psf([0.0, 1.5], 2, radius=8).double()
    assert torch.allclose(spread.sum((1, 2)), torch.ones(2, dtype=torch.float64), atol=1e-6)
    assert spread[0, 8, 8] == 1
    axis = torch.arange(-8, 9, dtype=torch.float64)
    assert ((spread[1].sum(0) * axis**2).sum() ** 0.5).item() == pytest.approx(1.5, rel=1e-3)


def test_impossible_dispersions_are_refused():
    with pytest.raises(SettingError, match="dispersion"):
        Dispersion(())
    with pytest.raises(SettingError, match="nan"):
        Dispersion((0.0, float("nan")))
    with pytest.raises(SettingError, match="relay_blur"):
        gaussian_psf([1.0, -1.0], 2)
