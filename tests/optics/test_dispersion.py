"""Where bands fall on the sensor."""

import pytest

from tmca.errors import SettingError
from tmca.optics import Dispersion, gaussian_spread


@pytest.mark.parametrize(
    ("displacement", "origin", "spread"),
    [((0, 1, 2), 0, 2), ((0, -1, -2), -2, 2), ((0.5, 1.5), 0, 2), ((-0.5, 0.2), -1, 2), ((3, 3), 3, 0)],
)
def test_origin_and_width_are_those_of_the_errata(displacement, origin, spread):
    dispersion = Dispersion(displacement)
    assert (dispersion.origin, dispersion.spread) == (origin, spread)


def test_taps_keep_the_light_and_its_centre():
    displacement = (0.0, 0.7, -1.25, 3.0)
    dispersion = Dispersion(displacement)
    for band, d in enumerate(displacement):
        taps = [(offset + dispersion.origin, weight) for b, offset, weight in dispersion.taps() if b == band]
        assert sum(weight for _, weight in taps) == pytest.approx(1)
        assert sum(place * weight for place, weight in taps) == pytest.approx(d)


def test_rounding_errors_make_no_taps():
    nearly = Dispersion(tuple(1.1 * band * 10 / 11 for band in range(12)))
    assert (nearly.spread, len(nearly.taps())) == (11, 12)


def test_impossible_dispersions_are_refused():
    with pytest.raises(SettingError, match="dispersion"):
        Dispersion(())
    with pytest.raises(SettingError, match="nan"):
        Dispersion((0.0, float("nan")))
    with pytest.raises(SettingError, match="relay blur"):
        gaussian_spread([1.0, -1.0], 2)
