"""Phase of shifted cosines: exact without noise, as uncertain as the bound says with it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tmca.errors import ShapeError
from tmca.lab.ground_truth.phase import measure_phases, phase_std


def shifted(phase, modulation, offset, steps):
    n = np.arange(steps)[:, None, None]
    return offset + modulation * np.cos(phase - 2 * np.pi * n / steps)


@settings(max_examples=25, deadline=None)
@given(steps=st.integers(3, 9), height=st.integers(1, 5), width=st.integers(1, 6), seed=st.integers(0, 99))
def test_clean_cosines_give_their_phase_modulation_and_offset(steps, height, width, seed):
    rng = np.random.default_rng(seed)
    phase = rng.uniform(-np.pi, np.pi, (2, height, width))
    modulation, offset = rng.uniform(1, 50, phase.shape), rng.uniform(50, 99, phase.shape)
    found = measure_phases(
        np.stack([shifted(p, m, o, steps) for p, m, o in zip(phase, modulation, offset, strict=True)])
    )
    assert np.allclose(np.exp(1j * found.phase), np.exp(1j * phase))
    assert np.allclose(found.modulation, modulation)
    assert np.allclose(found.offset, offset)
    assert found.misfit.max() < 1e-6


@pytest.mark.parametrize("steps", [3, 4, 7])
@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.uint16])
def test_phases_are_those_of_a_least_squares_fit_pixel_by_pixel(steps, dtype):
    frames = np.random.default_rng(0).uniform(0, 4000, (1, steps, 5, 4)).astype(dtype)
    found, angle = measure_phases(frames), 2 * np.pi * np.arange(steps) / steps
    basis = np.column_stack([np.ones(steps), np.cos(angle), np.sin(angle)])
    for y in range(5):
        for x in range(4):
            samples = frames[0, :, y, x].astype(np.float64)
            (offset, cosine, sine), *_ = np.linalg.lstsq(basis, samples, rcond=None)
            assert found.phase[0, y, x] == pytest.approx(np.arctan2(sine, cosine))
            assert found.modulation[0, y, x] == pytest.approx(np.hypot(sine, cosine))
            assert found.offset[0, y, x] == pytest.approx(offset)
            left = np.sum((samples - basis @ [offset, cosine, sine]) ** 2) / np.sum((samples - offset) ** 2)
            assert found.misfit[0, y, x] == pytest.approx(left, abs=1e-9)


@pytest.mark.parametrize("steps", [3, 4, 5, 8])
def test_the_standard_deviation_of_a_phase_is_that_of_many_captures(steps):
    rng = np.random.default_rng(steps)
    clean = shifted(np.full((100, 101), 0.7), 40.0, 60.0, steps)[None]
    found = measure_phases(clean + 2.5 * rng.standard_normal(clean.shape), noise=2.5)
    expected = phase_std(40.0, 2.5, steps)
    assert expected == pytest.approx(np.sqrt(2 / steps) * 2.5 / 40)
    assert np.std(found.phase) == pytest.approx(float(expected), rel=0.03)
    assert np.median(found.std) == pytest.approx(float(expected), rel=0.01)


@pytest.mark.parametrize(("steps", "frequencies"), [(3, 3), (4, 1), (4, 4), (7, 2)])
def test_the_noise_is_found_in_the_frames_also_of_three_steps(steps, frequencies):
    rng = np.random.default_rng(0)
    clean = np.stack([shifted(rng.uniform(-3, 3, (60, 61)), 40.0, 60.0, steps) for _ in range(frequencies)])
    found = measure_phases(clean + 1.7 * rng.standard_normal(clean.shape))
    assert found.noise == pytest.approx(1.7, rel=0.05)


def test_frames_in_the_wrong_order_are_no_cosine():
    clean = shifted(np.linspace(-3, 3, 99).reshape(9, 11), 40.0, 60.0, 4)[None]
    assert np.median(measure_phases(clean[:, [1, 0, 2, 3]]).misfit) > 0.3


@pytest.mark.parametrize(("steps", "harmonic", "stays"), [(3, 2, True), (4, 2, False), (4, 3, True), (5, 3, False)])
def test_harmonics_next_to_a_multiple_of_the_steps_stay_in_the_phase(steps, harmonic, stays):
    phase = np.linspace(-3, 3, 99).reshape(9, 11)
    angle = phase - 2 * np.pi * np.arange(steps)[:, None, None] / steps
    found = measure_phases((60 + 40 * np.cos(angle) + 4 * np.cos(harmonic * angle))[None])
    assert (np.abs(found.phase[0] - phase).max() > 0.05) == stays


def test_without_modulation_nothing_is_known():
    assert np.isinf(phase_std(0.0, 1.0, 4))


@pytest.mark.parametrize("shape", [(4, 8, 8), (1, 2, 8, 8)])
def test_too_few_axes_or_steps_are_refused(shape):
    with pytest.raises(ShapeError, match="steps ≥ 3"):
        measure_phases(np.zeros(shape))
