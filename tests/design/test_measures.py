"""Figures of codes, against what is known of simple ones and against plain computation."""

import numpy as np
import pytest
import torch
from scipy.fft import dctn

from tmca.cameras import SpectralCamera
from tmca.design.measures import measures
from tmca.errors import SettingError, ShapeError
from tmca.operators import sparse_matrix


def camera(**settings):
    return SpectralCamera(**{"bands": 3, "size": (6, 14), "slots": 4, **settings})


def test_a_static_code_looks_alike_in_every_band():
    found = measures(camera(slots=1, shutter="open"), block=(2, 7))
    assert found.likeness == pytest.approx(1)
    assert set(found.levels) == {0.0, 1.0}
    share = found.levels[1.0]
    assert found.contrast == pytest.approx(((1 - share) / share) ** 0.5)


@pytest.mark.parametrize("exposure", ["equal", "per-slot"])
def test_levels_are_multiples_of_a_slots_share(exposure):
    found = measures(camera(exposure=exposure), block=(2, 7))
    assert set(found.levels) <= {0, 0.25, 0.5, 0.75, 1}
    assert sum(found.levels.values()) == pytest.approx(1)
    assert found.throughput == pytest.approx(sum(v * p for v, p in found.levels.items()))


def test_bands_correlate_as_numpy_says():
    own = camera(size=(9, 17))
    expected = np.corrcoef(own.code_cube().flatten(1).numpy())
    np.testing.assert_allclose(measures(own, block=(2, 7)).band_correlation, expected, atol=1e-6)


@pytest.mark.parametrize("dispersion", [1.0, 0.5])
def test_singular_values_and_coherence_are_those_of_the_cameras_matrix(dispersion):
    """A frame of light all around a block has the block's complete measurements among its own."""
    own = camera(size=(2, 7), dispersion=dispersion)
    found = measures(own, block=(2, 7), blocks=1, seed=3)
    top, left = torch.randint(1 << 16, (1, 2), generator=torch.Generator().manual_seed(3)).tolist()[0]
    code = own.operator().taps.code.roll((-top, -left), (1, 2))
    spread = own.dispersion.extent
    taps = own.operator().taps
    rolled = type(own.operator())(type(taps)(code, taps.channels, taps.offsets, 3, taps.snapshot_width))
    dense = np.asarray(sparse_matrix(rolled).todense()).reshape(2, 7 + spread, -1)
    complete = dense[:, spread:7].reshape(-1, dense.shape[-1])
    np.testing.assert_allclose(found.singular_values, np.linalg.svd(complete, compute_uv=False), atol=1e-6)
    seen = dctn(complete.reshape(-1, 3, 2, 7), axes=(1, 2, 3), norm="ortho").reshape(len(complete), -1)
    seen = seen[:, np.linalg.norm(seen, axis=0) > 1e-9]
    seen = seen / np.linalg.norm(seen, axis=0)
    cosines = np.abs(seen.T @ seen) - np.eye(seen.shape[1])
    assert found.coherence == pytest.approx(cosines.max(), abs=1e-6)


def test_what_cannot_be_measured_is_refused():
    with pytest.raises(SettingError, match="relay_blur"):
        measures(camera(relay_blur=0.5))
    with pytest.raises(ShapeError, match="dispersion"):
        measures(camera(), block=(2, 2))


def test_two_buckets_are_measured_together():
    """Both read the whole light between them, and what one bucket leaves unseen the other sees."""
    both = measures(camera(shutter="random", buckets=2), block=(2, 7))
    assert both.throughput == pytest.approx(2 * sum(v * p for v, p in both.levels.items()))
    assert both.singular_values.numel() == 2 * measures(camera(), block=(2, 7)).singular_values.numel()
    cube = camera(shutter="random", buckets=2).code_cube().movedim(0, 1).flatten(1)
    np.testing.assert_allclose(both.band_correlation, np.corrcoef(cube.numpy()), atol=1e-6)
