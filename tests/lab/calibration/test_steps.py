"""Every step of every camera on the simulated bench: its frames, its fit against the hidden faults, its use.

A new step or camera is tested here by a row of ``TRUTHS`` and a bench.
"""

import numpy as np
import pytest
import torch

from tests.lab.acquisition.test_capture import exported
from tests.lab.calibration.test_capturing import light_field
from tests.lab.calibration.test_one_bench import bench_of, measured, scene_of
from tmca.cameras import Hardware, SpectralCamera, SpectralDepthCamera, imperfect
from tmca.errors import DataError
from tmca.lab.calibration.apply import calibrated, check_fits
from tmca.lab.calibration.captured import StepSettings
from tmca.lab.calibration.figures import part_figure
from tmca.lab.calibration.parts import KINDS
from tmca.lab.calibration.psf import MODES
from tmca.lab.calibration.shots import Asked
from tmca.lab.calibration.steps import STEPS, measure, step_of
from tmca.lab.cameras import LAB_CAMERAS
from tmca.optics import ZernikeHeights
from tmca.sensor import Sensor

NOISE, SLOTS = 1e-3, 3
SENSOR = Sensor(NOISE, full_well=5000)


def spectral():
    waves = [450e-9, 510e-9, 580e-9, 650e-9]
    return SpectralCamera(waves, (34, 41), SLOTS, shutter="one-hot", seed=2, sensor=SENSOR)


def spectral_depth():
    maps = ZernikeHeights(2.5e-8 * torch.randn(2, 12, generator=torch.Generator().manual_seed(1)), MODES, (64, 64))
    how = {"slots": 2, "mask": maps, "shutter": "one-hot", "filters": "clear", "sensor": Sensor(NOISE)}
    return SpectralDepthCamera.from_preset("quick", size=(60, 65), **how)


BENCHES = {
    "spectral": (spectral, ("dli4120", "coded-exposure"), Hardware(misregistration=(0.7, -0.4), delay=0.15)),
    "light-field": (
        lambda: light_field((32, 35), SLOTS).replace(sensor=SENSOR),
        ("dli4120", "coded-exposure"),
        Hardware(misregistration=(0.5, -0.7), shear_error=0.1),
    ),
    "spectral-depth": (spectral_depth, ("dmp40", "coded-exposure"), Hardware(wavefront_error=60e-9)),
    "two buckets": (
        lambda: spectral().replace(buckets=2, shutter="random"),
        ("dli4120", "coded-exposure-two-bucket"),
        Hardware(bucket_gain=0.06, bucket_offset=0.02, leakage=0.03, transfer=0.08, delay=0.1),
    ),
}
LABS = {kind: LAB_CAMERAS.get(kind, LAB_CAMERAS["spectral"]) for kind in BENCHES}


class Bench:
    """A simulated bench with hidden faults, the frames of all its steps, and what they say."""

    def __init__(self, folder, kind):
        make, devices, self.hardware = BENCHES[kind]
        self.camera, self.folder = make(), folder / "bench"
        export = exported(folder, self.camera, *devices)
        asked = Asked(8, tuple(LABS[kind].wavelengths(self.camera)), tuple(LABS[kind].depths(self.camera)))
        self.given = StepSettings(curve="measured", snapshot=folder / "taken.nc")
        self.calibration = measured(self.folder, export, self.camera, self.hardware, asked, self.given)

    def truth(self):
        """The camera as its bench really is."""
        return imperfect(self.camera, self.hardware, outside="dark")


@pytest.fixture(scope="module")
def benches(tmp_path_factory):
    made = {}

    def bench(kind):
        if kind not in made:
            made[kind] = Bench(tmp_path_factory.mktemp(kind), kind)
        return made[kind]

    return bench


MEASURED = [
    (kind, name)
    for kind in BENCHES
    for name, step in STEPS.items()
    if name in LABS[kind].steps and step.fit is not None and (name != "buckets" or kind == "two buckets")
]
QUICK = ("two buckets", "spectral-depth")
each_step = pytest.mark.parametrize(("kind", "name"), [
    pytest.param(kind, name, id=f"{kind} {name}", marks=() if kind in QUICK else pytest.mark.slow)
    for kind, name in MEASURED
])  # fmt: skip


def part_names(bench, name):
    """Parts of a calibration that a step measures."""
    return [part for part in bench.calibration.parts if step_of(part).name == name]


def test_every_camera_of_the_table_and_every_part_is_on_a_bench_here():
    assert set(BENCHES) == {*LAB_CAMERAS, "two buckets"}
    assert {name.replace("psf", "wavefront") for _, name in MEASURED} | {"psf"} == set(KINDS)
    assert set(TRUTHS) == {name for _, name in MEASURED}


@each_step
def test_a_fit_leaves_what_is_usual(benches, kind, name):
    bench = benches(kind)
    parts = part_names(bench, name)
    assert parts
    for part in parts:
        about = bench.calibration.about["steps"][part]
        assert part.startswith("psf") or not about["residuals"][STEPS[name].residual] > STEPS[name].usual
        assert about["residuals"].get("quality", 0) <= 1
        assert about["sources"][0]["path"].startswith(str(bench.folder))
        assert about["measured"]


def dark(bench, part):
    """The frames of a sensor with channels are their mean."""
    device = bench_of(bench.camera)
    read = bench.camera.noise.read / (bench.camera.snapshot_shape[0] / bench.camera.buckets) ** 0.5
    assert part.noise * device.gain == pytest.approx(read, rel=0.1)
    first, *others = part.mean if part.mean.ndim == 3 else [part.mean]
    assert np.median(first) == pytest.approx(device.black, abs=1)
    for other in others:
        offset = (np.median(other) - device.black) / (device.saturation - device.black)
        assert offset == pytest.approx(bench.hardware.bucket_offset, rel=0.01)


def flat(bench, part):
    device = bench_of(bench.camera)
    gains = [one.mean() for one in part.gain] if part.gain.ndim == 3 else [1.0]
    level = 0.5 * bench.camera.full_scale * (1 + bench.hardware.bucket_gain / 2)
    assert part.level * device.gain == pytest.approx(level, rel=5e-3)
    assert gains[-1] / gains[0] == pytest.approx(1 + bench.hardware.bucket_gain, rel=2e-3)
    assert part.nonuniformity < 5e-3


def linearity(bench, part):
    device = bench_of(bench.camera)
    electrons = device.gain * SENSOR.full_well / bench.camera.white * bench.camera.exposures
    assert part.gain == pytest.approx(electrons, rel=0.1)
    assert part.largest_deviation < 0.01


def registration(bench, part):
    """The middle of the mask is displaced by what the hardware says, seen from where it was drawn."""
    middle = np.array([(n - 1) / 2 for n in part.codes] + [1])
    drawn = LAB_CAMERAS[bench.camera.kind].code_map(bench.camera, bench.calibration)
    np.testing.assert_allclose((part.matrix - drawn) @ middle, bench.hardware.shift, atol=0.06)


def buckets(bench, part):
    assert part.leakage == pytest.approx(bench.hardware.leakage, abs=5e-4)
    assert part.transfer == pytest.approx(bench.hardware.transfer, abs=5e-3)


def timing(bench, part):
    assert part.delay == pytest.approx(bench.hardware.delay, abs=3e-3)
    assert part.ratio == pytest.approx(1, abs=3e-3)


def dispersion(bench, part):
    seen = np.array(bench.camera.dispersion.displacement)
    np.testing.assert_allclose(np.diff(part.shifts[:, 1]), np.diff(seen), atol=0.1)


def shear(bench, part):
    np.testing.assert_allclose(part.step, 1 + bench.hardware.shear_error, atol=0.03)


def psf(bench, part):
    if isinstance(part, KINDS["psf"]):
        np.testing.assert_allclose(part.values.sum(axis=(2, 3)), 1, atol=1e-6)
        return
    true, drawn, fitted = (
        one.psf() for one in (bench.truth(), bench.camera, calibrated(bench.camera, bench.calibration))
    )
    assert float((fitted - true).norm()) < 0.2 * float((drawn - true).norm())


TRUTHS = {one.__name__: one for one in (dark, flat, linearity, registration, buckets, timing, dispersion, shear, psf)}


@each_step
def test_a_fit_finds_what_the_bench_hides(benches, kind, name):
    bench = benches(kind)
    for part in part_names(bench, name):
        TRUTHS[name](bench, bench.calibration.part(part))


@each_step
def test_a_part_alone_can_be_applied(benches, kind, name):
    bench = benches(kind)
    alone = bench.calibration.only(*part_names(bench, name))
    camera = calibrated(bench.camera, alone)
    assert camera.kind == LABS[kind].kind
    assert camera.scene_shape == bench.camera.scene_shape
    foreign = [other for other in BENCHES if part_names(bench, name)[-1].rstrip("0123") in LABS[other].unmeasured]
    for other in foreign:
        with pytest.raises(DataError, match=f"one of a {LABS[other].kind} camera"):
            check_fits(BENCHES[other][0](), alone)


@each_step
def test_a_part_is_drawn(benches, kind, name):
    bench = benches(kind)
    figure = part_figure(bench.calibration.parts, part_names(bench, name)[-1], name)
    assert all(axes.has_data() for axes in figure.axes[:2])


@each_step
def test_a_step_needs_those_before_it(benches, kind, name):
    bench = benches(kind)
    for need in STEPS[name].needs:
        with pytest.raises(DataError, match=f"found no {need}, expected one, on which {name} builds"):
            measure(name, bench.calibration.without(need), bench.folder / name, bench.given)


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=pytest.mark.slow) if kind == "spectral" else kind for kind in BENCHES]
)
def test_all_steps_together_make_the_camera_of_the_bench(benches, kind):
    """Of the bench's image of a scene the calibrated camera leaves a fraction of what the drawn one does."""
    bench = benches(kind)
    scene = (scene_of(bench.camera),)
    if kind == "spectral-depth":
        scene += (torch.full((1, 1, *bench.camera.size), float(bench.camera.planes.metres[2])),)
    lab, nominal = LABS[kind], bench.camera
    known = calibrated(nominal, bench.calibration)
    with torch.no_grad():
        true, drawn = (one.exact(*scene) for one in (bench.truth(), nominal))
        image = lab.on_sensor(known.exact(*scene), nominal, known)
    assert float((image - true).norm()) < 0.4 * float((drawn - true).norm())


def test_points_need_the_camera_that_they_are_of(benches):
    bench = benches("spectral-depth")
    with pytest.raises(DataError, match="--snapshot"):
        measure("psf0", bench.calibration, bench.folder / "psf0")
