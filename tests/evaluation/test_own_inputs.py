"""What a study of one's own takes: uneven bands, decoders and sensors from Python, one path, strings for folders."""

import numpy as np
import pytest

from tmca.cli import main
from tmca.data import label, read_dataset, write_dataset
from tmca.evaluation.gains import multiplexed, multiplexing
from tmca.evaluation.own import own_study

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
