"""What a study of one's own takes: uneven bands, decoders and sensors from Python, one path, strings for folders."""

from pathlib import Path

import numpy as np
import pytest

from tmca import Sensor
from tmca.cli import main
from tmca.data import label, read_dataset, write_dataset
from tmca.decoders import Decoder, decoders
from tmca.errors import DataError, SettingError
from tmca.evaluation.gains import multiplexed, multiplexing
from tmca.evaluation.own import own_study
from tmca.evaluation.page import markdown, results
from tmca.evaluation.run import run_study
from tmca.evaluation.study import checked_study, read_study
from tmca.evaluation.tables import latex_table
from tmca.sensor import SensorWarning

UNEVEN = np.array([429.5, 442.5, 456, 471.5, 489.5, 510.5, 534, 562, 598, 646, 687]) * 1e-9


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder with a cube of uneven bands; the current one."""
    monkeypatch.chdir(tmp_path)
    cube = label(np.random.default_rng(0).random((11, 20, 24), np.float32), UNEVEN)
    write_dataset(cube.to_dataset(name="radiance"), tmp_path / "uneven.nc")
    return tmp_path


def bands_of(file):
    return read_dataset(file, ())["wavelength"].values.tolist()


@pytest.mark.filterwarnings("ignore::tmca.data.in_memory.SceneWarning")
@pytest.mark.parametrize("asked", [[], ["--bands", "11"], ["--range", "429.5:687"]])
def test_a_snapshot_takes_all_of_fewer_than_twelve_uneven_bands(here, asked):
    main(["simulate", "spectral", "uneven.nc", *asked, "--slots", "2", "--no-figures", "--out", "s.nc"])
    assert bands_of("s.nc") == pytest.approx(UNEVEN)


@pytest.mark.filterwarnings("ignore::tmca.data.in_memory.SceneWarning")
def test_a_study_takes_all_of_fewer_than_twelve_uneven_bands(here):
    study = own_study(["uneven.nc"], codes=["cassi"], decoders=["dagger"])
    cube = study.evaluation.load("uneven.nc", study.reading)
    assert cube["wavelength"].values.tolist() == pytest.approx(UNEVEN)


def measured(study, levels):
    """Results of a study whose codes have these PSNR on one scene."""
    return {
        "split": {"test": ["a"], "real": ["a"], "train": []}, "budget": {"training": []},
        "rows": [{"code": code, "decoder": "dagger", "noise": noise, "psnr": psnr, "scenes": {"a": {"psnr": psnr}},
                  "seed_psnr": [psnr]} for noise in study.noises for code, psnr in levels.items()],
    }  # fmt: skip


def test_the_gain_of_multiplexing_is_told_by_the_buckets_that_it_needs_and_over_a_burst():
    codes = ["cassi", "one-hot", "two-bucket", "burst", "designed"]
    study = own_study(["coffee"], codes=codes, decoders=["dagger"], crop=(20, 24))
    found = measured(study, {"cassi": 30.0, "one-hot": 30.5, "two-bucket": 32.0, "burst": 31.0, "designed": 30.6})
    (said,) = multiplexing(found, study)
    assert said == (
        "Time multiplexing (least norm): over cassi (one slot) +0.60 dB with one bucket (designed), "
        "+2.00 dB with two buckets (two-bucket); over burst -0.40 dB with one bucket (designed), "
        "+1.00 dB with two buckets (two-bucket)."
    )
    (section,) = multiplexed(found, study)
    assert section.text[0] == said
    assert [(row["buckets"], row["against"]) for row in section.table] == [
        ("one", "one slot"), ("two", "one slot"), ("one", "a burst"), ("two", "a burst")]  # fmt: skip


def test_rows_without_a_scene_in_common_gain_nothing_that_could_be_told():
    study = own_study(["coffee"], codes=["cassi", "one-hot"], decoders=["dagger"], crop=(20, 24))
    found = measured(study, {"cassi": 30.0, "one-hot": 30.5})
    found["split"]["test"] = found["split"]["real"] = ["a", "b"]
    found["rows"][1]["scenes"] = {"b": {"psnr": 30.5}}
    assert multiplexing(found, study) == []
    (section,) = multiplexed(found, study)
    assert section.table[0]["gain"] is None


def test_bands_beyond_the_visible_range_are_left_to_who_asks_for_them(here):
    wide = label(np.random.default_rng(0).random((14, 20, 24), np.float32), np.linspace(400e-9, 1000e-9, 14))
    write_dataset(wide.to_dataset(name="radiance"), here / "wide.nc")
    main(["simulate", "spectral", "wide.nc", "--slots", "2", "--no-figures", "--out", "s.nc"])
    study = own_study("wide.nc", codes=["cassi"], decoders=["dagger"])
    assert study.reading["bands"] == len(bands_of("s.nc")) == 7
    assert max(bands_of("s.nc")) <= 700e-9


def test_a_cube_that_says_something_of_a_recording_is_a_cube(here, capsys):
    cube = read_dataset("uneven.nc", ()).assign_attrs(recording="session 3")
    write_dataset(cube, here / "said.nc")
    main(["inspect", "said.nc"])
    assert "cube" in capsys.readouterr().out


MINE = """
from tmca.decoders import Decoder

class Landweber(Decoder):
    def reconstruct(self, prepared, values, progress):
        return 0.1 * prepared.A_adjoint(values)
"""


@pytest.mark.filterwarnings("ignore::tmca.data.in_memory.SceneWarning")
def test_a_decoder_of_a_file_that_is_named_in_python_runs(here, monkeypatch):
    monkeypatch.setattr("tmca.evaluation.run.write_paper", lambda *_: None)
    (here / "mydec.py").write_text(MINE)
    study = own_study("uneven.nc", codes="cassi", decoders=["dagger", "mydec.py:Landweber"], bands=3)
    assert study.decoders == ("dagger", "Landweber")
    found = run_study(study, "nbstudy", "nbstudy/cells")
    assert {row["decoder"] for row in found["rows"]} == {"dagger", "Landweber"}
    described = {**study.model_dump(), "decoders": ["mydec.py:Landweber"]}
    with pytest.raises(SettingError, match="which is code"):
        run_study(checked_study(described, "study"), "other", "other/cells")


def test_a_class_is_taken_where_every_process_knows_it_and_else_told_how():
    class Landweber(Decoder):
        def reconstruct(self, prepared, values, progress):
            return values

    how = {"codes": ["cassi"], "crop": (20, 24)}
    for given in ([decoders()["dagger"]], decoders()["dagger"]):
        assert own_study(["coffee"], decoders=given, **how).decoders == ("dagger",)
    for given in (Landweber(), Decoder):
        with pytest.raises(SettingError, match="decoders: found the class"):
            own_study(["coffee"], decoders=given, **how)
    with pytest.raises(DataError, match=r"none\.nc: found no such file"):
        own_study(["coffee"], decoders="dagger", codes=Path("none.nc"), crop=(20, 24))
    with pytest.raises(SettingError, match=r'the class Landweber, expected ".*test_own_inputs.py:Landweber"'):
        own_study(["coffee"], decoders=[Landweber], **how)


@pytest.mark.parametrize(
    ("sensor", "noises"),
    [
        (Sensor(full_well=1e4, read_noise_electrons=3, bits=12),
         {"sensor": {"full_well": 1e4, "read_noise_electrons": 3, "bits": 12}}),
        (Sensor(read_noise=0.01, saturates=0.5), {"sensor": {"read_noise": 0.01, "saturates": 0.5}}),
        ({}, {"sensor": {}}),
        ({"full_well": 1e4, "bits": None}, {"sensor": {"full_well": 1e4, "bits": None}}),
        ({"dim": Sensor(read_noise=0.1), "ideal": {}}, {"dim": {"read_noise": 0.1}, "ideal": {}}),
    ],
)  # fmt: skip
def test_a_sensor_is_an_object_or_its_arguments(sensor, noises):
    study = own_study("coffee", sensor=sensor, codes=["cassi"], decoders="dagger", crop=(20, 24))
    assert study.noises == noises
    assert study.decoders == ("dagger",)


@pytest.mark.parametrize(("sensor", "said"), [(3, "found 3, expected a tmca.Sensor"),
                                              ({"hiss": 1}, "noises.sensor.hiss")])  # fmt: skip
def test_what_is_no_sensor_is_one_line(sensor, said):
    with pytest.raises(SettingError, match=said):
        own_study("coffee", sensor=sensor, codes=["cassi"], crop=(20, 24))


def test_doubts_about_the_sensor_stand_on_the_page(here):
    (here / "sensor.yaml").write_text("full_well: 10000\nread_noise: 4\nbuckets: 1\n")
    how = {"sensor": "sensor.yaml", "decoders": ["dagger"], "crop": (20, 24)}
    said = "sensor.yaml: buckets: 1 (sensor), but two are needed by two-bucket"
    with pytest.warns(SensorWarning, match="two are needed by two-bucket"):
        study = own_study("coffee", codes=["cassi", "two-bucket", "burst"], **how)
    split = {"test": ["coffee"], "train": [], "names": {"coffee": "coffee"}, "validation": []}
    page = markdown(results(study, [], split, ()))
    assert said in page
    assert "Warning: sensor sensor: read_noise 4 is in units of one white band" in page
    assert own_study("coffee", codes=["cassi", "burst"], **how).about == ()
    assert read_study("spectral").doubts == []


def test_a_table_for_latex_tells_the_spread_over_seeds():
    rows = [{"code": "a", "psnr": 30.0, "seed_psnr": [29.0, 31.0]}, {"code": "b", "psnr": 1.0, "seed_psnr": [1.0]}]
    said = latex_table(rows, [("code", "code", ""), ("psnr", "PSNR (dB)", ".2f")])
    assert r"a & 30.00 $\pm$ 1.41 \\" in said
    assert r"b & 1.00 \\" in said
    assert "% ± standard deviation over seeds" in said
