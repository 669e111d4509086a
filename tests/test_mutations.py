"""Key lines of the source, each made wrong in a copy of it: the quick tests of its subject notice."""

import importlib
import os
import shutil
import sys
from pathlib import Path

import pytest

from tests.prepared import processes

ROOT = Path(__file__).parents[1]
MUTATIONS = {
    "sign of the shear": (
        "operators/light_field.py",
        "edge + int(step) * v",
        "edge - int(step) * v",
        ("operators/test_light_field.py", "slow_loops_give and thesis"),
    ),
    "sign of the dispersion": (
        "operators/spectral.py",
        "tuple(-d for d in dispersion.displacement)",
        "dispersion.displacement",
        ("operators/test_spectral.py", "dispersers_equal and dual and fractional"),
    ),
    "exposure weight": (
        "operators/linear.py",
        'return 1 / slots if exposure == "equal" else 1.0',
        "return 1.0",
        ("operators/test_spectral.py", "dispersers_equal and single and fractional"),
    ),
    "noise variance": (
        "sensor/sensor.py",
        "self.shot * snapshot.clamp_min(0)",
        "self.shot",
        ("sensor/test_sensor.py", "measured_mean"),
    ),
    "offset of the adjoint": (
        "operators/kernels.py",
        "_windows(snapshot, code.shape[2], layout), scene.unbind(1), code.unbind(0)\n    seen",
        "_windows(snapshot.roll(1, -1), code.shape[2], layout), scene.unbind(1), code.unbind(0)\n    seen",
        ("operators/test_conformance.py", "inner_products and disperser"),
    ),
    "binarisation of codes": (
        "codes/plane.py",
        "return (logits > 0).to(logits.dtype)",
        "return torch.sigmoid(slope * logits)",
        ("codes/test_codes.py", "binary_and_of_the_size"),
    ),
    "scale of the full well": (
        "sensor/sensor.py",
        "electron = full_scale / self.full_well if self.full_well else 0.0\n        read",
        "electron = 1 / self.full_well if self.full_well else 0.0\n        read",
        ("sensor/test_sensor.py", "measured_mean"),
    ),
    "noise of the LMMSE": (
        "priors/gaussian_posterior.py",
        "return noise.read**2 + NOISE_FLOOR",
        "return NOISE_FLOOR",
        ("operators/test_blocks.py", "textbook"),
    ),
    "peak of the PSNR": (
        "metrics/cubes.py",
        "20 * np.log10(data_range)",
        "10 * np.log10(data_range)",
        ("metrics/test_cubes.py", "psnr"),
    ),
    "sign of the disparity": (
        "metrics/disparity.py",
        "np.floor(-step * disparity))\n        fraction = -step * disparity",
        "np.floor(step * disparity))\n        fraction = step * disparity",
        ("metrics/test_disparity.py", "moved_view"),
    ),
    "step of the conjugate gradients": (
        "operators/linear.py",
        "length = energy / inner(direction, image)",
        "length = 0.5 * energy / inner(direction, image)",
        ("operators/test_least_norm.py", "pseudo_inverse"),
    ),
}


_SAID = 100
"""Added to what pytest says: a process that fails otherwise ends with 1 too."""


def _tested(source, arguments):
    """In a process of its own: exit with ``_SAID`` and what pytest says of a copy of the source."""
    sys.path.insert(0, source)
    os.environ["PYTHONPATH"] = source
    os.chdir(ROOT)
    told = pytest.main(arguments)
    used = Path(importlib.import_module("tmca").__file__)
    sys.exit(_SAID + int(told) if used.is_relative_to(source) else pytest.ExitCode.INTERNAL_ERROR.value)


@pytest.mark.slow
@pytest.mark.parametrize("name", MUTATIONS)
def test_a_wrong_line_is_noticed(name, tmp_path):
    file, right, wrong, (tests, chosen) = MUTATIONS[name]
    shutil.copytree(ROOT / "src", tmp_path / "src")  # what is compiled already is not compiled again
    mutant = tmp_path / "src" / "tmca" / file
    text = mutant.read_text()
    assert text.count(right) == 1, f"{file} no longer has this line: choose another"
    mutant.write_text(text.replace(right, wrong))
    asked = ["-x", "-n", "0", "-p", "no:cacheprovider", f"tests/{tests}", "-m", "not slow", "-k", chosen]
    process = processes().Process(target=_tested, args=(str(tmp_path / "src"), asked))
    process.start()
    process.join()
    assert process.exitcode == _SAID + pytest.ExitCode.TESTS_FAILED
