"""A decoder that goes on learning from captures: what moves, what stays, and that it never gets worse."""

import shutil

import numpy as np
import pytest
import torch

from tests.lab.calibration.test_apply import dispersed, registered, with_parts
from tests.training import tiny
from tmca import simulate
from tmca.applications import application_of
from tmca.cameras import Snapshot, SpectralCamera
from tmca.data import write_dataset
from tmca.decoders import Weights
from tmca.errors import DataError, SettingError
from tmca.lab.calibration.apply import bench_of
from tmca.sensor import Sensor
from tmca.tuning import held_out, prepared
from tmca.tuning.captures import Windows

SIZE, NAMES = (24, 32), ("first", "second", "third", "fourth")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A decoder trained in simulation for a few steps."""
    folder = tmp_path_factory.mktemp("tuning") / "run"
    changes = {"decoder.start": "dagger", "noise": [{"read_noise": 0.01}], "optimiser.steps": 4}
    return tiny.train(folder, **changes).weights


@pytest.fixture(scope="module")
def captures(run, tmp_path_factory):
    """Snapshots of the run's camera, and what they show."""
    return taken(run, tmp_path_factory.mktemp("captures"))


def taken(run, folder, calibration=None):
    camera = Weights.load(run).camera_for(SIZE, sensor=Sensor(read_noise=0.01))
    bench = bench_of(camera, calibration)
    for seed, name in enumerate(NAMES):
        cube = tiny.load(name)[:, : SIZE[0], : SIZE[1]]
        with torch.no_grad():
            values = bench.camera(torch.from_numpy(cube.values.copy())[None], generator=seed)
        bench.recorded(Snapshot(values, bench.camera)).save(folder / f"{name}.nc", overwrite=True)
        write_dataset(cube.to_dataset(name="radiance"), folder / f"{name}_truth.nc", overwrite=True)
    return folder


def ready(run, captures, calibration=None, **changes):
    own = {"optimiser.steps": 6, "validate_every": 3, "checkpoint_every": 2, "optimiser.decoder_rate": 0.003}
    return prepared(run, captures, calibration, validation=["fourth"], changes=own | changes)


def tuned(run, captures, folder, calibration=None, progress=None, **changes):
    found = ready(run, captures, calibration, **changes)
    return found.run(folder, accelerator="cpu", progress=progress)


def same(one, other):
    pairs = zip(one.network.parameters(), other.network.parameters(), strict=True)
    return all(torch.equal(a, b) for a, b in pairs)


def system_of(tuning, folder):
    from lightning_fabric import Fabric

    return tuning.set_up(tuning.settings, Fabric(accelerator="cpu", devices=1), folder, tuning.read).system


def test_the_decoder_alone_moves_and_is_not_worse_on_what_is_held_out(run, captures, tmp_path):
    found = tuned(run, captures, tmp_path / "tuned")
    before, after = Weights.load(run), Weights.load(found.weights)
    torch.testing.assert_close(after.codes, before.codes)
    assert found.best["step"] > 0
    assert not same(before, after)
    step, psnr = (tiny.logged(tmp_path / "tuned", name)[0] for name in ("step", "psnr"))
    assert step == 0
    assert found.best["psnr"] > psnr
    assert after.card["tuning"]["data"]["validation"] == ["fourth"]
    assert len(after.card["tuning"]["captures"]["first"]["capture"]["sha256"]) == 64


def test_a_window_gives_what_the_whole_capture_gives(run, captures, tmp_path):
    system = system_of(ready(run, captures), tmp_path)
    system.eval()
    assert system.simulated.mixes_columns
    torch.testing.assert_close(system.whole(1, 7), system.whole(1), atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize(("size", "side"), [((24, 32), 10), ((25, 31), 9)])
def test_windows_draw_every_capture_as_often(size, side):
    windows = Windows(3, size, side, False, 2, 5)
    drawn = [windows(step, index) for step in range(6) for index in range(2)]
    assert [sorted(w.which for w in drawn[i : i + 3]) for i in (0, 3, 6, 9)] == [[0, 1, 2]] * 4
    assert {(w.rows.stop - w.rows.start, w.columns.stop - w.columns.start) for w in drawn} == {(side, side)}
    assert all(w.rows.start >= 0 and w.rows.stop <= size[0] for w in drawn)
    wide = Windows(3, size, side, True, 2, 5)(0, 0)
    assert wide.columns == slice(0, size[1])


@pytest.mark.slow
def test_a_run_that_is_stopped_ends_as_one_that_is_not(run, captures, tmp_path):
    whole = tuned(run, captures, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        tuned(run, captures, tmp_path / "stopped", progress=tiny.stop_after(4))
    resumed = tuned(run, captures, tmp_path / "stopped")
    assert resumed.best == whole.best
    assert same(Weights.load(whole.weights), Weights.load(resumed.weights))


@pytest.mark.slow
def test_a_calibrated_operator_is_what_it_learns_behind_and_is_kept(run, tmp_path):
    camera = Weights.load(run).camera_for(SIZE)
    span = camera.snapshot_shape[2] - SIZE[1]
    place = registered(SIZE, camera.snapshot_shape[1:], [[1, 0.01, 0.4], [0, 1, span / 2 + 0.3]])
    calibration = with_parts(registration=place, dispersion=dispersed([-1.0, 0.0, 1.0])).save(tmp_path / "cam")
    (tmp_path / "captures").mkdir()
    folder = taken(run, tmp_path / "captures", calibration.path)
    as_drawn = tuned(run, folder, tmp_path / "drawn", **{"optimiser.decoder_rate": 1e-9})
    found = tuned(run, folder, tmp_path / "tuned", calibration.path)
    assert found.best["psnr"] > as_drawn.best["psnr"] + 1
    kept = Weights.load(found.weights)
    assert not set(kept.codes["aperture"].unique().tolist()) <= {0.0, 1.0}  # grey: the registered mask
    assert kept.card["tuning"]["calibration"]["sha256"]


@pytest.mark.parametrize(("kind", "scene"), [("light-field", "coffee:1"), ("spectral-depth", "motorcycle")])
def test_cameras_that_come_with_tmca_are_fine_tuned(kind, scene, tmp_path):
    weights = f"default-{kind}"
    camera = Weights.find(weights).camera_for((48, 64), sensor=Sensor(read_noise=0.01))
    truth = application_of(camera).truth(scene, camera, {}, False)
    for name in NAMES[:2]:
        simulate(truth, camera).save(tmp_path / f"{name}.nc")
        write_dataset(truth if kind == "spectral-depth" else truth.to_dataset(), tmp_path / f"{name}_truth.nc")
    tuning = prepared(weights, tmp_path, validation=["second"])
    assert (tuning.camera.kind, tuning.camera.size, tuning.settings.data.train) == (kind, (48, 64), ("first",))
    assert same(tuning.weights, Weights.find(weights))
    pair = tuning.read("second")
    assert pair.truth.shape[-2:] == (48, 64)


@pytest.mark.parametrize(
    ("asked", "apart"), [(["003"], ("003",)), (["1", "003"], ("003", "1")), (["1"], ("1",)), (["0.4"], None)]
)
def test_captures_may_be_called_by_numbers(asked, apart):
    names = ("001", "002", "003", "1", "0.5")
    learned, found = held_out(names, asked, 0)
    assert apart is None or found == apart
    assert len(found) == (len(apart) if apart else 2)
    assert sorted(learned + found) == sorted(names)


@pytest.mark.parametrize("asked", [["1.5"], ["0"], ["nan"], ["-0.2"]])
def test_shares_that_are_none_are_refused(asked):
    with pytest.raises(SettingError, match="--validation"):
        held_out(("a", "b", "c"), asked, 0)


def captured(folder, change=lambda values: None, seed=None):
    """Another capture of the second scene: other values, or of other codes."""
    taken = Snapshot.load(folder / "second.nc")
    change(taken.values)
    first = taken.camera
    codes = (
        first if seed is None else SpectralCamera(first.wavelengths, SIZE, 2, dispersion=first.dispersion, seed=seed)
    )
    Snapshot(taken.values, codes).save(folder / "second.nc", overwrite=True)


def shown(folder, change=lambda values: None, rows=SIZE[0]):
    """Another truth of the second scene."""
    cube = tiny.load("second")[:, :rows, : SIZE[1]]
    change(cube.values)
    write_dataset(cube.to_dataset(name="radiance"), folder / "second_truth.nc", overwrite=True)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda folder: (folder / "second_truth.nc").unlink(), "without its truth"),
        (lambda folder: (folder / "second.nc").unlink(), "without a capture"),
        (lambda folder: [file.unlink() for file in folder.iterdir()], "no captures"),
        (lambda folder: captured(folder, seed=99), "other codes than the run's"),
        (lambda folder: captured(folder, lambda v: v.zero_()), "without light"),
        (lambda folder: captured(folder, lambda v: v.masked_fill_(v >= v.quantile(0.9), 100.0)), "10% of the pixels"),
        (lambda folder: shown(folder, rows=20), "20×32 pixels"),
        (lambda folder: shown(folder, lambda v: v[0, 3].fill(np.nan)), "second_truth.nc: found 32 NaN"),
        (lambda folder: shown(folder, lambda v: np.multiply(v, 3, out=v)), "second_truth.nc: .*3 times as bright"),
        (lambda folder: shown(folder, lambda v: np.divide(v, 3, out=v)), "second_truth.nc: .*0.33. times as bright"),
        (
            lambda folder: shown(folder, lambda v: v[0, :2].fill(-0.5)),
            "second_truth.nc: found 64 negative .*0 in the file$",
        ),
        (lambda folder: shown(folder, lambda v: v.fill(0)), "second_truth.nc: .* 0 times as bright"),
    ],
)
@pytest.mark.filterwarnings("ignore::tmca.data.scenes.DarkScene")
def test_captures_that_teach_nothing_are_refused(run, captures, tmp_path, spoil, words):
    folder = shutil.copytree(captures, tmp_path / "captures")
    spoil(folder)
    with pytest.raises(DataError, match=words):
        ready(run, folder)


def test_settings_that_are_no_tuning_are_refused(run, captures):
    with pytest.raises(SettingError, match="no_such"):
        prepared(run, captures, validation=["no_such"])
    with pytest.raises(SettingError, match=r"decoder\.kind"):
        ready(run, captures, **{"decoder.kind": "unet"})


def test_a_network_of_any_codes_is_not_tuned(captures):
    with pytest.raises(SettingError, match="a network of any codes"):
        prepared("universal", captures)
