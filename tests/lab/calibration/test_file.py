"""A calibration on disk: dated, never overwritten, never mixed up; captures that it refuses."""

import hashlib
import json
from dataclasses import fields
from datetime import UTC, datetime

import numpy as np
import pytest
import xarray as xr

from tests.lab.calibration.rays import pictures
from tmca.cameras import SpectralCamera
from tmca.data import read_dataset, write_dataset
from tmca.errors import DataError, OutputError
from tmca.lab.calibration.apply import bench_of, check_fits
from tmca.lab.calibration.buckets import BucketMixing
from tmca.lab.calibration.captures import averaged, read_captures
from tmca.lab.calibration.displacement import MeasuredDispersion, MeasuredShear
from tmca.lab.calibration.file import Calibration, find_calibration, load_calibration
from tmca.lab.calibration.fits import WAVE as BY_WAVE
from tmca.lab.calibration.psf import PsfStack, ZernikeFit
from tmca.lab.calibration.registration import Registration
from tmca.lab.calibration.sensor import DarkField, FlatField, Linearity
from tmca.lab.calibration.timing import Timing
from tmca.lab.frames import named

RNG = np.random.default_rng(0)
SIZE = (5, 7)
NONE = np.zeros(SIZE, np.uint8)


def array(*shape):
    return RNG.standard_normal(shape)


PARTS = {
    "dark": DarkField(array(*SIZE), array(*SIZE) ** 2, NONE, 8),
    "flat": FlatField(1 + 0.1 * array(*SIZE), 900.0, 0.01, 1e-4, NONE, 8),
    "linearity": Linearity(array(4), array(4), array(4), 3.0, 1.0, array(4), float("nan"), 2.5, 0.1, 9.0),
    "registration": Registration(array(2, 3), array(2, 3), 0.3, 0.02, (5, 6), SIZE, 550e-9, 0.004, 1e-4),
    "dispersion": MeasuredDispersion(
        np.arange(4, 7) * 1e-7, array(3, 2), array(3, 2), "cauchy", array(2, 2), array(2), array(3), array(3)
    ),
    "shear": MeasuredShear(array(4, 2), array(4, 2), array(2), array(2), array(2), 0.1, array(4)),
    "buckets": BucketMixing(array(3, 2), array(3, 2), 0.02, 0.05, array(2), 1e-4),
    "timing": Timing(0.1, 0.98, array(2), 100.0, 0.01, 4, False, 0.02, 1e-3),
    "psf0": PsfStack(array(2, 3, 5, 5), array(2), array(3), array(2, 2), array(2, 3)),
    "psf1": PsfStack(array(3, 2, 7, 7), array(3), array(2), array(3, 2), array(3, 2)),
    "wavefront0": ZernikeFit(((2, 0), (2, 2)), array(2), array(2) ** 2, array(2, 2), 0.02, 1),
}


def whole(*names):
    """A calibration of these parts, of all without any."""
    found = Calibration.empty("bench")
    for name in names or PARTS:
        found = found.with_part(name, PARTS[name], {"residual": 0.5})
    return found


def check_all_parts(found):
    for name, part in PARTS.items():
        for field in fields(part):
            own, back = getattr(part, field.name), getattr(found.part(name), field.name)
            assert type(back) is type(own), (name, field.name)
            assert np.array_equal(own, back, equal_nan=not isinstance(own, str)), (name, field.name)
    assert found.about["steps"]["timing"]["residuals"] == {"residual": 0.5}


def test_every_part_comes_back_as_it_was(tmp_path):
    whole().save(tmp_path / "cam")
    check_all_parts(load_calibration(tmp_path / "cam"))


def test_a_calibration_is_dated_and_never_overwritten(tmp_path):
    first = whole("dark", "timing").save(tmp_path / "cam")
    before = first.path.read_bytes()
    second = load_calibration(first.path).with_part("timing", PARTS["timing"], {}).save(first.path)
    third = second.save(tmp_path / "cam")
    assert len({first.path, second.path, third.path}) == 3
    assert first.path.read_bytes() == before
    assert second.about["builds_on"] == first.path.name
    assert find_calibration(tmp_path / "cam") == third.path
    assert first.created.isoformat()[:10] in first.path.name
    empty = Calibration.empty().save(tmp_path / "none")
    assert empty.codes_seen == empty.created
    with pytest.raises(OutputError, match="no such folder"):
        first.save(tmp_path / "gone" / "cam")


def test_a_calibration_tells_what_it_is_from(tmp_path):
    (tmp_path / "source.csv").write_text("1,2\n")
    about = load_calibration(dated([tmp_path / "source.csv"]).save(tmp_path / "cam").path).about
    (source,) = about["steps"]["timing"]["sources"]
    assert source["sha256"] == hashlib.sha256(b"1,2\n").hexdigest()
    assert about["camera"]["name"] == "bench"
    assert about["tmca_version"]


def version_0_1(folder, *names):
    """A calibration as version 0.1 wrote it: variables NAME_FIELD in one file, and a JSON file beside it."""
    found = whole(*names)
    values = {
        f"{name}_{field.name}": getattr(PARTS[name], field.name)
        for name in names or PARTS
        for field in fields(PARTS[name])
    }
    arrays = {k: v for k, v in values.items() if v is not None and not isinstance(v, str)}
    data = {k: ([f"{k}_{i}" for i in range(np.ndim(v))], np.asarray(v)) for k, v in arrays.items()}
    texts = {k: v for k, v in values.items() if isinstance(v, str)}
    path = folder / "cam_2026-01-02T030405.nc"
    write_dataset(xr.Dataset(data, attrs={"format": "tmca calibration 1", **texts}), path)
    about = {"format": "tmca calibration 1", "created": "2026-01-02T03:04:05+00:00", **found.about, "builds_on": None}
    path.with_suffix(".json").write_text(json.dumps({**about, "data": {"file": path.name}, "content_sha256": "0"}))
    return path


@pytest.mark.slow
def test_calibrations_of_version_0_1_are_read(tmp_path):
    path = version_0_1(tmp_path)
    for name in (path, path.with_suffix(".json"), tmp_path / "cam"):
        found = load_calibration(name)
        check_all_parts(found)
        assert found.created == datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
    assert load_calibration(found.save(path).path).about["builds_on"] == path.name


def test_files_from_before_leaks_were_measured_are_read(tmp_path):
    path = version_0_1(tmp_path, "registration", "timing")
    older = read_dataset(path).drop_vars(
        [f"{p}_{n}" for p in ("registration", "timing") for n in ("leakage", "leakage_std")]
    )
    write_dataset(older, path, overwrite=True)
    found = load_calibration(path)
    assert (found.part("registration").leakage, found.part("registration").closed_light) == (None, 0.0)
    assert found.part("registration").contrast_ratio == np.inf
    assert (found.part("timing").leakage, found.part("timing").delay) == (0.0, 0.1)


def test_what_is_no_calibration_is_refused(tmp_path):
    with pytest.raises(DataError, match="no such calibration"):
        load_calibration(tmp_path / "other")
    path = version_0_1(tmp_path, "timing")
    path.with_suffix(".json").write_text("{")
    with pytest.raises(DataError, match="no readable JSON"):
        load_calibration(path)
    path.with_suffix(".json").unlink()
    with pytest.raises(DataError, match="both files"):
        load_calibration(path)
    write_dataset(xr.Dataset({"a": ("x", np.ones(3))}), tmp_path / "else.nc")
    with pytest.raises(DataError, match="expected a file of tmca calibrate, 'tmca calibration 2'"):
        load_calibration(tmp_path / "else.nc")
    saved = whole("dark").save(tmp_path / "new").path
    saved.write_bytes(saved.read_bytes()[: saved.stat().st_size // 2])
    with pytest.raises(DataError):
        load_calibration(saved)


def test_steps_of_two_sensors_do_not_mix():
    found = Calibration.empty("bench").with_part("dark", PARTS["dark"], {}, sensor=SIZE)
    with pytest.raises(DataError, match="sensor in timing of 6×7 pixels, expected 5×7"):
        found.with_part("timing", PARTS["timing"], {}, sensor=(6, 7))


def test_captures_are_known_by_name_and_averaged(tmp_path):
    frames = {f"b_{nm}nm_{i}": np.full(SIZE, nm + i) for nm in (450, 550) for i in (0, 2)}
    seen = read_captures(pictures(tmp_path / "c", frames))
    values, keys = averaged(seen.values, named(seen, BY_WAVE, "b_450nm"))
    assert keys == [(450.0,), (550.0,)]
    assert (values == np.array([451, 551])[:, None, None]).all()
    pictures(tmp_path / "c", {"stray": np.zeros(SIZE)})
    with pytest.raises(DataError, match="a frame named stray"):
        named(read_captures(tmp_path / "c"), BY_WAVE, "b_450nm")


def test_saturated_captures_and_other_sensors_are_refused(tmp_path):
    frame = np.full(SIZE, 100)
    frame[:2] = 65535
    folder = pictures(tmp_path / "c", {"a_0": frame})
    with pytest.raises(DataError, match=r"40% of the pixels saturated in a_0, expected 1% at most"):
        read_captures(folder)
    assert read_captures(folder, may_saturate=True).saturated.sum() == 14
    with pytest.raises(DataError, match="frames of 5×7 pixels, expected 5×9"):
        read_captures(folder, may_saturate=True, sensor=(5, 9))


def test_frames_are_corrected_pixel_by_pixel_and_defects_filled():
    faults = NONE.copy()
    faults[2, 3] = 1
    gain = 1 + 0.1 * RNG.uniform(-1, 1, SIZE)
    dark = DarkField(np.full(SIZE, 50.0), np.ones(SIZE), faults, 4)
    known = Calibration.empty().with_part("dark", dark, {})
    known = known.with_part("flat", FlatField(gain, 900.0, 0.0, 0.0, NONE, 4), {})
    light = np.tile(np.arange(7.0), (5, 1)) * 10
    raw = light * gain + 50
    raw[2, 3] = 9999
    assert np.allclose(known.corrected(raw), light)
    assert np.allclose(known.corrected(np.stack([raw, raw]))[1], light)
    assert np.allclose(Calibration.empty().corrected(raw), raw)


def test_a_later_step_of_the_sensor_does_not_make_codes_younger(tmp_path, monkeypatch):
    dates = iter(datetime(2026, 1, day, tzinfo=UTC) for day in range(1, 9))
    monkeypatch.setattr("tmca.lab.calibration.file._now", lambda: next(dates))
    found = whole("timing").save(tmp_path / "one").with_part("dark", PARTS["dark"], {})
    again = load_calibration(found.save(tmp_path / "one").path)
    assert again.created.day == 4
    assert again.codes_seen.day == 1
    assert load_calibration(again.path).part("timing").repeats is False


def listed(folder, **taken):
    """A list of captures as `tmca capture` writes it, with the date of every frame."""
    folder.mkdir(exist_ok=True)
    frames = {name: {"slot": None, "of": name, "sha256": ""} | ({"taken": date} if date else {})
              for name, date in taken.items()}  # fmt: skip
    (folder / "captures.json").write_text(json.dumps({"frames": frames}))
    return folder


def dated(sources):
    return Calibration.empty("bench").with_part("timing", PARTS["timing"], {}, sources)


def test_a_step_is_as_old_as_its_oldest_frame(tmp_path):
    late, early = "2026-03-04T10:00:00+00:00", "2026-03-02T10:00:00+02:00"
    folder = listed(tmp_path / "frames", slot_000=late, slot_001=early, slot_002=None)
    for name in ("slot_000", "slot_002"):
        (folder / f"{name}.tif").write_bytes(b"frame")
    assert dated([folder]).codes_seen == datetime(2026, 3, 2, 8, tzinfo=UTC)
    assert dated([folder / "slot_000.tif"]).codes_seen == datetime(2026, 3, 4, 10, tzinfo=UTC)
    other = listed(tmp_path / "other", dark="2026-03-01T00:00:00+00:00")
    assert dated([folder, other]).codes_seen == datetime(2026, 3, 1, tzinfo=UTC)


def test_a_step_whose_frames_have_no_date_or_a_later_one_is_of_now(tmp_path, monkeypatch):
    now = datetime(2026, 5, 1, tzinfo=UTC)
    monkeypatch.setattr("tmca.lab.calibration.file._now", lambda: now)
    folder = listed(tmp_path / "frames", slot_000=None, slot_001="2027-01-01T00:00:00+00:00")
    (folder / "slot_000.tif").write_bytes(b"frame")
    (tmp_path / "plain").mkdir()
    for source in (folder, folder / "slot_000.tif", tmp_path / "plain"):
        assert dated([source]).codes_seen == now


@pytest.mark.parametrize("text", ["{", '{"frames": 3}', '{"frames": {"a": 1}}', '{"frames": {"a": {"taken": "x"}}}'])
def test_a_list_of_captures_that_is_none_is_refused(tmp_path, text):
    (tmp_path / "captures.json").write_text(text)
    with pytest.raises(DataError) as found:
        dated([tmp_path])
    assert found.value.where == str(tmp_path / "captures.json")


def test_codes_made_after_the_frames_are_not_those_of_the_calibration(tmp_path):
    camera = SpectralCamera(3, (4, 5), 4, seed=1)
    folder = listed(tmp_path / "frames", slot_000="2026-03-02T10:00:00+00:00")
    known = dated([folder])
    check_fits(camera, known, {"codes_date": "2026-03-02T09:00:00+00:00"})
    with pytest.raises(DataError, match="a calibration of 2026-03-02 10:00, expected one after the codes"):
        check_fits(camera, known, {"codes_date": "2026-03-02T11:00:00+00:00"})
    with pytest.raises(DataError, match="a date such as"):
        check_fits(camera, known, {"codes_date": "yesterday"})
    check_fits(camera, known, bench_of(camera, known.save(tmp_path / "cam").path).notes)
