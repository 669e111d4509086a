"""What a study of one's own takes: uneven bands, decoders and sensors from Python, one path, strings for folders."""

import numpy as np
import pytest

from tmca.cli import main
from tmca.data import label, read_dataset, write_dataset
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
