"""Faults of time and scenes that move on the simulated bench, against the exposure followed moment by moment."""

import pytest
import torch

from tests.lab.acquisition.test_capture import bench_of, exported, one_pattern, scene_of
from tests.lab.display.test_export import mirror, spectral
from tmca.cameras import Hardware, LightFieldCamera, imperfect, moving_scenes
from tmca.errors import SettingError
from tmca.lab.acquisition.session import capture, joined

SHUTTERS = ["emulated-shutter", "coded-exposure"]
_MOMENTS = 4000


def captured(folder, camera, shutter, hardware, **settings):
    first = "dmp40" if hasattr(camera, "planes") else "dli4120"
    export, bench = exported(folder, camera, first, shutter), bench_of(camera, black=100, hardware=hardware, **settings)
    return joined(capture(export, bench, folder / "frames", gain=bench.gain), export, camera), bench.gain


def slow(camera, scene, hardware):
    """Snapshot of frames of one slot each, masked and averaged, row by row and moment by moment."""
    aperture, shutter = camera.codes()
    alone = torch.stack([one_pattern(camera, pattern, scene[0]) for pattern in aperture])
    rows, slots = camera.size[0], camera.slots
    since = (torch.arange(_MOMENTS) + 0.5) / _MOMENTS
    since = since[since >= hardware.dead_time]
    found = torch.zeros(1, 1, *camera.snapshot_shape[1:])
    for slot in range(slots):
        for row in range(rows):
            late = hardware.delay + hardware.rolling * row / (rows - 1)
            time = slot + late + since
            shown, turned = time.floor().long(), time - time.floor()
            share = (turned / hardware.switching).clamp(max=1) if hardware.switching else torch.ones_like(turned)
            seen = torch.zeros(slots).index_add(0, shown % slots, share / _MOMENTS)
            seen = seen.index_add(0, (shown - 1) % slots, (1 - share) / _MOMENTS)
            light = (seen[:, None] * alone[:, row]).sum(0)
            found[0, 0, row] += shutter[slot, row] * light / slots
    return found


@pytest.mark.parametrize(
    ("size", "faults"),
    [((8, 9), {"delay": 0.3}), ((9, 12), {"rolling": 0.8}), ((8, 9), {"switching": 0.4}),
     ((9, 12), {"dead_time": 0.25}), ((8, 9), {"delay": -0.2, "rolling": 1.5})],
)  # fmt: skip
def test_late_frames_of_an_ordinary_camera_see_their_neighbours(tmp_path, size, faults):
    camera = spectral(size)
    found, step = captured(tmp_path, camera, "emulated-shutter", Hardware(**faults))
    wanted = slow(camera, scene_of(camera)[0], Hardware(**faults))
    assert float((found.values - wanted).abs().max()) <= 1.01 * step + 9 / _MOMENTS
    assert float((found.values - camera(*scene_of(camera))).abs().max()) > 0.05


EVERY = [
    spectral(), spectral(exposure="per-slot"), LightFieldCamera(views=3, size=(9, 11), slots=2), mirror(),
]  # fmt: skip


LATE, JITTER = {"delay": 0.3, "rolling": 0.2, "switching": 0.1}, {"jitter": 0.1}


@pytest.mark.parametrize(
    ("camera", "faults"),
    [*((camera, LATE) for camera in EVERY), (EVERY[0], JITTER), (EVERY[-1], JITTER)],
    ids=["spectral", "per slot", "light field", "spectral-depth", "spectral jitter", "spectral-depth jitter"],
)
def test_frames_that_are_masked_afterwards_are_as_late_as_a_shutter_that_is_coded(tmp_path, camera, faults):
    """Σ_k S_k Σ_m w_km T_m is Σ_m T_m Σ_k w_km S_k."""
    values = []
    for shutter in SHUTTERS:
        (tmp_path / shutter).mkdir()
        found, step = captured(tmp_path / shutter, camera, shutter, Hardware(**faults))
        values.append(found.values)
    allowed = step * (1 + camera.slots) + 2e-3 * float(hasattr(camera, "planes"))
    torch.testing.assert_close(*values, atol=allowed, rtol=0)
    assert float((values[0] - camera(*scene_of(camera))).abs().max()) > 3 * allowed


@pytest.mark.parametrize("shutter", SHUTTERS)
@pytest.mark.parametrize(
    ("camera", "faults"),
    [(EVERY[0], {"motion": (1.0, -2.0)}), (EVERY[1], {"motion": 3.0, "delay": 0.2}), (EVERY[2], {"motion": 2.0})],
    ids=["spectral", "per slot", "light field"],
)
def test_a_scene_moves_before_the_bench(tmp_path, camera, shutter, faults):
    hardware, scene = Hardware(**faults), scene_of(camera)[0]
    found, step = captured(tmp_path, camera, shutter, hardware)
    moved = moving_scenes(scene, hardware.movement, camera.slots)
    wanted = imperfect(camera, hardware, outside="dark")(moved)
    assert float((found.values - wanted).abs().max()) <= 1.01 * step * (
        camera.slots if camera.exposure != "equal" else 1
    )
    assert float((found.values - camera(scene)).abs().max()) > 0.05


def test_a_shutter_that_is_laid_on_afterwards_does_not_leak(tmp_path):
    with pytest.raises(SettingError, match=r"leakage: found 0\.1, expected none where frames"):
        captured(tmp_path, spectral(), "emulated-shutter", Hardware(leakage=0.1))
    assert not (tmp_path / "frames").exists()


@pytest.mark.parametrize("shutter", SHUTTERS)
def test_a_motion_beyond_the_scene_is_refused_before_anything_is_kept(tmp_path, shutter):
    """So that the folder is free for the motion that was meant."""
    with pytest.raises(SettingError, match=r"motion: found 100,0, expected less than the scene's 12×16"):
        captured(tmp_path, spectral(), shutter, Hardware(motion=(100.0, 0.0)))
    assert not (tmp_path / "frames").exists()
