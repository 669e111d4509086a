"""`tmca.lab.Bench`: the same frames as those of the engine, of a scene in any form, and a calibration of them."""

import numpy as np
import pytest
import torch

from tests.lab.acquisition.test_capture import bench_of, exported, scene_of
from tests.lab.display.test_export import spectral
from tmca import lab
from tmca.cameras import Hardware, Snapshot
from tmca.errors import OutputError, SettingError
from tmca.lab.acquisition.session import capture, joined
from tmca.lab.bench import steps_before
from tmca.lab.display.manifest import read_manifest
from tmca.sensor import Sensor

CODED = ("dli4120", "coded-exposure")


@pytest.fixture
def camera():
    return spectral(sensor=Sensor(full_well=1e4, read_noise_electrons=3))


@pytest.mark.parametrize("hardware", [None, Hardware(misregistration=0.4)])
def test_a_bench_captures_what_the_engine_does(tmp_path, camera, hardware):
    export = exported(tmp_path, camera, *CODED)
    bench = lab.Bench(export, hardware=hardware, seed=5)
    taken = bench.capture(tmp_path / "frames", scene_of(camera)[0], repeats=2)
    engine = bench_of(camera, hardware=hardware or Hardware(), seed=5)
    frames = capture(export, engine, tmp_path / "other", gain=None, repeats=2, camera=camera)
    wanted = joined(frames, export, camera)
    assert torch.equal(taken.values, wanted.values)
    assert taken.notes.keys() - {"scene"} == wanted.notes.keys() - {"scene"}


def test_a_scene_has_any_form_and_another_one_is_refused(tmp_path, camera):
    bench, scene = lab.Bench(exported(tmp_path, camera, *CODED)), scene_of(camera)[0]
    first = bench.capture(tmp_path / "frames", scene)
    labelled = camera.label(scene)
    for form in (scene.numpy(), scene[0], labelled):
        assert torch.equal(bench.capture(tmp_path / "frames", form).values, first.values)
    with pytest.raises(OutputError, match="frames"):
        bench.capture(tmp_path / "frames", scene / 2)
    with pytest.raises(SettingError, match="scene"):
        bench.capture(tmp_path / "none")


def test_a_driver_of_ones_own_has_no_scene_and_no_faults(tmp_path, camera):
    export = exported(tmp_path, camera, *CODED)
    driver = tmp_path / "mine.py"
    driver.write_text(
        "import numpy as np\n\n\nclass Mine:\n    saturation = 255\n\n"
        "    def __init__(self, level: int = 1):\n        self.level = level\n\n"
        "    def load(self, export):\n        pass\n\n    def show(self, slot):\n        self.dark = slot is None\n\n"
        f"    def capture(self, whole=False):\n        size = {tuple(camera.snapshot_shape[1:])}\n"
        "        return np.full(size, self.level + 10 * (not (self.dark and not whole)), np.uint8)\n"
    )
    bench = lab.Bench(export, device=f"{driver}:Mine", level="4")
    assert bench.driver.level == 4
    values = bench.capture(tmp_path / "frames").values
    assert float(values.min()) == pytest.approx(float(values.max()))
    with pytest.raises(SettingError, match="scene"):
        bench.capture(tmp_path / "scene", scene_of(camera)[0])
    with pytest.raises(SettingError, match="hardware"):
        lab.Bench(export, device=f"{driver}:Mine", hardware=Hardware(blur=0.3))


def test_an_export_without_its_snapshot_needs_one(tmp_path, camera):
    known = Snapshot(torch.zeros(1, *camera.snapshot_shape), camera)
    known.save(tmp_path / "drawn.nc")
    lab.export(tmp_path / "drawn.nc", CODED, tmp_path / "patterns")
    (tmp_path / "drawn.nc").unlink()
    with pytest.raises(SettingError, match="snapshot: found"):
        lab.Bench(tmp_path / "patterns")
    assert lab.Bench(tmp_path / "patterns", snapshot=known).camera is camera


def test_steps_that_a_bench_cannot_take_are_left_out_and_named(tmp_path):
    silent = spectral()
    steps, left_out = steps_before(silent, read_manifest(exported(tmp_path, silent, *CODED)), simulated=True)
    assert "linearity" not in steps
    assert left_out[0].startswith("linearity")


def test_bench_and_export_say_what_they_are(tmp_path, camera):
    Snapshot(torch.zeros(1, *camera.snapshot_shape), camera).save(tmp_path / "drawn.nc")
    shown = lab.export(tmp_path / "drawn.nc", CODED, tmp_path / "patterns", macro_pixel=2)
    assert {plane["device"]["name"] for plane in shown.manifest["planes"]} == {*CODED}
    assert "on dli4120" in repr(shown)
    assert len(shown.plot().axes) == 2 * camera.slots
    assert "blur = 0.3" in repr(lab.Bench(tmp_path / "patterns", hardware=Hardware(blur=0.3)))


@pytest.mark.slow
def test_a_calibration_finds_where_the_mask_is(tmp_path):
    camera = spectral((64, 64), sensor=Sensor(full_well=3e4, read_noise_electrons=3))
    bench = lab.Bench(exported(tmp_path, camera, *CODED), hardware=Hardware(misregistration=(0.3, -0.2)))
    calibration = bench.calibrate(tmp_path / "frames", frames=4, curve="measured")
    drawn = lab.Bench(tmp_path / "out").calibrate(tmp_path / "drawn", frames=4, curve="measured")
    moved = calibration.part("registration").matrix[:, 2] - drawn.part("registration").matrix[:, 2]
    np.testing.assert_allclose(moved, [0.3, -0.2], atol=0.02)
    taken = bench.capture(tmp_path / "captures", scene_of(camera)[0])
    assert lab.calibrated_snapshot(taken, calibration).notes["calibration"] == calibration.where
