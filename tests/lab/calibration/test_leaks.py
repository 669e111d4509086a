"""Leaking codes, from frames of the package's faulty cameras to a calibration that images as they do."""

import numpy as np
import pytest
import torch
from PIL import Image

from tmca.cameras import Hardware, SpectralCamera, imperfect
from tmca.errors import DataError
from tmca.lab.calibration.apply import calibrated
from tmca.lab.calibration.captures import calibration_patterns, write_patterns
from tmca.lab.calibration.file import Calibration, load_calibration
from tmca.lab.calibration.fits import StepSettings
from tmca.lab.calibration.steps import measure

SIZES, SLOTS, WHITE, OFFSET = [(32, 41), (33, 40)], 3, 30000.0, 400.0
WAVE = 550e-9


def one_band(size, slots, aperture, shutter="open"):
    """A camera of one wavelength, whose mask lies on the sensor."""
    return SpectralCamera((WAVE,), size, slots, dispersion=[0.0], aperture=aperture, shutter=shutter)


def recorded(camera, rng):
    """A frame of a white scene in digital numbers, 1 electron a number."""
    with torch.no_grad():
        share = camera.A(torch.ones(1, *camera.scene_shape))[0, 0].double().numpy() / camera.full_scale
    return rng.poisson(WHITE * share) + OFFSET + 5 * rng.standard_normal(share.shape)


def pictures(folder, frames):
    folder.mkdir()
    for name, frame in frames.items():
        Image.fromarray(np.round(frame).astype(np.uint16)).save(folder / f"{name}.png")
    return folder


def measured(folder, size, hardware):
    """A calibration from captures of a faulty bench: dark, patterns, pairs of slots."""
    rng = np.random.default_rng(7)
    write_patterns(folder / "shown", size)
    shown = torch.from_numpy(calibration_patterns(size)).float()
    planes = torch.eye(SLOTS)[:, :, None, None].expand(-1, -1, *size)
    pairs = {(i, j): one_band(size, SLOTS, planes[i], planes[j]) for i in range(SLOTS) for j in range(SLOTS)}
    seen = {f"p_{i}": recorded(imperfect(one_band(size, 1, one[None]), hardware), rng) for i, one in enumerate(shown)}
    timing = {f"aperture_{i}_shutter_{j}": recorded(imperfect(own, hardware), rng) for (i, j), own in pairs.items()}
    darks = {f"d_{i}": OFFSET + 5 * rng.standard_normal(size) for i in range(8)}
    found = measure("dark", Calibration.empty("bench"), pictures(folder / "dark", darks))
    found = measure(
        "registration", found, pictures(folder / "seen", seen), StepSettings(folder / "shown", wavelength=WAVE)
    )
    return measure("timing", found, pictures(folder / "timing", timing))


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_mirrored_mask_is_told(tmp_path, mirrored):
    size = SIZES[0]
    write_patterns(tmp_path / "shown", size)
    rng = np.random.default_rng(0)
    seen = {f"p_{i}": 400 + 9000 * one + rng.normal(0, 5, size) for i, one in enumerate(calibration_patterns(size))}
    frames = {name: np.fliplr(one) if mirrored else one for name, one in seen.items()}
    found = measure(
        "registration", Calibration.empty(), pictures(tmp_path / "seen", frames), StepSettings(tmp_path / "shown")
    )
    assert found.about["steps"]["registration"]["residuals"]["mirrored"] == mirrored


def test_a_slot_is_captured_with_both_beside_it(tmp_path):
    found = measured(tmp_path, SIZES[0], Hardware(delay=0.1))
    (tmp_path / "timing" / "aperture_1_shutter_2.png").unlink()
    with pytest.raises(DataError, match=r"no aperture_1_shutter_2, expected every slot .* with both beside it"):
        measure("timing", found, tmp_path / "timing")


def left(camera, other, scene):
    """What an operator's image leaves of the faulty camera's, root mean square."""
    with torch.no_grad():
        return float((camera.A(scene) - other.A(scene)).square().mean().sqrt())


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize(("ratio", "leakage", "delay"), [(50.0, 0.02, 0.0), (80.0, 0.12, 0.2)])
def test_a_bench_that_leaks_is_calibrated_from_its_frames(tmp_path, size, ratio, leakage, delay):
    hardware = Hardware(contrast_ratio=ratio, leakage=leakage, delay=delay)
    found = load_calibration(measured(tmp_path, size, hardware).save(tmp_path / "cam").path)
    steps = found.about["steps"]
    assert steps["registration"]["residuals"]["contrast_ratio"] == pytest.approx(ratio, rel=0.02)
    assert steps["timing"]["residuals"]["leakage"] == pytest.approx(leakage, abs=2e-3)
    assert steps["timing"]["settings"]["aperture_leakage"] == found.part("registration").leakage
    assert found.part("timing").delay == pytest.approx(delay, abs=2e-3)
    camera = one_band(size, SLOTS, "random", "one-hot")
    bench, scene = imperfect(camera, hardware), torch.rand(1, 1, *size)
    own = left(calibrated(camera, found.without("dark")), bench, scene)
    assert own < 0.1 * left(camera, bench, scene)
