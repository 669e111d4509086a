"""Every part of a calibration has its picture."""

import io

import numpy as np
import pytest
from PIL import Image

from tests.lab.calibration.test_file import PARTS, whole
from tmca.lab.calibration.steps import part_figure


@pytest.mark.parametrize("name", [name for name in PARTS if not name.startswith("psf")])
def test_a_part_is_drawn(name):
    figure, file = part_figure(whole(), name, name), io.BytesIO()
    assert len(figure.axes) >= 2
    figure.savefig(file, format="png", dpi=40)
    assert np.asarray(Image.open(file).convert("L")).std() > 5
