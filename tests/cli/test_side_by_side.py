"""Several snapshots, decoders and estimates in one command: one table, one picture, nothing lost where one fails."""

import json
import shutil

import numpy as np
import pytest
import torch
import xarray as xr

from tests.cli.refusals import refused
from tmca import reconstruct, simulate
from tmca.cameras import Snapshot, SpectralCamera
from tmca.cli import main
from tmca.data import read_dataset
from tmca.decoders import DECODERS
from tmca.errors import SettingError
from tmca.lab.decoder_files import decoder_named, decoders_named, loaded
from tmca.plots.side_by_side import what_differs

MINE = """
from tmca.decoders import Decoder

class Mine(Decoder):
    def reconstruct(self, prepared, values, progress):
        return 0.1 * prepared.A_adjoint(values)

class Breaks(Decoder):
    def reconstruct(self, prepared, values, progress):
        raise RuntimeError("no weights at hand")
"""


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    """Snapshots of one scene."""
    folder = tmp_path_factory.mktemp("two")
    for name, preset in (("static", "cassi"), ("buckets", "two-bucket")):
        main(["simulate", "spectral", "coffee", "--preset", preset, "--crop", "20x24", "--bands", "4",
              "--out", str(folder / f"{name}_snapshot.nc"), "--no-figures"])  # fmt: skip
    return folder


@pytest.fixture
def here(two, tmp_path, monkeypatch, capsys):
    """A folder with two snapshots of one scene and a file of decoders; the current one."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(two, tmp_path, dirs_exist_ok=True)
    (tmp_path / "mine.py").write_text(MINE)
    capsys.readouterr()
    return tmp_path


def test_a_snapshot_that_its_codes_do_not_explain_is_doubted(here, capsys):
    right = Snapshot.load("buckets_snapshot.nc")
    Snapshot(right.values.flip(1), right.camera).save("exchanged_snapshot.nc")
    main(["reconstruct", "buckets_snapshot.nc", "exchanged_snapshot.nc", "-d", "admm-tv", "--no-figures", "--json"])
    told = capsys.readouterr()
    own, exchanged = json.loads(told.out)
    assert own["left_of_snapshot"] < 0.03 < exchanged["left_of_snapshot"]
    (doubt,) = [line for line in told.err.splitlines() if "the estimate leaves" in line]
    assert doubt.startswith("tmca: exchanged_snapshot.nc: ")
    assert "buckets that are exchanged" in doubt


@pytest.mark.slow
def test_snapshots_times_decoders_are_written_and_drawn_side_by_side(here, capsys):
    main(["reconstruct", "static_snapshot.nc", "buckets_snapshot.nc", "-d", "dagger,mine.py:Mine", "--truth", "coffee",
          "--out", "all", "--json"])  # fmt: skip
    told = json.loads(capsys.readouterr().out)
    assert [(one["estimate"], one["decoder"]) for one in told] == [
        (f"all/{name}_{decoder}.nc", decoder) for name in ("static", "buckets") for decoder in ("dagger", "Mine")
    ]
    assert (here / "all" / "comparison.png").exists()
    main(["reconstruct", "static_snapshot.nc", "-d", "dagger", "--truth", "coffee", "--json", "--no-figures"])
    alone = json.loads(capsys.readouterr().out)
    assert alone["metrics"] == told[0]["metrics"]
    for file in ("all/static_dagger.nc", "static_dagger.nc"):
        assert read_dataset(file, ("estimate",)).attrs["metric_psnr"] == alone["metrics"]["psnr"]
    main(["evaluate", "all/static_dagger.nc", "all/buckets_dagger.nc", "coffee", "--figure", "both.png", "--json"])
    rows = json.loads(capsys.readouterr().out)
    assert [row["estimate"] for row in rows] == ["all/static_dagger.nc", "all/buckets_dagger.nc"]
    assert rows[0]["psnr"] == pytest.approx(alone["metrics"]["psnr"])
    assert (here / "both.png").exists()


def test_one_that_fails_does_not_cost_the_others(here, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["reconstruct", "static_snapshot.nc", "-d", "mine.py:Breaks,dagger", "--no-figures"])
    assert stop.value.code == 2
    told = capsys.readouterr()
    assert "static_dagger.nc: dagger" in told.out
    assert "fails with RuntimeError: no weights at hand (line 10)" in told.err
    assert (here / "static_dagger.nc").exists()
    alone = refused(capsys, "reconstruct", "static_snapshot.nc", "-d", "mine.py:Breaks")
    assert "Breaks of " in alone


def test_a_setting_goes_to_the_decoders_that_have_it(here, capsys):
    main(["reconstruct", "static_snapshot.nc", "-d", "dagger,admm-tv", "--set", "iterations=2", "--no-figures"])
    assert int(read_dataset("static_admm-tv.nc", ()).attrs["iterations"]) == 2
    said = refused(capsys, "reconstruct", "static_snapshot.nc", "-d", "dagger,mine.py:Mine", "--set", "iterations=2")
    assert "a setting of none of dagger, Mine" in said


def test_several_need_a_folder_and_names_of_their_own(here, capsys):
    assert "a folder" in refused(capsys, "reconstruct", "static_snapshot.nc", "-d", "dagger,admm-tv", "--out", "x.nc")
    (here / "runs.v2").mkdir()
    main(["reconstruct", "static_snapshot.nc", "-d", "dagger,mine.py:Mine", "--out", "runs.v2", "--no-figures"])
    assert (here / "runs.v2" / "static_dagger.nc").exists()
    again = ("reconstruct", "static_snapshot.nc", "static_snapshot.nc", "-d", "dagger")
    assert "several for static_dagger.nc" in refused(capsys, *again)
    assert "dagger twice" in refused(capsys, "reconstruct", "static_snapshot.nc", "-d", "dagger,dagger")


@pytest.mark.slow
def test_estimates_of_other_bands_have_no_common_picture(here, capsys):
    for name, ends in (("low", (400e-9, 540e-9)), ("high", (560e-9, 700e-9))):
        camera = SpectralCamera(tuple(np.linspace(*ends, 4).tolist()), (20, 24), slots=1)
        simulate("coffee", camera).save(f"{name}_snapshot.nc")
    capsys.readouterr()
    main(["reconstruct", "low_snapshot.nc", "high_snapshot.nc", "-d", "dagger", "--truth", "coffee"])
    assert "no comparison.png: the estimates differ in wavelength" in capsys.readouterr().out
    assert not (here / "comparison.png").exists()
    asked = ("evaluate", "low_dagger.nc", "high_dagger.nc", "coffee", "--figure", "mix.png")
    assert "they differ in wavelength" in refused(capsys, *asked)
    assert not (here / "mix.png").exists()


def test_an_estimate_stands_once_and_a_missing_truth_is_said_alone(here, capsys):
    main(["reconstruct", "static_snapshot.nc", "-d", "dagger", "--no-figures"])
    assert "static_dagger.nc twice" in refused(capsys, "evaluate", "static_dagger.nc", "static_dagger.nc", "coffee")
    assert "nope" in refused(capsys, "evaluate", "static_dagger.nc", "nope")
    assert "nope" in refused(capsys, "reconstruct", "buckets_snapshot.nc", "-d", "dagger", "--truth", "nope")


def test_other_truths_of_the_same_bands_have_no_common_picture():
    estimate = xr.Dataset({"estimate": ("wavelength", np.zeros(3))}, {"wavelength": [4e-7, 5e-7, 6e-7]})
    truth = estimate["estimate"]
    assert what_differs([estimate, estimate], [truth, truth]) == ""
    assert what_differs([estimate, estimate], [truth, truth + 1]) == "truth"


@pytest.mark.filterwarnings("always::tmca.data.in_memory.SceneWarning")
def test_a_truth_of_another_scene_is_told_and_the_work_goes_on(here, capsys):
    main(["reconstruct", "static_snapshot.nc", "-d", "dagger,mine.py:Mine", "--truth", "rocket", "--no-figures"])
    assert "rocket is beside a snapshot of coffee" in capsys.readouterr().err
    main(["evaluate", "static_dagger.nc", "static_Mine.nc", "rocket"])
    told = capsys.readouterr()
    assert "rocket is beside a snapshot of coffee" in told.err
    assert "| static_Mine.nc |" in told.out


@pytest.mark.slow
def test_sweeps_take_decoders_of_files(here, capsys):
    main(["sweep", "spectral", "coffee", "--bands", "4", "--crop", "20x24", "--vary", "slots=1,2", "--decoder",
          "mine.py:Mine", "--json"])  # fmt: skip
    assert len(json.loads(capsys.readouterr().out)["rows"]) == 2


def test_a_decoder_of_a_file_has_a_name_and_is_known_to_other_processes(here):
    assert decoders_named("lmmse, mine.py:Mine") == ["lmmse", "Mine"]
    assert DECODERS["Mine"].label == "Mine"
    assert loaded(["lmmse", "Mine"]) == {"Mine": f"{here / 'mine.py'}:Mine"}
    (here / "other.py").write_text(MINE)
    assert decoder_named("other.py:Mine") == "Mine"  # the one that was named last
    assert loaded(["Mine"]) == {"Mine": f"{here / 'other.py'}:Mine"}
    with pytest.raises(SettingError, match="no file"):
        decoder_named("none.pt2")


@pytest.mark.slow
def test_an_exported_program_is_a_decoder(here, capsys):
    camera = SpectralCamera(4, (20, 24), slots=1, shutter="open")

    class Program(torch.nn.Module):
        def forward(self, values):
            return values[:, :, :, :24].expand(1, 4, 20, 24) * 0.5

    exported = torch.export.export(Program(), (torch.zeros(1, *camera.snapshot_shape),), strict=False)
    torch.export.save(exported, here / "half.pt2")
    main(["reconstruct", "static_snapshot.nc", "-d", "half.pt2", "--no-figures"])
    taken, found = read_dataset("static_snapshot.nc", ()), read_dataset("static_half.nc", ())
    wanted = 0.5 * taken["snapshot"].values.reshape(20, -1)[:, :24].clip(0)
    assert found["estimate"].values[2] == pytest.approx(wanted, abs=1e-6)
    for path in ("half.pt2", here / "half.pt2"):
        assert reconstruct("static_snapshot.nc", path).values[0, 2].numpy() == pytest.approx(wanted, abs=1e-6)
    with pytest.raises(SettingError, match=r"none\.pt2, which is no file"):
        reconstruct("static_snapshot.nc", "none.pt2")


@pytest.fixture
def infrared(here):
    """A snapshot at bands that the rendered scenes do not have."""
    camera = SpectralCamera([750e-9, 820e-9, 900e-9], (20, 24), slots=2)
    Snapshot(camera(torch.rand(1, *camera.scene_shape), generator=0), camera).save("nir.nc")
    return "nir.nc"


@pytest.mark.filterwarnings("always::tmca.decoders.NoRenderedPrior")
@pytest.mark.parametrize("decoders", [None, "admm-tv", "dagger,admm-tv"])
def test_bands_without_a_prior_have_admm_tv_and_that_is_said_only_where_no_decoder_is_named(infrared, capsys, decoders):
    named = [] if decoders is None else ["-d", decoders]
    main(["reconstruct", infrared, *named, "--no-figures", "--json"])
    shown = capsys.readouterr()
    made = json.loads(shown.out)
    used = [one["decoder"] for one in (made if isinstance(made, list) else [made])]
    assert used == (decoders or "admm-tv").split(",")
    assert ("admm-tv instead of lmmse" in shown.err) == (decoders is None)


@pytest.mark.parametrize("option", [["--register", "auto"], ["--bank", "bank.nc"]])
def test_what_needs_a_prior_does_not_fall_back(infrared, capsys, option):
    assert "expected 400 to 700 nm" in refused(capsys, "reconstruct", infrared, *option)
