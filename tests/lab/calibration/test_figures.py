"""Every part of a calibration has its picture."""

import io

import numpy as np
import pytest
from PIL import Image

from tests.lab.calibration.test_file import PARTS
from tmca.lab.figures import part_figure


@pytest.mark.parametrize("name", PARTS)
def test_a_part_is_drawn(name):
    stack = PARTS["psf0"] if name == "wavefront0" else None
    figure, file = part_figure(PARTS[name], name, stack), io.BytesIO()
    assert len(figure.axes) >= 2
    figure.savefig(file, format="png", dpi=40)
    assert np.asarray(Image.open(file).convert("L")).std() > 5
