"""Documents name what is there: tests that hold an erratum, presets."""

import re
from pathlib import Path

from tmca.cameras import LightFieldCamera, SpectralDepthCamera
from tmca.training import TRAININGS

ROOT = Path(__file__).parents[1]
ERRATA = (ROOT / "docs" / "errata.md").read_text()
SPECTRAL_DEPTH = (ROOT / "docs" / "spectral-depth.md").read_text()
LIGHT_FIELD = (ROOT / "docs" / "light-field.md").read_text()


def test_the_tests_that_hold_an_erratum_are_there():
    for row in ERRATA.splitlines():
        if files := re.findall(r"`(tests/\S+\.py)`", row):
            text = "".join((ROOT / file).read_text() for file in files)
            for name in re.findall(r"`(test_\w+)`", row):
                assert f"def {name}(" in text, row


def test_every_preset_of_the_light_field_is_described():
    cameras, trainings = LIGHT_FIELD.split("`--preset` of `tmca train light-field`")
    assert all(f"| `{name}` |" in cameras for name in LightFieldCamera.presets)
    assert all(f"| `{name}` |" in trainings for name in TRAININGS["light-field"].presets)


def test_every_preset_of_the_spectral_depth_camera_is_described():
    cameras, trainings = SPECTRAL_DEPTH.split("`--preset` of `tmca train spectral-depth`")
    assert all(f"`{name}`" in cameras for name in SpectralDepthCamera.presets)
    assert all(f"| `{name}` |" in trainings for name in TRAININGS["spectral-depth"].presets)
