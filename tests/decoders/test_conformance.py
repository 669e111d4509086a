"""Every decoder of the registry on every camera that it names."""

import re
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import torch
import xarray as xr
from conformance import CHECKS, SIZE, camera_for, case, values_for

from tmca.cameras import Snapshot, SpectralCamera
from tmca.cameras.camera import CAMERAS
from tmca.data import read_dataset
from tmca.decoders import DECODERS, Estimate, Weights, decode, decoders, decoders_for, settings_of, usual_decoder
from tmca.errors import DataError, SettingError, ShapeError, TmcaError

CASES = [(name, kind) for name, cls in sorted(decoders().items()) for kind in sorted(cls.cameras)]


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize(("name", "kind"), CASES)
def test_every_decoder_conforms(check, name, kind):
    check(DECODERS[name], kind)


@pytest.mark.parametrize("name", sorted(DECODERS))
def test_every_setting_is_explained(name):
    assert DECODERS[name].label
    assert all(setting.help for setting in settings_of(DECODERS[name]))


@pytest.mark.parametrize(("kind", "variables"), [
    ("spectral", {"estimate", "deviation"}),
    ("light-field", {"estimate", "deviation", "disparity", "confidence", "all_in_focus"}),
    ("spectral-depth", {"radiance", "depth", "depth_deviation", "confidence"}),
])  # fmt: skip
def test_an_estimate_is_labelled_saved_and_drawn(kind, variables, tmp_path):
    cls = DECODERS[usual_decoder(kind)]
    camera, values, prior, settings = case(cls, kind)
    settings |= {"uncertainty": True} if cls.deviation else {}
    estimate = decode(Snapshot(values[:1], camera, {"scene": "smooth"}), cls, prior=prior, **settings)
    stored = read_dataset(estimate.save(tmp_path / "e.nc"))
    assert set(stored.data_vars) == variables
    assert (stored.attrs["decoder"], stored.attrs["scene"]) == (cls.name, "smooth")
    assert stored[next(iter(stored.data_vars))].shape == tuple(camera.scene_shape)
    assert estimate.plot(truth=estimate.to_xarray()).axes
    assert kind == "light-field" or estimate.plot(truth="coffee").axes
    assert kind == "spectral-depth" or estimate.plot(truth=estimate.values).axes
    assert "<img" in estimate._repr_html_()


def test_estimates_of_several_snapshots_and_slots_are_labelled():
    camera = camera_for(DECODERS["dagger"], "spectral")
    values = torch.rand(2, 4, *camera.scene_shape)
    labelled = Estimate(values, camera, "dagger").to_xarray()["estimate"]
    assert labelled.dims == ("snapshot", "slot", "wavelength", "y", "x")
    assert torch.equal(torch.from_numpy(labelled.values), values)
    assert labelled["wavelength_nm"].dims == ("wavelength",)


def test_a_batch_of_light_fields_that_are_no_colours_is_labelled_drawn_and_saved(tmp_path):
    camera = camera_for(DECODERS["dagger"], "light-field")
    one, other = (Estimate(torch.rand(2, *camera.scene_shape), camera, "dagger") for _ in range(2))
    assert one.to_xarray()["estimate"].dims == ("snapshot", "view_v", "view_u", "y", "x")
    assert one.save(tmp_path / "e.nc").exists()
    assert "<img" in one._repr_html_()
    assert one != other


def test_a_camera_of_a_new_kind_is_labelled_and_drawn_by_what_it_says_of_its_scenes():
    class Slabs(SpectralCamera):
        kind = "slabs"

        def label(self, scenes, name="", unit="relative irradiance"):
            return xr.DataArray(scenes[0].numpy(force=True), dims=("slab", "y", "x"))

    try:
        camera = Slabs(3, SIZE, slots=2)
        estimate = Estimate(torch.rand(1, *camera.scene_shape), camera, "dagger")
        assert estimate.to_xarray()["estimate"].dims == ("slab", "y", "x")
        assert estimate.plot().axes
    finally:
        CAMERAS.pop("slabs")


def test_a_snapshot_file_is_decoded(tmp_path):
    camera = camera_for(DECODERS["dagger"], "spectral")
    file = Snapshot(values_for(camera)[:1], camera).save(tmp_path / "s.nc")
    assert torch.equal(decode(file, "dagger").values, decode(Snapshot.load(file), "dagger").values)


@pytest.mark.parametrize("returned", ["nothing", "too few", "NaN"])
def test_what_a_decoder_must_not_return_names_it(returned, monkeypatch):
    camera = camera_for(DECODERS["dagger"], "spectral")
    values = values_for(camera)
    nan = torch.full((len(values), *camera.scene_shape), float("nan"))
    result = {"nothing": None, "too few": torch.zeros(3), "NaN": nan}[returned]
    monkeypatch.setattr(DECODERS["dagger"], "reconstruct", lambda *_: result)
    with pytest.raises(TmcaError, match="dagger"):
        decode(Snapshot(values, camera), "dagger")


def test_a_setting_of_another_type_is_named_before_its_class_looks_at_it():
    @dataclass
    class Rooted(DECODERS["dagger"]):
        gain: float = 1.0

        def __post_init__(self):
            self.root = self.gain**0.5

    for make in (lambda: Rooted("much"), lambda: Rooted(gain="much")):
        with pytest.raises(SettingError, match="gain: found 'much', expected a number"):
            make()
    assert Rooted(4.0).root == 2


def test_a_field_that_a_decoder_fills_in_itself_is_no_setting():
    @dataclass
    class Doubled(DECODERS["dagger"]):
        gain: float = 1.0
        twice: int = field(init=False)

        def __post_init__(self):
            self.twice = 2.0 * self.gain

    assert [setting.name for setting in settings_of(Doubled)] == ["gain"]
    camera = camera_for(DECODERS["dagger"], "spectral")
    assert decode(Snapshot(values_for(camera), camera), Doubled, gain=2.0).decoder == "dagger"


@pytest.mark.parametrize(("decoder", "settings", "where"), [
    ("admm-tv", {"tv_weight": -1}, "tv_weight"), ("admm-tv", {"iterations": 0}, "iterations"),
    ("pnp-tv", {"iterations": 0}, "iterations"), ("pnp-subspace", {"rank": 0}, "rank"),
    ("pnp-subspace", {"rank": 100}, "rank"), ("tikhonov", {"weight": -1}, "weight"),
    ("lmmse-adapted", {"tile": 0}, "tile"), ("lmmse-adapted", {"iterations": -1}, "iterations"),
    ("space-time-dct", {"threshold": -1.0}, "threshold"), ("space-time-dct", {"iterations": 1}, "iterations"),
    ("space-time-dct", {"frames": 3}, "frames"),
    ("space-time-lmmse", {"frames": 0}, "frames"), ("space-time-lmmse", {"motion": -1.0}, "motion"),
    ("space-time-lmmse", {"motion": 1e9}, "motion"), ("lmmse", {"uncertainty": "perhaps"}, "uncertainty"),
    *(("tikhonov", {"iterations": wrong}, "iterations") for wrong in ("many", "3", 2.5, None)),
])  # fmt: skip
def test_settings_out_of_range_or_of_another_type_are_named_as_they_were_given(decoder, settings, where):
    camera, values, prior, _ = case(DECODERS[decoder], "spectral")
    taken, (given,) = Snapshot(values, camera), settings.values()
    shown = f"{given:g}" if isinstance(given, int | float) else repr(given)
    for call in (lambda: decode(taken, decoder, prior=prior, **settings),
                 lambda: DECODERS[decoder](**settings)(taken, prior)):  # fmt: skip
        with pytest.raises(SettingError, match=re.escape(f"{where}: found {shown}")):
            call()


def test_a_decoder_prepared_for_other_codes_refuses_a_snapshot(tmp_path):
    camera = camera_for(DECODERS["dagger"], "spectral")
    taken = Snapshot(values_for(camera), camera)
    prepared = DECODERS["dagger"]().prepare(camera)
    stored = Snapshot.load(Snapshot(taken.values[:1], camera).save(tmp_path / "s.nc"))
    assert torch.equal(prepared(stored).values, prepared(taken).values[:1])
    views = camera_for(DECODERS["dagger"], "light-field")
    for other in (Snapshot(taken.values, camera.replace(seed=2)), Snapshot(values_for(views), views)):
        with pytest.raises(SettingError) as refusal:
            prepared(other)
        assert refusal.value.where == "snapshot"


def test_values_of_another_shape_or_not_finite_and_tensors_are_refused():
    camera = camera_for(DECODERS["dagger"], "spectral")
    values = values_for(camera)
    for error, wrong in ((ShapeError, values[..., 1:]), (ShapeError, values[0]), (DataError, values / 0)):
        with pytest.raises(error, match="snapshot: found"):
            decode(Snapshot(wrong, camera), "dagger")
    with pytest.raises(SettingError, match="snapshot: found a Tensor"):
        decode(values, "dagger")


def test_priors_and_names_that_are_of_no_use_are_refused():
    camera, values, prior, _ = case(DECODERS["lmmse"], "spectral")
    mixture = case(DECODERS["mixture"], "spectral")[2]
    for decoder, given, where in (
        ("admm-tv", prior, "prior"), ("lmmse", mixture, "prior"), ("mixture", prior, "prior"),
        ("magic", None, "decoder"), (42, None, "decoder"), (int, None, "decoder"), ("network", None, "weights"),
    ):  # fmt: skip
        with pytest.raises(SettingError, match=f"^{where}: found"):
            decode(Snapshot(values, camera), decoder, prior=given)


def test_moving_decoders_stand_apart():
    moving = {"kriging", "space-time-dct", "space-time-lmmse", "space-time-mixture"}
    assert moving == set(decoders_for("spectral", moving=True))
    assert not moving & set(decoders_for("spectral"))


def test_the_names_of_version_0_1_still_decode():
    from tmca.decoders import decode_light_field

    camera = camera_for(DECODERS["dagger"], "light-field")
    taken = Snapshot(values_for(camera), camera)
    old, new = decode_light_field(taken, "admm-tv", tv_weight=0.1), decode(taken, "admm-tv", tv_weight=0.1)
    assert (old.estimate == new.values).all()
    assert decode(taken, method="dagger").decoder == "dagger"
    dictionary = case(DECODERS["dictionary"], "light-field")[2]
    assert decode_light_field(taken, "dictionary", dictionary=dictionary).values.shape == (2, 3, 3, 13, 17)


@pytest.mark.parametrize("kind", ["light-field", "spectral-depth"])
def test_weights_of_version_0_1_open(kind):
    weights = Weights.load(Path(__file__).parent / "files" / f"weights-0.1-{kind}.safetensors")
    camera = weights.camera_for()
    assert (weights.kind, camera.kind) == (kind, kind)
    weights.check(camera)
    values = values_for(camera)
    estimate = decode(Snapshot(values, camera), "network", weights=weights)
    assert estimate.values.shape == (2, *camera.scene_shape)
    assert estimate.notes["weights"].endswith(".safetensors")
