"""A camera of one's own on the table: displays, benches and calibrations ask its object in the laboratory alone."""

import pytest
import torch

from tests.lab.acquisition.test_capture import exported
from tmca.cameras import CAMERAS, SpectralCamera
from tmca.errors import SettingError
from tmca.lab.acquisition.drivers import find_device
from tmca.lab.acquisition.session import capture, joined
from tmca.lab.calibration.apply import calibrated_snapshot
from tmca.lab.calibration.capturing import capture_step
from tmca.lab.calibration.file import Calibration
from tmca.lab.calibration.shots import Asked
from tmca.lab.calibration.steps import measure_all, steps_of
from tmca.lab.cameras import LAB_CAMERAS, LightFieldLab, SpectralLab, lab_camera
from tmca.lab.display.manifest import read_manifest
from tmca.sensor import Sensor


@pytest.fixture
def toy():
    """A fourth camera, whose sensor alone is measured."""

    class ToyCamera(SpectralCamera):
        kind = "toy"

    class ToyLab(SpectralLab):
        kind = "toy"
        steps = frozenset({"dark", "flat", "white"})

    assert LAB_CAMERAS["toy"].steps is ToyLab.steps
    yield ToyCamera(3, (16, 19), 2, shutter="one-hot", sensor=Sensor(1e-3))
    del CAMERAS["toy"], LAB_CAMERAS["toy"]


def test_a_camera_of_ones_own_is_captured_and_calibrated(tmp_path, toy):
    export = exported(tmp_path, toy)
    assert steps_of(toy, read_manifest(export)) == ("dark", "flat", "white")
    scene = torch.rand(1, *toy.scene_shape, generator=torch.Generator().manual_seed(3))
    bench = find_device("simulated", camera=toy, scene=[scene], whole=False)
    taken = joined(capture(export, bench, tmp_path / "frames", gain=bench.gain), export, toy)
    for step in steps_of(toy, read_manifest(export)):
        lamp = find_device("simulated", camera=toy, scene=[], whole=False)
        capture_step(step, export, lamp, tmp_path / "bench", toy, Asked(4), bench={"driver": "simulated"})
    *_, (_, calibration) = measure_all(tmp_path / "bench", Calibration.empty())
    calibrated = calibrated_snapshot(taken, calibration)
    with torch.no_grad():
        exact = toy.A(scene)
    # a pixel whose shutter is never open is none of the snapshot; noise of 1e-3 is
    assert float((calibrated.values - exact).abs().max()) < 0.02


def test_a_kind_that_was_never_on_the_table_is_named():
    with pytest.raises(SettingError, match=r"found 'pinhole', expected one of .*spectral-depth"):
        lab_camera("pinhole")


def test_steps_of_a_light_field_camera_know_no_dispersion():
    assert LAB_CAMERAS["light-field"].steps - LAB_CAMERAS["spectral"].steps == {"shear"}
    assert "dispersion" in LightFieldLab.unmeasured
