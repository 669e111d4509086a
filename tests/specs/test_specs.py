"""Specs are one declaration: of their cameras' constructors, of YAML, of options and of axes."""

from inspect import signature

import pytest
import torch

from tests.test_architecture import loaded_after
from tmca.cameras import CAMERAS, CodesWarning, SpectralCamera, camera_of
from tmca.data import load_scene
from tmca.errors import DataError, SettingError, ShapeError
from tmca.sensor import Sensor
from tmca.specs import (
    CAMERA_SPECS,
    CubeReading,
    DepthReading,
    LightFieldSpec,
    MaskPlaceSpec,
    PhaseBenchSpec,
    SensorSpec,
    SheetSpec,
    SpectralDepthSpec,
    SpectralSpec,
    TruthReading,
    ViewsReading,
    spec_of,
)

SHAPES = {
    "spectral": {"bands": 4, "size": (16, 20)},
    "light-field": {"views": (3, 3), "size": (16, 20)},
    "spectral-depth": {"size": (64, 64)},
}
BENCH = {"aperture_distance": 0.1, "aperture_width": 0.01, "pixel_pitch": 1e-5}


def test_every_camera_has_a_spec():
    assert set(CAMERA_SPECS) == set(CAMERAS) == set(SHAPES)


@pytest.mark.parametrize("kind", CAMERA_SPECS)
def test_a_spec_without_values_is_the_camera_without_arguments(kind):
    spec = CAMERA_SPECS[kind]()
    made = camera_of(spec, **SHAPES[kind])
    preset = getattr(spec, "preset", None) or spec.usual
    plain = CAMERAS[kind].from_preset(preset, **SHAPES[kind]) if preset else CAMERAS[kind](**SHAPES[kind])
    for name, values in plain.state_dict().items():
        assert torch.equal(values, made.state_dict()[name]), name
    assert made.snapshot_shape == plain.snapshot_shape


def test_one_option_on_codes_leaves_the_usual_preset():
    """The others are then the constructor's, as in version 0.1."""
    made = camera_of(CAMERA_SPECS["spectral"](slots=8), **SHAPES["spectral"])
    assert made.codes.shutter.tile().sum(0).max() > 1
    assert camera_of(CAMERA_SPECS["spectral"](period=4), **SHAPES["spectral"]).slots == 4


@pytest.mark.parametrize("kind", CAMERA_SPECS)
def test_defaults_are_those_of_the_constructor(kind):
    """But for what is a preset's, where a default may be none."""
    spec, (start,) = CAMERA_SPECS[kind], [signature(CAMERAS[kind].__init__).parameters]
    for name, field in spec.model_fields.items():
        if name in start and name not in spec.sources and field.default is not None:
            default = start[name].default
            assert field.default in (default, (default, default)), name


@pytest.mark.parametrize("kind", CAMERA_SPECS)
def test_every_field_has_help(kind):
    assert all(field.description for field in CAMERA_SPECS[kind].model_fields.values())


def test_the_sensor_is_declared_as_it_is():
    start = signature(Sensor.__init__).parameters
    assert all(start[name].default == field.default for name, field in SensorSpec.model_fields.items())
    assert spec_of(SheetSpec, {"bits": "12", "exposure": "0.1"}).given() == {"bits": 12, "exposure": 0.1}


def test_texts_are_values():
    spec = spec_of(SpectralSpec, {"slots": "3", "dispersion": "0,1.5,2", "duty": "0.25"})
    assert spec.arguments() == {"slots": 3, "dispersion": (0.0, 1.5, 2.0), "duty": 0.25}
    assert spec == spec_of(SpectralSpec, {"slots": 3, "dispersion": [0, 1.5, 2], "duty": 0.25})
    assert spec_of(LightFieldSpec, {"shear": "0.5"}).shear == (0.5, 0.5)
    assert spec_of(CubeReading, {"wavelengths": "400:700:3"}).wavelengths == pytest.approx((4e-7, 5.5e-7, 7e-7))
    assert spec_of(SpectralDepthSpec, {"rms_nm": 50}).arguments() == {"rms": pytest.approx(50e-9)}
    assert spec_of(ViewsReading, {"lens": "14x12"}).lens == (14, 12)


def test_one_spec_makes_the_camera_of_its_values():
    spec, sensor = spec_of(SpectralSpec, {"slots": 2, "shutter": "one-hot", "seed": 3}), SensorSpec(read_noise=0.1)
    camera = camera_of(spec, sensor, bands=4, size=(16, 20))
    same = SpectralCamera(4, (16, 20), 2, shutter="one-hot", seed=3)
    assert torch.equal(camera.codes()[1], same.codes()[1])
    assert camera.sensor.read_noise == 0.1


BAD = [
    (SpectralSpec, {"slots": "1.5"}, "slots"),
    (SpectralSpec, {"slots": 0}, "slots"),
    (SpectralSpec, {"slotts": 2}, "slotts"),
    (SpectralSpec, {"dispersion": "1,x"}, "dispersion"),
    (SpectralSpec, {"disperser": "triple"}, "disperser"),
    (SpectralSpec, {"duty": 1.5}, "duty"),
    (SpectralSpec, {"transmittance": "nan"}, "transmittance"),
    (SpectralSpec, {"seed": -1}, "seed"),
    (SpectralSpec, {"seed": 2**30}, "seed"),
    (SpectralSpec, {"exposure": "none"}, "exposure"),
    (LightFieldSpec, {"shear": "1,2,3"}, "shear"),
    (SpectralDepthSpec, {"depth": "0.4"}, "depth"),
    (SpectralDepthSpec, {"rms_nm": 1e6}, "rms_nm"),
    (SpectralDepthSpec, {"image_formation": "wave"}, "image_formation"),
    (SensorSpec, {"read_noise": -1}, "read_noise"),
    (SensorSpec, {"bits": 40}, "bits"),
    (SheetSpec, {"full_well": "many"}, "full_well"),
    (SheetSpec, {"pattern_rate": 0}, "pattern_rate"),
    (PhaseBenchSpec, {"psf_window": 30}, "psf_window"),
    (PhaseBenchSpec, {"aperture": -1}, "aperture"),
    (MaskPlaceSpec, {"mask_pitch": 0}, "mask_pitch"),
    (CubeReading, {"wavelengths": "400-700"}, "wavelengths"),
    (CubeReading, {"negative": "drop"}, "negative"),
    (ViewsReading, {"lens": "14"}, "lens"),
    (ViewsReading, {"lens": "0x14"}, "lens"),
    (DepthReading, {"reduce": 0}, "reduce"),
    (DepthReading, {"scene_seed": -1}, "scene_seed"),
    (SpectralSpec, {"slots": 10**9}, "slots"),  # from here on what no memory or scene could hold
    (SpectralSpec, {"period": 10**6}, "period"),
    (SpectralDepthSpec, {"planes": 10**9}, "planes"),
    (PhaseBenchSpec, {"psf_window": 10**6 + 1}, "psf_window"),
    (PhaseBenchSpec, {"mask_pixels": 10**6}, "mask_pixels"),
    (CubeReading, {"wavelengths": "400:700:1000000000"}, "wavelengths"),
    (SensorSpec, {"read_noise": 1e308}, "read_noise"),
    (SensorSpec, {"read_noise_electrons": 1e308}, "read_noise_electrons"),
]


@pytest.mark.parametrize(("spec", "values", "where"), BAD)
def test_bad_values_are_refused_by_their_field(spec, values, where):
    with pytest.raises(SettingError) as refused:
        spec_of(spec, values)
    assert refused.value.where == where


@pytest.mark.parametrize(
    ("call", "where"),
    [
        (lambda: SpectralDepthSpec(mask="flat", modes=4).arguments(), "modes"),
        (lambda: PhaseBenchSpec(lens=False, focus=1.0).arguments(), "focus"),
        (lambda: DepthReading(materials="test").arguments(), "materials"),
        (lambda: DepthReading(placed="plane", from_rgb=True).arguments(), "from_rgb"),
        (lambda: DepthReading(placed="plane", metric_depth=True).arguments(), "metric_depth"),
        (lambda: MaskPlaceSpec(mask_distance=1e-3).lengths(), "aperture_distance"),
        (lambda: TruthReading(pattern="x").of("spectral"), "pattern"),
        (lambda: TruthReading(variable="x").of("light-field"), "variable"),
        (lambda: TruthReading(scale=2).of("spectral-depth"), "scale"),
    ],
)
def test_values_that_do_not_go_together_are_refused(call, where):
    with pytest.raises(SettingError) as refused:
        call()
    assert refused.value.where == where


IMPOSSIBLE = [
    (SpectralSpec(aperture="nope"), None, "aperture"),
    (SpectralSpec(dispersion=(1.0, 2.0)), None, "dispersion"),
    (SpectralSpec(shutter="random", duty=0.0), None, "aperture"),
    (SpectralSpec(preset="clfp"), None, "preset"),
    (LightFieldSpec(mask_scale=1.1), MaskPlaceSpec(**BENCH, mask_distance=1e-3), "mask_scale"),
    (LightFieldSpec(shear=(1.0, 1.0)), MaskPlaceSpec(**BENCH, mask_distance=1e-3), "shear"),
    (LightFieldSpec(shear=(1.0, 2.0)), MaskPlaceSpec(**BENCH), "shear"),
    (SpectralDepthSpec(mask="wavy"), None, "mask"),
]


@pytest.mark.parametrize(("spec", "bench", "where"), IMPOSSIBLE)
def test_specs_that_make_no_camera_name_the_field(spec, bench, where):
    with pytest.raises((SettingError, ShapeError)) as refused:
        camera_of(spec, None, bench, **SHAPES[spec.kind])
    assert refused.value.where == where


def test_a_bench_in_metres_says_the_shear():
    with pytest.warns(CodesWarning, match="mask pixels per view"):
        camera = camera_of(LightFieldSpec(), None, MaskPlaceSpec(**BENCH), **SHAPES["light-field"])
    assert camera.shear.step == pytest.approx((1.0, 1.0))


@pytest.mark.parametrize(("settings", "words"), [
    ({"buckets": 2, "shutter": "open"}, "never sees light"),
    ({"buckets": 2, "slots": 1}, "never sees light"),
    ({"shutter": "burst"}, "one bucket"),
])  # fmt: skip
def test_buckets_that_see_no_light_are_warned_of(settings, words):
    for kind in ("spectral", "spectral-depth"):
        with pytest.warns(CodesWarning, match=words):
            camera_of(CAMERA_SPECS[kind](**settings), size=(64, 64), **({"bands": 4} if kind == "spectral" else {}))


def test_a_phase_mask_bench_replaces_parts_of_the_presets():
    camera = camera_of(SpectralDepthSpec(), None, PhaseBenchSpec(pitch=7e-6, psf_window=21), size=(64, 64))
    assert (camera.bench.pitch, camera.bench.window) == (7e-6, (21, 21))


def test_missing_files_are_named(tmp_path):
    with pytest.raises(DataError):
        camera_of(SpectralSpec(codes=tmp_path / "none.nc"), **SHAPES["spectral"])


def test_a_reading_is_the_arguments_of_its_reader():
    cube = load_scene("coffee", size=(8, 8), **CubeReading(negative="clip").given())
    assert cube.shape == (12, 8, 8)
    assert TruthReading(scale=2.0).of("light-field") == {"scale": 2}


def test_specs_are_light():
    assert not loaded_after("import tmca.specs") & {"torch", "numpy", "scipy", "xarray", "cyclopts"}
