"""A camera of one's own on the table: displays, benches and calibrations ask its object in the laboratory alone."""

import pytest
import torch

from tests.lab.acquisition.test_capture import exported
from tests.lab.calibration.test_one_bench import measured, scene_of, taken
from tmca.cameras import CAMERAS, SpectralCamera
from tmca.errors import SettingError
from tmca.lab.calibration.apply import calibrated_snapshot
from tmca.lab.calibration.shots import Asked
from tmca.lab.calibration.steps import steps_of
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
    seen = taken(tmp_path / "frames", export, toy)
    calibrated = calibrated_snapshot(seen, measured(tmp_path / "bench", export, toy, asked=Asked(4)))
    with torch.no_grad():
        exact = toy.A(scene_of(toy))
    # a pixel whose shutter is never open is none of the snapshot; noise of 1e-3 is
    assert float((calibrated.values - exact).abs().max()) < 0.02


def test_a_kind_that_was_never_on_the_table_is_named():
    with pytest.raises(SettingError, match=r"found 'pinhole', expected one of .*spectral-depth"):
        lab_camera("pinhole")


def test_steps_of_a_light_field_camera_know_no_dispersion():
    assert LAB_CAMERAS["light-field"].steps - LAB_CAMERAS["spectral"].steps == {"shear"}
    assert "dispersion" in LightFieldLab.unmeasured
